"""The rows of a run: its signals at the stamps of its positions.

A command counts from its stamp until the next one (zero-order hold). What is slower
than the rows or stamped apart from them is interpolated, and that is told; no signal is
carried on beyond its own stamps.
"""

from __future__ import annotations

import numpy as np

from gatjax.data.readers.source import Run, Stream

HELD = ("command.", "stiffness.")  # signals that hold until the next stamp
SLACK = 2.0  # periods of a signal that it may begin late, pause, or end early
LATE = 1.0  # s without a command at the end that is told, or without another signal
ROUNDING = 1e-6  # share of a pause
Done = dict[str, dict[str, None]]  # what was done, to which signals or in which runs


def row_signals(
    run: Run, where: str, done: Done, raw: list[str]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Time [N] s of the rows of a run, and its signals [N] each.

    Args:
        run: signals in SI by the columns that they become.
        where: log and run, for messages.
        done: gets what was done.
        raw: names of all signals of the log, for messages.

    Raises:
        ValueError: one line: no positions, stamps that do not increase, nothing left.
    """
    positions = [name for name in run if name.startswith("position.")]
    if not positions:
        raise ValueError(
            f"{where}: no position of any joint; correct the draft of a map that "
            f"gatjax import writes, and give it as --map; it has {', '.join(raw)}"
        )
    for name, stream in run.items():
        _check_clock(stream.time, f"{where}, {name}")
    clock = max((run[name].time for name in positions), key=len)
    time = _bridged(_spanned(clock, run, where, done), run, where, done)
    found = {n: _at(time, n, s, done) for n, s in run.items() if _covers(n, s, time)}
    for name, stream in run.items():
        if name not in found:
            span = f"{stream.time[0]:.4g} to {stream.time[-1]:.4g} s"
            text = f"left out, from {span} only, rows to {time[-1]:.4g} s"
            if _reaches(stream, time):
                text = f"left out, nothing for {_pauses(stream, time).max():.3g} s"
            done.setdefault(text, {})[name] = None
    return time, found


def _spanned(clock: np.ndarray, run: Run, where: str, done: Done) -> np.ndarray:
    """Stamps [N] at which there is a command and a position of each joint."""
    held = {n: s.time[0] for n, s in run.items() if n.startswith(HELD)}
    seen = {n: s for n, s in run.items() if n.startswith("position.")}
    begins = held | {n: s.time[0] - s.period() for n, s in seen.items()}
    ends = {n: s.time[-1] + s.period() for n, s in seen.items()}
    last, first = min(ends, key=ends.__getitem__), max(begins, key=begins.__getitem__)
    early, over = clock < begins[first], clock > ends[last]
    kept = ~(early | over)
    if not kept.any():
        raise ValueError(
            f"{where}: no row has all of it: {first} begins at "
            f"{run[first].time[0]:.6g} s, {last} ends at {run[last].time[-1]:.6g} s"
        )
    before = "the first command" if first in held else f"the first {first}"
    for rows, place in ((early, f"before {before}"), (over, f"after the last {last}")):
        if rows.any():
            text = f"{rows.sum()} rows {place} left out"
            done.setdefault(text, {})[where.rpartition(": ")[2]] = None
    return clock if kept.all() else clock[kept]


def _bridged(time: np.ndarray, run: Run, where: str, done: Done) -> np.ndarray:
    """Stamps [N] less those within a pause of a joint's positions."""
    for name, stream in run.items():
        if not name.startswith("position.") or stream.time is time:
            continue
        most = SLACK * stream.period() * (1.0 + ROUNDING)
        within = _pauses(stream, time) > most
        if within.any():
            text = f"{within.sum()} rows in pauses of {name} left out"
            done.setdefault(text, {})[where.rpartition(": ")[2]] = None
            time = time[~within]
    if not len(time):
        raise ValueError(f"{where}: no row has all of it: positions pause in turns")
    return time


def _covers(name: str, stream: Stream, time: np.ndarray) -> bool:
    """Whether a signal is known at all rows; what is held is from its begin on."""
    if name.startswith((*HELD, "position.")):
        return True
    pause = max(LATE, SLACK * stream.period())
    if stream.time is time:  # large logs: one clock is not searched for itself
        return True
    return _reaches(stream, time) and bool(_pauses(stream, time).max() <= pause)


def _reaches(stream: Stream, time: np.ndarray) -> bool:
    """Whether a signal is there from the first row to the last."""
    late, over = stream.time[0] - time[0], time[-1] - stream.time[-1]
    return bool(max(late, over) <= SLACK * stream.period())


def _pauses(stream: Stream, time: np.ndarray) -> np.ndarray:
    """The time without a sample, s, that each row [N] falls into; 0 at a sample."""
    gaps = np.append(np.diff(stream.time), 0.0)  # none before the first nor after
    last = np.searchsorted(stream.time, time, side="right") - 1
    return np.where(time == stream.time[last], 0.0, gaps[last])


def _at(time: np.ndarray, name: str, stream: Stream, done: Done) -> np.ndarray:
    """A signal at the rows' stamps [N]."""
    if stream.time is time or np.array_equal(stream.time, time):
        return stream.values
    at = np.minimum(np.searchsorted(stream.time, time), len(stream.time) - 1)
    if np.array_equal(stream.time[at], time):
        return stream.values[at]
    rate = 1.0 / stream.period() if len(stream.time) > 1 else 0.0
    if name.startswith(HELD):
        alone = time[-1] - stream.time[-1]
        if alone > max(LATE, SLACK * stream.period()):
            text = f"nothing in the last {alone:.3g} s, where the last one is held"
            done.setdefault(text, {})[name] = None
        done.setdefault(f"{rate:.3g} Hz, held until the next one", {})[name] = None
        return stream.values[np.searchsorted(stream.time, time, side="right") - 1]
    text = f"{rate:.3g} Hz, interpolated to the rows' stamps"
    done.setdefault(text, {})[name] = None
    return np.interp(time, stream.time, stream.values)


def _check_clock(time: np.ndarray, where: str) -> None:
    """Refuse stamps that stand still or run back."""
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        row = int(late[0]) + 1
        raise ValueError(
            f"{where}: sample {row + 1} is stamped {time[row]:g} s, the one before it "
            f"{time[row - 1]:g} s; stamps must increase ({late.size} do not): sort or "
            f"cut the log there"
        )
