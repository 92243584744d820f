"""What patterns of lost commands tell: how many, in what bursts, and whether by chance.

A pattern is a mask of the ticks whose commands never reached the servo, run by run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from gatjax.data.trajectories import stretches
from gatjax.diagnosis import beam

TOLD = 0.75  # quantile of the changes of a command beyond which a loss is seen
FEW = 60  # changes: of fewer a share tells little, and smaller ones count too
SURE = 1.645  # deviations of a normal variable that hold 90 %
SELECTIVE = 3.0  # deviations: small changes are lost more often than by chance
SHOWN = 4.0  # times the noise: a change that cannot be overlooked
EXPECTED = 5.0  # losses of a run at least, for the chi-square test (Cochran 1954)
UNLIKELY = 1e-3  # probability of losses that differ so much from run to run


def statistics(
    lost: Sequence[np.ndarray], commands: Sequence[np.ndarray]
) -> dict[str, float]:
    """Probability of a loss, and mean burst, of decoded masks [N] and commands [N].

    The share of losses is that among the changes that show best, the largest quarter: a
    loss that changes nothing is not decoded.
    """
    gone, _ = _telling(lost, commands)
    count = sum(int(mask.sum()) for mask in lost)
    times = sum(len(stretches(mask)) for mask in lost)
    return {
        "probability": float(gone.mean()) if len(gone) else 0.0,
        "burst": max(count / max(times, 1), 1.0),
    }


def within(
    lost: Sequence[np.ndarray], commands: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Probabilities of a loss that 90 % of such logs have.

    Wilson's interval, for as many independent draws as the changes are worth: ticks of
    a Markov chain are correlated by a power of their distance.
    """
    gone, tick = _telling(lost, commands)
    begin, end = chances(lost)
    kept, near, together = max(1.0 - begin - end, 0.0), 0.0, 0.0
    for gap in np.diff(tick, prepend=-np.inf):
        near = 1.0 + kept**gap * near
        together += 2.0 * near - 1.0
    count = max(len(gone) ** 2 / max(together, 1.0), 1.0)
    share, z = float(gone.mean()) if len(gone) else 0.0, SURE**2 / count
    middle = (share + 0.5 * z) / (1.0 + z)
    half = np.sqrt(z * share * (1.0 - share) + 0.25 * z**2) / (1.0 + z)
    return float(middle - half), float(middle + half)


def _telling(
    lost: Sequence[np.ndarray], commands: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The largest changes of commands [N]: lost or not [C] bool, and ticks [C]."""
    changes = np.concatenate([np.abs(np.diff(command)) for command in commands])
    gone = np.concatenate([mask[1:] for mask in lost])
    tick = np.flatnonzero(changes > 1e-6)
    if not len(tick):
        return np.zeros(0, bool), tick
    largest = np.clip(1.0 - FEW / len(tick), 0.0, TOLD)
    tick = tick[changes[tick] >= np.quantile(changes[tick], largest)]
    return gone[tick], tick


def selective(lost: Sequence[np.ndarray], commands: Sequence[np.ndarray]) -> float:
    """How much rather the smaller half of a command's changes was lost, in deviations.

    On the way nobody looks at what gets lost, and small losses are rather overlooked. A
    joint that sticks ignores small changes.
    """
    changes = np.concatenate([np.abs(np.diff(command)) for command in commands])
    gone = np.concatenate([mask[1:] for mask in lost])[changes > 1e-6]
    changes = changes[changes > 1e-6]
    small = changes <= np.median(changes) if len(changes) else np.zeros(0, bool)
    if not (small.any() and (~small).any()):
        return 0.0
    mean = float(gone.mean())
    together = statistics(lost, commands)["burst"]  # a burst is one event
    spread = mean * (1.0 - mean) * together * (1.0 / small.sum() + 1.0 / (~small).sum())
    apart = float(gone[small].mean() - gone[~small].mean())
    return apart / float(np.sqrt(max(spread, 1e-12)))


def evenly(
    lost: Sequence[np.ndarray], commands: Sequence[np.ndarray], noise: float
) -> float:
    """Probability that losses on the way differ as much from run to run as these.

    What a fast motion alone loses was not lost on the way. Changes that show in the
    readings count (chi-square test of their shares; a burst is one event), and runs of
    which the test holds, in which so many are expected.

    Args:
        lost: decoded masks of each run [N].
        commands: of each run [N], rad.
        noise: of the joint's readings, rad.
    """
    shows = [np.abs(np.diff(command)) > SHOWN * noise for command in commands]
    gone = [mask[1:][rows] for mask, rows in zip(lost, shows, strict=True)]
    counts, hits = (np.array([f(each) for each in gone]) for f in (len, np.sum))
    mean = float(hits.sum() / max(counts.sum(), 1))
    kept = counts * mean >= EXPECTED
    if kept.sum() < 2:
        return 1.0
    counts, shares = counts[kept], hits[kept] / counts[kept]
    mean = float(counts @ shares / counts.sum())
    spread = mean * (1.0 - mean) * statistics(lost, commands)["burst"]
    apart = float(counts @ np.square(shares - mean)) / max(spread, 1e-12)
    return float(chi2.sf(apart, len(counts) - 1))


def _following(lost: Sequence[np.ndarray]) -> np.ndarray:
    """How often [2, 2] a tick of masks [N] follows another one; 1 is lost."""
    pairs = np.concatenate([2 * mask[:-1].astype(int) + mask[1:] for mask in lost])
    return np.bincount(pairs, minlength=4).reshape(2, 2)


def chances(lost: Sequence[np.ndarray]) -> beam.Chances:
    """Of losses in masks [N], never 0 or 1 (Laplace's rule)."""
    count = _following(lost)
    begun, ended = (count + 1.0) / (count.sum(1, keepdims=True) + 2.0)
    return beam.Chances(float(begun[1]), float(ended[0]))


def length(lost: Sequence[np.ndarray]) -> float:
    """Nats that it takes to write masks [N] down, as bursts."""
    return float(np.sum(_following(lost) * chances(lost).nats))
