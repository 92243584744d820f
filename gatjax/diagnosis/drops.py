"""Lost commands: which targets of a log never reached the servo.

A target that is lost leaves the one before it in force. Patterns of losses are found by
a beam search through the simulation, in turns with a fit of the tolerances; a pattern
costs what it takes to write it down (minimum description length, Rissanen 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gatjax.diagnosis import beam, patterns
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis, combined
from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.motion import cells

FREQUENT = beam.Chances(0.27, 0.73)  # that a search begins with
BEGINS, ENDS = (0.01, 0.6), (0.1, 0.9)  # least and largest chance while it goes on
ODDS = 4.5  # nats of naming one tick, whatever else is known of it
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


class Losses(NamedTuple):
    """Decoded losses of a joint, and the joint that suffers them."""

    lost: list[np.ndarray]  # per run [N] bool
    joint: Joint
    fit: Fit
    price: float  # nats of naming the lost ticks


def price(
    joint: Joint, commands: list[np.ndarray], lost: Sequence[np.ndarray]
) -> float:
    """Nats of naming lost ticks, as readings count that are not independent."""
    return patterns.length(lost) * period(joint, commands) / fits.lasts(joint)


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
        begin, end = patterns.chances(lost)
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
