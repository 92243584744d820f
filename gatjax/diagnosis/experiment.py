"""The next experiment: the safe motion that best separates two explanations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gatjax.diagnosis import extend
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.measure import fallen
from gatjax.diagnosis.verdict import Verdict
from gatjax.motions import MENU
from gatjax.sim import world as worlds
from gatjax.sim.limbs import floats, limbs_of, put_down
from gatjax.sim.replay import replay_many
from gatjax.sim.world import World, stacked
from gatjax.task import Task

SECONDS = 14.0  # s, of every motion that is compared
SETTLE = 1.0  # s at the first target


def leading(verdict: Verdict) -> list[Claim]:
    """The two explanations to separate: the first cause and its best other rival."""
    if verdict.causes:
        first = verdict.causes[0]
        claims = [first.claim, *(claim for claim, _ in first.rivals)]
    else:
        claims = [claim for claim in verdict.last if claim.gain > 0.0]
    named = [claim for claim in claims if claim.hypothesis.cause]
    if not named:
        return []
    best = named[0]
    others = [c for c in named[1:] if c.hypothesis.cause != best.hypothesis.cause]
    return [best, *others[:1]]


def propose(
    verdict: Verdict, source: str | Path, period: float, seed: int
) -> dict[str, Any] | None:
    """Choose from the menu the motion that tells the two leading explanations apart.

    The separation is the RMS difference of the two predictions over all joints and
    rows, in standard deviations of the readings; without a second explanation, the
    nominal model takes its place.

    Args:
        verdict: of the diagnosis.
        source: model file.
        period: control period, s.
        seed: of the motions.
    """
    claims = leading(verdict)
    if not claims:
        return None
    named = [_world(verdict, [claim], source, period) for claim in claims]
    if len(named) == 1:
        named.append(_world(verdict, [], source, period))
    names = [claim.hypothesis.cause for claim in claims] + ["the nominal model"]
    limbs = limbs_of(named[0].model)
    moving = np.zeros(len(limbs.names), bool)
    moving[sorted({k for claim in claims for k in claim.where})] = True
    moving |= any(claim.stance is not None for claim in claims)
    best: tuple[float, str] = (-1.0, "")
    for motion in MENU.values():
        target = motion.build(
            limbs, moving, 1.0 / period, seed, seconds=min(SECONDS, motion.seconds)
        )
        apart = _separation(named, target, verdict)
        best = max(best, (apart, motion.name))
    separation, chosen = best
    return {
        "motion": chosen,
        "separates": names[:2],
        "joints": [n for n, m in zip(limbs.names, moving, strict=True) if m],
        "separation": round(separation, 2),
        "why": (
            f"{MENU[chosen].title}: the predictions of {names[0]} and {names[1]} "
            f"differ by {separation:.1f} times the reading noise there, the most of "
            f"all safe motions"
        ),
    }


def _world(
    verdict: Verdict, claims: list[Claim], source: str | Path, period: float
) -> World:
    """The nominal world with some causes only."""
    world = worlds.nominal(Task(control_period=period), source)
    for claim in claims:
        where = extend.places(verdict.judge, claim)
        values = extend.world_values(verdict.judge, claim)
        world = worlds.add_cause(world, claim.hypothesis.cause, where, values)
    return world


def _separation(pair: list[World], target: np.ndarray, verdict: Verdict) -> float:
    """RMS difference of two worlds' readings in standard deviations of the noise.

    A motion that one of them falls at separates nothing.
    """
    period = pair[0].task.control_period
    lead = round(SETTLE / period)
    commands = np.concatenate([np.repeat(target[:1], lead, 0), target])[None]
    noise = np.array([joint.noise for joint in verdict.judge.joints])
    played = []
    for world in pair:
        qpos = put_down(world.model, target[0])
        rows = replay_many(
            world, stacked([world.values]), commands, qpos, np.zeros(world.model.nv)
        )
        if floats(world.model) and fallen(np.asarray(rows.up)).any():
            return 0.0
        played.append(np.asarray(rows.reading.angle)[0, lead:])
    apart = np.sqrt(np.mean(np.square((played[0] - played[1]) / noise)))
    return float(apart) if np.isfinite(apart) else 0.0
