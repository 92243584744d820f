"""Lost commands that explain something: others go from a pattern again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.trajectories import stretches
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.drops import ADVANCE, Losses, price, with_commands
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.joint import Joint

SHARES = (0.97, 0.9, 0.75, 0.5, 0.25, 0.1)  # of the bursts that are left out at once


def pruned(losses: Losses, joint: Joint, commands: list[np.ndarray]) -> Losses:
    """Losses without the bursts that explain less than it takes to write them down.

    A search that finds a few losses finds many more, of single ticks that make little
    difference, where a tolerance is not at its best yet. Those that matter least go
    first, in each round the share of them without which the pattern is worth most.

    Args:
        losses: as decoded.
        joint: with the full commands.
        commands: of each run [N], rad.
    """
    while every := _bursts(losses.lost):
        matter = [_cost(losses, joint, commands, burst) for burst in every]
        order = [every[k] for k in np.argsort(matter)]
        counts = {int(share * len(order)) for share in SHARES} - {0}
        trials = [
            _fitted(joint, commands, _without(losses.lost, order[:count]), losses.fit)
            for count in sorted(counts)
        ]
        best = max(trials, key=_nats, default=losses)
        if _nats(best) <= _nats(losses):
            break
        losses = best
    return losses


def _nats(losses: Losses) -> float:
    """What a pattern explains, less what it takes to write it down."""
    return fits.evidence(losses.joint, losses.fit) - losses.price


def _bursts(lost: Sequence[np.ndarray]) -> list[tuple[int, int, int]]:
    """Run, first tick and end of each burst in masks [N]."""
    return [
        (run, *pair)
        for run, mask in enumerate(lost)
        for pair in stretches(mask).tolist()
    ]


def _without(
    lost: Sequence[np.ndarray], some: Sequence[tuple[int, int, int]]
) -> list[np.ndarray]:
    """Masks [N] without some bursts."""
    out = [mask.copy() for mask in lost]
    for run, first, end in some:
        out[run][first:end] = False
    return out


def _cost(
    losses: Losses, joint: Joint, commands: list[np.ndarray],
    burst: tuple[int, int, int],
) -> float:  # fmt: skip
    """Squared misfit without a burst, at the same numbers."""
    now = with_commands(joint, commands, _without(losses.lost, [burst]))
    return fits.squares(now, (losses.fit.hypothesis, losses.fit.x))


def _fitted(
    joint: Joint, commands: list[np.ndarray], lost: list[np.ndarray], fit: Fit
) -> Losses:
    """A pattern with the numbers that suit it, from those of another one."""
    now = with_commands(joint, commands, lost)
    first = fits.start(now, [(fit.hypothesis, fit.x)])
    best = fits.improve(now, first, 2 * ADVANCE)[0]
    return Losses(lost, now, best, price(joint, commands, lost))
