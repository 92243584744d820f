"""What a foreign log holds: every signal on its own clock, run by run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

BEGUN = 100_000  # samples that tell the rate of a signal


class Stream(NamedTuple):
    """One signal as it was stamped."""

    time: np.ndarray  # [N] in the unit of the log
    values: np.ndarray  # [N] in the unit of the log

    def period(self) -> float:
        """Time from one sample to the next, as a rule; 0 of a single sample."""
        begun = self.time[:BEGUN]
        return float(np.median(np.diff(begun))) if len(begun) > 1 else 0.0


Run = dict[str, Stream]
"""Signals of one run by their name in the log."""


Tell = Callable[[float], None]
"""Is called with the share of a log that is read."""


class Given(NamedTuple):
    """What a user's map says of a table before it is read; None: not said."""

    time: str | None = None  # column of the stamps
    run: str | None = None  # column of the runs' numbers
    skips: Callable[[str], bool] = lambda name: False  # columns that it does not want


Rows = slice | np.ndarray


def rows_of(ids: np.ndarray) -> Iterator[Rows]:
    """The rows of each run, by the number [N] of each row's; one piece is a slice."""
    ends = np.flatnonzero(np.diff(ids)) + 1
    pieces = list(zip([0, *ends.tolist()], [*ends.tolist(), len(ids)], strict=True))
    if len({ids[first] for first, _ in pieces}) == len(pieces):
        yield from sorted((slice(*p) for p in pieces), key=lambda s: ids[s.start])
        return
    for each in np.unique(ids):
        yield np.flatnonzero(ids == each)


class Source(NamedTuple):
    """A log that was read and not changed."""

    name: str  # the file or folder
    kind: str  # the format, in words
    runs: list[Run]
    draft: dict[str, dict[str, Any]]  # columns of a map: what the format tells of names
    metadata: dict[str, Any]
    notes: list[str]  # what was left out, one line each


def numbered(count: int) -> list[str]:
    """Names of joints that nobody named."""
    return [f"joint_{k}" for k in range(count)]


def table(prefix: str, names: list[str], time: np.ndarray, values: np.ndarray) -> Run:
    """Signals `<prefix><name>` of a table [N, len(names)].

    Raises:
        ValueError: one line: two have one name.
    """
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise ValueError(f"{prefix}{twice[0]} is there twice; each joint needs a name")
    return {
        f"{prefix}{name}": Stream(time, np.ascontiguousarray(values[:, k], np.float64))
        for k, name in enumerate(names)
    }
