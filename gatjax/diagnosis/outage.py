"""The rival of lost commands: the motor was without power for as long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.trajectories import stretches
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.drops import (
    LOST,
    ODDS,
    ROUNDS,
    Losses,
    on_grid,
    period,
)
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import combined
from gatjax.diagnosis.joint import Joint

LONG = 4  # ticks of a burst that may be a loss of power
PASSES = 3  # rounds in which begins and ends are moved
MOVES = [
    np.array([begin, end])  # ticks: one of them, or the window as a whole
    for begin in range(-2, 3) for end in range(-2, 3)
    if (begin * end == 0) != (begin == end)
]  # fmt: skip


def outage(
    joint: Joint, base: Fit, commands: list[np.ndarray], losses: Losses
) -> Losses | None:
    """Return the fit of a motor that was without power where commands got lost.

    Begins and ends are moved to where they explain most: the target that a pattern of
    losses holds is not where a limp joint hangs, and so its bursts end elsewhere.

    Args:
        joint: with the full commands.
        base: what is known about it.
        commands: of each run [N], rad.
        losses: as decoded; shorter ones are taken for errors of the decoder.

    Returns:
        A fit with its windows; None if no burst is long.
    """
    windows = [_long(mask) for mask in losses.lost]
    if not any(window.any() for window in windows):
        return None
    best = _fitted(joint, base, commands, windows, [base.x, losses.fit.x])
    for _ in range(PASSES):
        windows = _moved(best)
        if not any(window.any() for window in windows):
            break  # the motor had power all the time
        now = _fitted(joint, base, commands, windows, [best.fit.x])
        if now.fit.cost >= best.fit.cost:
            break
        best = now
    return best


def _long(lost: np.ndarray) -> np.ndarray:
    """The bursts of a mask [N] that are long, [N] bool."""
    out = np.zeros(len(lost), bool)
    for first, end in stretches(lost):
        out[first:end] = end - first >= LONG
    return out


def _unpowered(joint: Joint, windows: Sequence[np.ndarray]) -> Joint:
    """The joint without power in windows [N] of each run."""
    off = on_grid(joint, [window.astype(float) for window in windows])
    return joint._replace(grid=joint.grid._replace(supply=off))


def _fitted(
    joint: Joint, base: Fit, commands: list[np.ndarray],
    windows: list[np.ndarray], begins: list[np.ndarray],
) -> Losses:  # fmt: skip
    """The windows with the numbers that suit them, from the better of some starts."""
    now = _unpowered(joint, windows)
    ticks = sum(int(window.sum()) for window in windows)
    times = sum(len(stretches(window)) for window in windows)
    told = {"duration": ticks * period(joint, commands) / times, "times": float(times)}
    law = combined(base.hypothesis, UNPOWERED._replace(values=lambda joint, x: told))
    starts = fits.start(now, [(law, x) for x in begins])
    fit = min(fits.improve(now, starts, ROUNDS), key=lambda fit: fit.cost)
    return Losses(windows, now, fit, 2.0 * ODDS * times)  # begins and ends


def _moved(found: Losses) -> list[np.ndarray]:
    """The windows with begins and ends where the same numbers explain most."""
    windows, least = list(found.lost), _cost(found, found.lost)
    for run, window in enumerate(found.lost):
        edges = stretches(window)
        for place in range(len(edges)):
            first = edges[place].copy()
            for move in MOVES:
                here = edges.copy()
                here[place] = first + move
                trial = list(windows)
                trial[run] = _within(here, len(window))
                if (cost := _cost(found, trial)) < least:
                    least, windows, edges = cost, trial, here
    return windows


def _within(edges: np.ndarray, ticks: int) -> np.ndarray:
    """Windows [ticks] bool between edges [K, 2]."""
    tick = np.arange(ticks)[:, None]
    return np.any((tick >= edges[:, 0]) & (tick < edges[:, 1]), axis=1)


def _cost(found: Losses, windows: Sequence[np.ndarray]) -> float:
    """Squared misfit with other windows, at the same numbers."""
    now = _unpowered(found.joint, windows)
    return fits.squares(now, (found.fit.hypothesis, found.fit.x))


UNPOWERED = LOST._replace(
    cause="", variant="loss of power",
    put=lambda drive, joint, x: drive.update(sag=1.0),
)  # fmt: skip
"""The supply fails in windows that the grid tells: no entry of the catalogue."""
