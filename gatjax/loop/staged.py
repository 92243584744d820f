"""The stages of a diagnosis as progress."""

from __future__ import annotations

import threading
from collections.abc import Callable

from gatjax.runs import Progress

ENGINE = {
    "stand": ("simulate the standing robot", 0.0, 0.1),
    "contact": ("look how soles grip", 0.04, 0.07),
    "tolerances": ("fit tolerances", 0.05, 0.2),
    "everywhere": ("look for causes of the whole robot", 0.2, 1.2),
    "causes": ("weigh causes", 0.3, 0.8),
    "losses": ("look for lost commands", 0.3, 0.8),
    "aside": ("weigh causes without what nothing explains", 0.3, 0.8),
    "astray": ("weigh causes of joints that go astray", 0.3, 0.8),
    "suspects": ("simulate floors, soles and tilts", 0.3, 0.6),
    "whole": ("play causes with the whole robot", 0.6, 0.7),
    "floor": ("weigh causes of floor and feet", 0.7, 0.8),
    "extend": ("extend the model", 0.8, 0.82),
    "measure": ("measure on logs", 0.82, 1.0),
}
"""Stages of the engine: what to say, and where they lie in the whole.

A robot that is wrong everywhere is looked at most of the time; others skip that.
"""
HALF = 0.5  # of what is left of a stage, for one more round of it


def staged(progress: Progress) -> Callable[[str, float], None]:
    """Turn the engine's stages into progress over one unit of work.

    A stage whose share falls back has begun another round; nobody knows how many there
    will be, so each takes half of what is left of the stage.

    Args:
        progress: over 1.0 units of work.

    Returns:
        The engine's `tell(stage, share)`; it may be called from several threads.
    """
    lock = threading.Lock()
    state = {"stage": "", "share": 1.0, "begin": 0.0, "done": 0.0}

    def tell(stage: str, share: float) -> None:
        text, first, last = ENGINE.get(stage, (stage, state["done"], 1.0))
        with lock:
            fresh = stage != state["stage"]
            if fresh or share < state["share"]:
                state["begin"] = max(first, state["done"]) if fresh else state["done"]
                state["stage"] = stage
                progress.stage(text if fresh else f"{text}, once more")
            state["share"] = share
            reached = state["begin"] + HALF * share * (last - state["begin"])
            if reached > state["done"]:
                progress.work(reached - state["done"])
                state["done"] = reached

    return tell
