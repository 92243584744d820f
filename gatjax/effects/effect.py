"""An effect is a pair of pure functions; effects compose by chaining."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

Array = Any
Tree = Any


class Effect(NamedTuple):
    """A law that changes a signal on its way, with a memory.

    `init(params, signal) -> state` is called once with the first signal of a run;
    `apply(params, state, signal) -> (state, signal)` once per tick (command and sensor
    effects) or per physics step (motor effects). Everything that may be fitted or
    randomised is in `params`; units and shapes are those of each effect's docstring.
    """

    init: Callable[[Tree, Any], Tree]
    apply: Callable[[Tree, Tree, Any], tuple[Tree, Any]]


def chain(**parts: Effect) -> Effect:
    """Apply effects one after the other; params and state are dicts by part name.

    A part's first state comes from the signal as the parts before it leave it, so a
    chain that starts at rest stays at rest. Without parts, nothing happens.
    """

    def init(params: dict, signal: Any) -> dict:
        states = {}
        for name, part in parts.items():
            states[name] = part.init(params[name], signal)
            _, signal = part.apply(params[name], states[name], signal)
        return states

    def apply(params: dict, states: dict, signal: Any) -> tuple[dict, Any]:
        states = dict(states)
        for name, part in parts.items():
            states[name], signal = part.apply(params[name], states[name], signal)
        return states, signal

    return Effect(init, apply)


def memoryless(change: Callable[[Tree, Any], Any]) -> Effect:
    """Return an effect without a state from `change(params, signal) -> signal`."""
    return Effect(
        init=lambda params, signal: (),
        apply=lambda params, state, signal: (state, change(params, signal)),
    )
