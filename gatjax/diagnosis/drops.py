"""Lost commands: which targets of a log never reached the servo.

A target that is lost leaves the one before it in force. Patterns of losses are found by
a beam search through the simulation, in turns with a fit of the tolerances; a pattern
costs what it takes to write it down (minimum description length, Rissanen 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from gatjax.data.trajectories import stretches
from gatjax.diagnosis import beam
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined
from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.motion import cells

FREQUENT = beam.Chances(0.27, 0.73)  # that a search begins with
BEGINS, ENDS = (0.01, 0.6), (0.1, 0.9)  # least and largest chance while it goes on
ODDS = 4.5  # nats of naming one tick, whatever else is known of it
TOLD = 0.75  # quantile of the changes of a command beyond which a loss is seen
FEW = 60  # changes: of fewer a share tells little, and smaller ones count too
SURE = 1.645  # deviations of a normal variable that hold 90 %
ROUNDS, ADVANCE = 12, 3  # of search and fit; iterations of a fit
FIRST = 8.0  # times the noise that a right pattern may leave at first
SHARPER = 0.7  # of what a pattern left: what the next one may leave
BETTER, PATIENCE = 0.97, 3  # of the best residual: rounds that may leave more
DONE = 1.2  # times the noise: no better pattern is looked for
DECODED = 1.7  # times the noise at most, that decoded losses leave
NEAR = 6.0  # times the noise that a first search leaves: other starts may do better
PROMISING = 0.5  # the same, of what another explanation leaves
HOTTER = (1.5, 3.0, 1.5)  # times what a pattern left: what the next one may leave again
SCOUTS, SPREAD = 6, 1.5  # starts beside the nominal one; tolerances of theirs
SCOUTING, FOLLOWED = 3, 4  # rounds of a scout; the best that are followed
SELECTIVE = 3.0  # deviations: small changes are lost more often than by chance
SHOWN = 4.0  # times the noise: a change that cannot be overlooked
EXPECTED = 5.0  # losses of a run at least, for the chi-square test (Cochran 1954)
UNLIKELY = 1e-3  # probability of losses that differ so much from run to run


class Losses(NamedTuple):
    """Decoded losses of a joint, and the joint that suffers them."""

    lost: list[np.ndarray]  # per run [N] bool
    joint: Joint
    fit: Fit
    price: float  # nats of naming the lost ticks


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


def price(
    joint: Joint, commands: list[np.ndarray], lost: Sequence[np.ndarray]
) -> float:
    """Nats of naming lost ticks, as readings count that are not independent."""
    return length(lost) * period(joint, commands) / fits.lasts(joint)


def held(command: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Targets in force [N] when some of them are lost."""
    index = np.where(lost, 0, np.arange(len(command)))
    return command[np.maximum.accumulate(index)]


def find(
    joint: Joint, base: Fit, commands: list[np.ndarray], rival: float = np.inf
) -> Losses:
    """Decode the losses of a joint beside what is known about it.

    Args:
        joint: with the full commands.
        base: what is known, not of a gear; its tolerances imitate losses, and are
            fitted afresh.
        commands: of each run [N], rad.
        rival: what the best other explanation leaves, rad.
    """
    first = heated(joint, base, commands)
    near = min(NEAR * joint.noise, PROMISING * rival)
    if not DECODED * joint.noise < first.fit.rms() < near:
        return first
    draw = np.random.default_rng(joint.index)
    tried = [first]
    for _ in range(SCOUTS):
        x = np.append(draw.normal(scale=SPREAD, size=COUNT), base.x[COUNT:])
        tried.append(_turns(joint, base, commands, (x, FIRST * joint.noise), SCOUTING))
    tried.sort(key=lambda losses: losses.fit.rms())
    for losses in tried[:FOLLOWED]:
        state = losses.fit.x, SHARPER * losses.fit.rms()
        tried.append(_turns(joint, base, commands, state, ROUNDS))
    return min(tried, key=lambda losses: losses.fit.rms())


def heated(joint: Joint, base: Fit, commands: list[np.ndarray]) -> Losses:
    """Decode losses from the numbers of a fit on, and again with more freedom if stuck.

    A pattern that may leave more than the one before it gets away from where search
    and fit bear each other out (simulated annealing, Kirkpatrick et al. 1983).
    """
    plain = fits.unspent(base.x), FIRST * joint.noise
    best = _turns(joint, base, commands, plain, ROUNDS)
    for more in HOTTER:
        left = best.fit.rms()
        if not DECODED * joint.noise < left < NEAR * joint.noise:
            break
        again = _turns(joint, base, commands, (best.fit.x, more * left), ROUNDS)
        best = min(best, again, key=lambda losses: losses.fit.rms())
    return best


def period(joint: Joint, commands: list[np.ndarray]) -> float:
    """Between two commands, s."""
    return float(np.median(np.diff(joint.time[0, : len(commands[0])])))


def _turns(
    joint: Joint,
    base: Fit,
    commands: list[np.ndarray],
    state: tuple[np.ndarray, float],
    rounds: int,
) -> Losses:
    """Search for a pattern and fit of the tolerances in turns; the best of the rounds.

    Args:
        joint: with the full commands.
        base: what is known.
        commands: of each run [N], rad.
        state: coordinates to start from, and what a right pattern may leave, rad.
        rounds: at most.
    """
    owner = combined(base.hypothesis, LOST)
    (x, noise), likely, best, worse = state, FREQUENT, None, 0
    for _ in range(rounds):
        lost = [
            beam.lost(joint, base.hypothesis, x, (run, command), noise, likely)
            for run, command in enumerate(commands)
        ]
        now = with_commands(joint, commands, lost)
        fit = fits.improve(now, fits.start(now, [(owner, x)]), ADVANCE)[0]
        worse += best is not None and fit.rms() > BETTER * best.fit.rms()
        if best is None or fit.rms() < best.fit.rms():
            best = Losses(lost, now, fit, price(joint, commands, lost))
        if worse == PATIENCE or fit.rms() < DONE * joint.noise:
            break
        x, noise = fit.x, max(fits.LEFT * joint.noise, SHARPER * fit.rms())
        begin, end = chances(lost)
        likely = beam.Chances(np.clip(begin, *BEGINS), np.clip(end, *ENDS))
    assert best is not None
    return best


def with_commands(
    joint: Joint, commands: list[np.ndarray], lost: list[np.ndarray]
) -> Joint:
    """The joint as it moves when some of its commands are lost."""
    given = [held(c, mask) for c, mask in zip(commands, lost, strict=True)]
    target = on_grid(joint, given)
    target[: joint.lead] = joint.grid.target[: joint.lead]
    return joint._replace(grid=joint.grid._replace(target=target))


def on_grid(joint: Joint, values: list[np.ndarray]) -> np.ndarray:
    """What is in force from each stamp on, per run [N]: on the grid [K, R]."""
    steps = joint.grid.target.shape[0]
    grid = (np.arange(steps) - joint.lead) * STEP
    series = [
        cells(joint.time[run, : len(v)], v[:, None], grid)[:, 0]
        for run, v in enumerate(values)
    ]
    return np.stack(series, 1).astype(np.float32)


LOST = Hypothesis(
    "dropped_commands", "", lambda drive, joint, x: None, (), (), (), (),
    lambda joint, x: {},
)  # fmt: skip
"""The losses are in the joint's commands: no coordinates of their own."""
