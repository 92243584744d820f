"""How long work tells where it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Progress(NamedTuple):
    """Where long work says what it does and how much of it is done."""

    stage: Callable[[str], None]
    work: Callable[[float], None]  # units done since the last call
    past: Callable[[float], None] = lambda units: None  # done before, in no time
