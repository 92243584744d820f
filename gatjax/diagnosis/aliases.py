"""Causes that count as one, because these logs cannot tell them apart."""

from __future__ import annotations

from collections.abc import Sequence

from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.hypotheses import Hypothesis

ALIASES = (
    frozenset({"command_delay", "measurement_delay"}),
    frozenset({"damping_error", "viscous_friction"}),
)
"""Causes that logs of powered joints cannot tell apart (docs/diagnosis.md)."""
ONE_JOINT = frozenset({"com_shift", "gravity_tilt", "encoder_offset"})
"""All three turn the load of a robot's only joint against what its servo sees."""
LOGGED = "log only"  # of an encoder offset: the servo does not see it
UPSIDE_DOWN = "upside down"  # of a tilt: farther than what is taken for one reaches
COVERED = {"payload": frozenset({"com_shift"})}  # it shifts the centre, too


def alias(hypothesis: Hypothesis, joints: int) -> frozenset[str]:
    """The causes that count as one with a hypothesis, itself included."""
    turns = joints == 1 and hypothesis.variant not in (LOGGED, UPSIDE_DOWN)
    for group in (*ALIASES, ONE_JOINT) if turns else ALIASES:
        if hypothesis.cause in group:
            return group
    return frozenset({hypothesis.cause})


def covered(hypothesis: Hypothesis, joints: int) -> frozenset[str]:
    """The causes that say nothing new beside a hypothesis: its aliases, and parts."""
    return alias(hypothesis, joints) | COVERED.get(hypothesis.cause, frozenset())


def again(claim: Claim, told: Sequence[Claim], joints: int) -> bool:
    """Whether a claim repeats a cause, or its alias, where it is known already."""
    return any(
        claim.hypothesis.cause in covered(known.hypothesis, joints)
        and set(claim.where) & set(known.where)
        for known in told
    )
