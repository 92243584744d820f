"""A simulated NAO in this process walks, and something goes wrong."""

from __future__ import annotations

import numpy as np

from gatjax.hardware import walks
from gatjax.robot import nao
from gatjax.surrogate.faults import PERIOD, standing, started
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0

TASK = task_at(83.3, duration=2.0)
BEGIN = 150  # frames on its feet: it walks


def session(fault=None, robot="stiff"):
    """A robot on its feet, ready to walk, and its link."""
    return standing(robot, fault, BEGIN)


def walk(held, task=TASK, mind=None):
    """Let it walk theta0."""
    mind = mind or started(task, THETA0)
    try:
        return walks.walk(held, mind, task)
    finally:
        mind.close()


def check_commands(link):
    """Refuse commands that no robot should get."""
    targets = np.array([command.target for command in link.commands])
    powers = np.array([command.stiffness for command in link.commands])
    assert np.isfinite(targets).all()
    assert (targets >= nao.LOW).all() and (targets <= nao.HIGH).all()
    speed = np.abs(np.diff(targets, axis=0)) / PERIOD
    assert (speed <= nao.SPEEDS + 1e-9).all()
    assert (powers >= 0.0).all() and (powers <= 1.0).all()
    assert (np.diff(powers, axis=0) <= PERIOD + 1e-9).all()  # a second to full power
    return targets, powers
