"""Compiled control loops are shared by worlds of one structure, and by no others."""

import dataclasses

import jax
import numpy as np
import pytest

from gatjax.effects.effect import memoryless
from gatjax.grounding.learn import METHODS, Grounding, grounded
from gatjax.sim.control import control
from gatjax.sim.lighter import lighter
from gatjax.sim.world import add_cause, add_command, nominal, stiffened
from gatjax.task import Task

SHORT = Task(settle=0.1, longest_delay=0.04, duration=0.1)


def lossy(share):
    return add_cause(nominal(SHORT), "dropped_commands", ["all"], share)


def learned(effect):
    return add_command(nominal(SHORT), "learned", effect, ())


def guided(number):
    """A world grounded by networks of their own numbers."""
    zero = METHODS["guided"].template(13)
    params = jax.tree.map(lambda leaf: np.asarray(leaf) + number, zero)
    return grounded(nominal(SHORT), Grounding("guided", params, {}))


def test_other_numbers_share_what_is_compiled():
    plain = nominal(SHORT)
    zero = jax.tree.map(np.zeros_like, plain.values)
    again = dataclasses.replace(nominal(SHORT), values=zero)
    assert control(again) is control(plain)
    assert control(guided(1.0)) is control(guided(2.0))
    assert control(lighter(guided(1.0))) is control(lighter(guided(2.0)))


OTHERS = {
    "a cause": lossy(0.1),
    "its value": lossy(0.2),
    "a role": add_cause(nominal(SHORT), "dropped_commands", ["all"], 0.1, "bound"),
    "a joint effect": stiffened(nominal(SHORT)),
    "a grounding": guided(1.0),
    "something learned": learned(memoryless(lambda params, signal: signal)),
    "something else learned": learned(memoryless(lambda params, signal: signal)),
    "a lighter model": lighter(nominal(SHORT)),
    "a physics step": nominal(SHORT, timestep=0.002),
    "a task": nominal(SHORT._replace(duration=0.2)),
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_would_be_compiled_otherwise_is_not_shared(name):
    others = [nominal(SHORT), *(each for k, each in OTHERS.items() if k != name)]
    assert all(control(OTHERS[name]) is not control(each) for each in others)
