"""Claims that commands got lost on the way to a joint, or to all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.diagnosis import drops, patterns
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.case import mapped
from gatjax.diagnosis.claims import PLACE, WORTH, Claim
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.known import Known
from gatjax.diagnosis.outage import outage
from gatjax.diagnosis.pruning import pruned

NOISY = 1.7  # times the noise that the best cause leaves: commands may be lost
MOST = 0.6  # share of joints that lost commands, from which all may have


def claims(judge: Known, missing: Sequence[int]) -> list[Claim]:
    """Claims that commands got lost, beside what is known.

    Args:
        judge: what is known; it keeps what is found.
        missing: joints that changed since losses were looked for.
    """
    left = {k: judge.best(k).rms() for k in missing}
    noisy = [
        k for k in missing
        if left[k] > NOISY * judge.joints[k].noise
        and _decodable(judge, k, judge.known[k])
    ]  # fmt: skip
    judge.losses = {k: v for k, v in judge.losses.items() if k not in missing}
    found = mapped(
        lambda k: _decoded(judge, k, left[k]), noisy, lambda s: judge.tell("losses", s)
    )
    judge.losses |= dict(zip(noisy, found, strict=True))
    out = [claim for claim in judge.losses.values() if claim is not None]
    good = [claim for claim in out if claim.lost and claim.gain > WORTH]
    whole = joined(good, len(judge.joints))
    return out if whole is None else [*out, whole]


def second(
    judge: Known, index: int, joint: Joint, first: Fit
) -> tuple[float, Fit] | None:
    """Nats over what is known, and fit, of losses at a joint beside another cause.

    None where they do not explain all but noise.
    """
    if not _decodable(judge, index, first):
        return None
    free, commands = joint.drawn(0.0), judge.case.commands(index)
    found = drops.heated(free, first, commands)
    if found.fit.rms() > drops.DECODED * joint.noise:
        return None
    nats = judge.score(index, found.fit, found.joint) - found.price - PLACE
    return nats, found.fit


def _decodable(judge: Known, index: int, known: Fit) -> bool:
    """Whether losses can be looked for at a joint beside a fit, and are not told yet.

    A gear is not simulated there, and without a servo nothing keeps two open loops
    together.
    """
    joint = judge.joints[index]
    told = any(index in (claim.lost or {}) for claim in judge.accepted)
    return joint.servoed and not (told or known.geared or joint.assumed.geared)


def joined(claims: Sequence[Claim], joints: int) -> Claim | None:
    """One claim that commands to all joints got lost, if most of them lost some.

    Args:
        claims: about joints that lost commands, one each.
        joints: of the robot.
    """
    if len(claims) < 2 or len(claims) <= MOST * joints:
        return None
    return _summed(claims, tuple(range(joints)))


def _summed(claims: Sequence[Claim], where: tuple[int, ...]) -> Claim:
    """Claims about joints that lost commands as one of some place."""
    fitted: dict[int, Fit] = {}
    lost: dict[int, list[np.ndarray]] = {}
    for claim in claims:
        fitted |= claim.fits
        lost |= claim.lost or {}
    gain = sum(claim.gain + PLACE for claim in claims) - PLACE
    whole = Claim(drops.LOST, np.zeros(0), where, fitted, gain)
    return whole._replace(lost=lost, coded=sum(claim.coded for claim in claims))


def together(judge: Known, claims: Sequence[Claim]) -> Claim | None:
    """One claim about the joints of several that lost commands, if they are alike.

    They are of all joints if most lost some, else of theirs if one share suits each.
    """
    whole = joined(claims, len(judge.joints))
    if whole is not None or len(claims) < 2:
        return whole
    rows = [(k, masks) for each in claims for k, masks in (each.lost or {}).items()]
    least, most = zip(
        *(patterns.within(masks, judge.case.commands(k)) for k, masks in rows),
        strict=True,
    )
    if max(least) > min(most):
        return None
    places = tuple(sorted(k for k, _ in rows))
    return _summed(claims, places)


def _decoded(judge: Known, index: int, rival: float) -> Claim | None:
    """A claim that a joint lost commands, or its power; not drawn.

    `rival` is what the best other explanation leaves, rad.
    """
    joint, known = judge.joints[index], judge.known[index]
    begin = known
    if index in judge.case.pulled:  # followed freely, it tells less of its numbers
        joint, rival = joint.drawn(0.0), np.inf
        first = fits.start(joint, [(known.hypothesis, known.x)])
        known = fits.improve(joint, first, 6)[0]
    commands = judge.case.commands(index)
    loss = drops.find(joint, begin, commands, rival)
    if loss.fit.rms() < drops.DECODED * joint.noise:
        loss = pruned(loss, joint, commands)
    unpowered = outage(joint, known, commands, loss)

    def claim(found: drops.Losses) -> Claim:
        gain = fits.evidence(found.joint, found.fit) - fits.evidence(joint, known)
        gain -= found.price + PLACE
        owner = found.fit.hypothesis
        assert owner is not None
        alone = Claim(owner.newest, np.zeros(0), (index,), {index: found.fit}, gain)
        return alone._replace(coded=found.price)

    heard = np.flatnonzero(joint.valid.any(1))  # not left aside
    told = [loss.lost[run] for run in heard], [commands[run] for run in heard]
    even = patterns.evenly(*told, joint.noise) > patterns.UNLIKELY
    random = even and patterns.selective(*told) < patterns.SELECTIVE
    right = [
        claim(found)._replace(lost={index: loss.lost} if found is loss else None)
        for found in (loss if random else None, unpowered)
        if found is not None and found.fit.rms() < drops.DECODED * joint.noise
    ]
    return max(right, key=lambda claim: claim.gain, default=None)
