"""The ceiling of what can be found: a search on the robot itself.

No real robot bears it (30,000 walks in the paper's size). A stand-in robot does, and
shows how much of what could be had a search in a simulator finds.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from gatjax import search
from gatjax.loop.candidates import Candidate, Job
from gatjax.loop.optimise import generations
from gatjax.loop.setting import ORACLE, ROBOT_UNIT, Setting, judged
from gatjax.loop.steps import Steps, apart
from gatjax.records import Array

APART = 10**11  # above all seeds of `gatjax.settings.seeds`


def oracle(setting: Setting, iteration: int, theta: Array) -> list[Candidate]:
    """Search on the robot, or go on with it; return its candidates."""
    job = Job(
        folder=setting.folder,
        method=ORACLE,
        iteration=iteration,
        world=setting.world,
        theta=theta,
        key=setting.key(3, iteration),
        check_key=setting.key(4, iteration),
    )

    def evaluate(values: Any, policies: Array, keys: Array) -> Array:
        """Costs [N, R] of policies [N, 15], each walked with the same R seeds."""
        drawn = APART + np.asarray(jax.random.bits(keys[0], (len(keys),)), np.int64)
        count, repeats = len(policies), len(drawn)
        each = np.repeat(policies, repeats, axis=0)
        seeds = np.tile(drawn, count)
        outcome = judged(setting.robot, each, seeds, setting.task)()
        return np.reshape(outcome.cost, (count, repeats))

    def build(space: search.Space) -> Steps:
        return apart(
            search.host_generation(space, setting.settings.search, evaluate), ()
        )

    return generations([job], setting.settings, setting.progress, build, ROBOT_UNIT)[0]
