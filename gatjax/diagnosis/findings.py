"""What a claim needs to be named, and what a joint needs to be explained."""

from __future__ import annotations

from collections.abc import Collection

from gatjax.diagnosis.claims import LATER, SEVERAL, Claim
from gatjax.diagnosis.coordinates import LESS
from gatjax.diagnosis.judge import Judge

TOLERABLE = 2.2  # times the reading noise: an explanation may leave that much
LEAST_SHARE = 0.4  # of the misfit power at its joints that a cause has to explain
SEEN = 0.3  # times the scatter from tolerances: a smaller change is not a cause
VISIBLE = 0.5  # the same beside another cause
DECISIVE = 100.0  # nats: what tolerances fail at so badly may be smaller than they
SECOND_SHARE = 0.8  # as LEAST_SHARE, where a joint is explained but for a little
AGAIN = 20.0  # nats of a further cause there, or where tolerances are enough
BORNE = 30.0  # the same of what bears a standing robot, whose contacts are drawn simply
DRAWN_SHARE = 0.7  # as LEAST_SHARE, of a further cause at a joint that is drawn
EXPECTED = 1.3  # misfit power of a right model, in squares of the reading noise
SPENT = 9.0  # squared deviations: tolerances that imitate a cause instead of a misfit
ROUGH = 3.5  # as TOLERABLE, with a named cause, whose law is a simplification
REST = 0.02  # share of the misfit power that an explanation may leave
DRAWN_REST = 0.15  # the same of a joint that is drawn to its measured motion


def worth_naming(judge: Judge, claim: Claim) -> bool:
    """Whether a claim is well supported, and larger than what tolerances do.

    What a large cause of one joint leaves there, a small share of what it explained, is
    more likely its own law drawn too simply than a second cause. A law without a name
    says little about a joint that tolerances explain, and so does a number that is less
    than nominal: nothing is there that was not, and of many joints some are far off.
    """
    nats, visible = needed(judge, claim.fits)
    little = not claim.hypothesis.cause or claim.hypothesis.variant == LESS
    if little and all(adequate(judge, k) for k in claim.fits):
        nats = max(nats, AGAIN)
    if claim.gain < nats:
        return False
    if len(claim.fits) > 1 and claim.stance is None and not whole(judge, claim):
        return False  # one value at several joints has to suit them
    share, joints = explained(judge, claim), set(claim.fits)
    own = {k for known in judge.accepted if len(known.fits) < SEVERAL
           for k in known.fits}  # fmt: skip
    if joints <= own & set(judge.case.pulled) and share < DRAWN_SHARE:
        return False  # what is drawn looks right to several laws
    done = joints <= own and all(adequate(judge, k) for k in joints)
    if done and share < SECOND_SHARE:
        return False
    beyond = claim.gain > DECISIVE and not all(adequate(judge, k) for k in joints)
    return (beyond and share >= LEAST_SHARE) or judge.visibility(claim) > visible


def needed(judge: Judge, joints: Collection[int]) -> tuple[float, float]:
    """Nats and visibility that a claim about joints needs beside what is known.

    Without joints it is about floor, soles or inertial unit, which explain all of them.
    """
    first = not any(judge.joints[k].assumed.named for k in joints)
    calm = all(adequate(judge, k) for k in joints)
    borne = calm and not judge.apart(joints)
    if first and not judge.accepted and joints and not borne:
        return judge.worth, SEEN
    visible = VISIBLE if judge.accepted else SEEN
    return (BORNE if borne else AGAIN if calm else LATER), visible


def whole(judge: Judge, claim: Claim) -> bool:
    """Whether a claim has a name and explains most of the misfit at its joints.

    Of three joints or more, one may have a cause of its own besides.
    """
    if not claim.hypothesis.cause:
        return False
    if explained(judge, claim) >= LEAST_SHARE:
        return True
    fits = claim.fits
    if len(fits) < SEVERAL:
        return False
    worst = max(fits, key=lambda k: fits[k].rms() / judge.joints[k].noise)
    rest = {k: fit for k, fit in fits.items() if k != worst}
    return explained(judge, claim._replace(fits=rest)) >= LEAST_SHARE


def explained(judge: Judge, claim: Claim) -> float:
    """Share of the misfit power beyond noise that a claim explains at its joints."""
    before = after = 0.0
    for index, fit in claim.fits.items():
        joint = judge.joints[index]
        before += (judge.known[index].rms() / joint.noise) ** 2 - EXPECTED
        after += (fit.rms() / joint.noise) ** 2 - EXPECTED
    spent = sum(judge.known[k].spent for k in claim.fits)
    calm = before < len(claim.fits) * EXPECTED and spent > len(claim.fits) * SPENT
    return 1.0 if calm else 1.0 - max(after, 0.0) / max(before, 1e-9)


def adequate(judge: Judge, index: int) -> bool:
    """Whether what is known about a joint leaves no more than a right model would."""
    joint, fit = judge.joints[index], judge.known[index]
    level = fit.rms() / joint.noise
    before = judge.case.healthy[index].rms() / joint.noise
    known = any(index in claim.fits for claim in judge.accepted)
    known |= bool(joint.assumed.named)
    if index in judge.case.pulled:  # it looks better than it is
        beyond = level**2 - EXPECTED
        enough = known and level < ROUGH and beyond < DRAWN_REST * before**2
    else:
        most = ROUGH if known else TOLERABLE
        enough = level < most or level**2 < REST * before**2
    return enough or judge.tolerates(index)
