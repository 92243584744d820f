"""The next experiment: the safe motion that best separates two explanations."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.diagnosis import chance, extend
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.measure import fallen
from gatjax.diagnosis.motion import lead_of
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.verdict import Verdict
from gatjax.motions import MENU
from gatjax.settings import LAST, SIMULATOR_LOG, seeds
from gatjax.sim.limbs import floats, limbs_of, put_down
from gatjax.sim.replay import replay_many
from gatjax.sim.world import World, stacked

SECONDS = 14.0  # s, of every motion that is compared
LEAST, ENOUGH = 1.0, 3.0  # noise units: less separates nothing; more decides
DECIDED = 0.99  # probability from which another log can only confirm
RATES = 20.0, 1000.0  # Hz, least and largest, of motions and of `gatjax collect`
SETTLE = 1.0  # s at the first target


def leading(verdict: Verdict) -> list[Claim]:
    """The two explanations to separate: the least sure cause and its best other rival.

    What is named besides, there or at some of the places, is no rival.
    """
    if verdict.causes:
        least = min(verdict.causes, key=lambda cause: cause.probability)
        sure: dict[str, set] = {}
        for cause in verdict.causes:
            claim = cause.claim
            sure.setdefault(claim.hypothesis.cause, set()).update(claim.place())
        claims = [
            least.claim,
            *(
                claim for claim, _ in least.rivals
                if not set(claim.place()) <= sure.get(claim.hypothesis.cause, set())
            ),
        ]  # fmt: skip
    else:
        claims = [claim for claim in verdict.last if claim.gain > 0.0]
    named = [claim for claim in claims if claim.hypothesis.cause]
    if not named:
        return []
    best = named[0]
    others = [c for c in named[1:] if c.hypothesis.cause != best.hypothesis.cause]
    return [best, *others[:1]]


def told(verdict: Verdict, claim: Claim) -> list[Claim]:
    """A named claim with the others of its cause that have other values; else none."""
    mine = [cause for cause in verdict.causes if cause.claim is claim]
    return [
        cause.claim for cause in verdict.causes
        if mine and cause.rivals is mine[0].rivals
    ]  # fmt: skip


class Sides(NamedTuple):
    """Two worlds to compare."""

    first: list[Claim]
    second: list[Claim]
    names: tuple[str, str]  # of what they differ by


def sides(verdict: Verdict, claims: list[Claim]) -> Sides:
    """An explanation beside another one, or beside none.

    An explanation of most joints has the other causes of the robot beside it.
    """
    mine = told(verdict, claims[0]) or claims[:1]
    joints = len(verdict.judge.joints)
    whole = sum(len(claim.where) for claim in mine) > max(2, 0.5 * joints)
    beside = [
        cause.claim for cause in verdict.causes
        if whole and len(verdict.causes) > len(mine)
        and not any(cause.claim is claim for claim in mine)
    ]  # fmt: skip
    geared = any(claim.hypothesis.geared for claim in beside)
    others = [c for c in claims[1:] if not (geared and c.hypothesis.geared)]
    other = f"no {claims[0].hypothesis.cause}" if beside else "the nominal model"
    names = [claim.hypothesis.cause for claim in (claims[0], *others)] + [other]
    return Sides([*beside, *mine], [*beside, *others], (names[0], names[1]))


def propose(
    verdict: Verdict, start: Start, period: float, seed: int, world: Path
) -> dict[str, Any] | None:
    """Choose from the menu the motion that tells the two leading explanations apart.

    The separation is the RMS difference of the two predictions over all joints and
    rows, in standard deviations of the readings; without a second explanation, what the
    diagnosis started from takes its place.

    Args:
        verdict: of the diagnosis.
        start: of the diagnosis.
        period: control period, s.
        seed: of the diagnosis, which gives the motions theirs.
        world: world.json of the diagnosis, for the command that plays the motion.

    Returns:
        `next_experiment` of diagnosis.json; None where nothing is left to separate,
        where no servo follows a motion, or at a rate that no motion has.
    """
    claims = leading(verdict)
    if not claims or not all(joint.servoed for joint in verdict.judge.joints):
        return None
    if not RATES[0] <= 1.0 / period <= RATES[1]:
        return None
    first, second, names = sides(verdict, claims)
    named = [_world(verdict, each, start, period) for each in (first, second)]
    limbs = limbs_of(named[0].model)
    moving = np.zeros(len(limbs.names), bool)
    everything = (*claims, *told(verdict, claims[0]))
    moving[sorted({k for claim in everything for k in claim.where})] = True
    moving |= any(claim.stance is not None for claim in claims)
    lasts = {name: min(SECONDS, motion.seconds) for name, motion in MENU.items()}
    seed %= LAST + 1  # that `gatjax collect --seed` takes, which draws the same
    (drawn,) = seeds(SIMULATOR_LOG, seed, 1)
    targets = {
        name: MENU[name].build(limbs, moving, 1.0 / period, drawn, seconds=seconds)
        for name, seconds in lasts.items()
    }
    apart = _separations(named, list(targets.values()), verdict)
    separation, chosen = max(zip(apart, targets, strict=True))
    if separation < LEAST:
        return None
    joints = [n for n, m in zip(limbs.names, moving, strict=True) if m]
    words = [
        *("gatjax", "collect", "--motion", chosen, "--seconds", f"{lasts[chosen]:g}"),
        *(() if moving.all() else ("--joints", ",".join(joints))),
        *("--robot", "simulator", "--world", str(world), "--trajectories", "1"),
        *("--seed", str(seed), "--rate-hz", f"{1.0 / period:.6g}"),
        *("--out", f"{chosen}.parquet"),
    ]
    return {
        "motion": chosen,
        "separates": list(names),
        "joints": joints,
        "command": shlex.join(words),
        "separation": round(separation, 2),
        "why": _why(verdict, MENU[chosen].title, names, separation),
    }


def _why(
    verdict: Verdict, motion: str, pair: tuple[str, str], separation: float
) -> str:
    """What a motion is good for."""
    words = (
        f"{motion.capitalize()}: the predictions of "
        f"{' and '.join(pair).replace('_', ' ')} differ by {separation:.1f} times the "
        f"reading noise there, the most of all safe motions."
    )
    if separation < ENOUGH:
        return f"{words} That is hardly enough to decide."
    sure = verdict.verdict == "named" and not any(c.equivalent for c in verdict.causes)
    if sure and min(cause.probability for cause in verdict.causes) > DECIDED:
        return f"{words} The logs have decided that already; it would confirm it."
    return words


def _world(verdict: Verdict, claims: list[Claim], start: Start, period: float) -> World:
    """The world that a diagnosis starts from with some causes only."""
    return extend.claimed(verdict.judge, claims, start.world(period))


def _separations(
    pair: list[World], targets: list[np.ndarray], verdict: Verdict
) -> list[float]:
    """RMS difference of two worlds' readings in standard deviations of the noise.

    Of every motion; targets [T, J] rad may differ in length. A motion that one of them
    falls at separates nothing.
    """
    rest = max(SETTLE, lead_of(pair[0].model))
    lead = round(rest / pair[0].task.control_period)
    longest = max(len(target) for target in targets)
    commands = np.stack(
        [
            np.pad(target, ((lead, longest - len(target)), (0, 0)), mode="edge")
            for target in targets
        ]
    )
    noise = np.array([joint.noise for joint in verdict.judge.joints])
    played, falls = [], np.zeros(len(targets), bool)
    for world in pair:
        model, values = world.model, stacked([world.values] * len(targets))
        qpos = np.stack([put_down(model, target[0]) for target in targets])
        draw = chance.draws(world, commands.shape)[0]
        still = np.zeros(model.nv)
        rows = replay_many(world, values, commands, qpos, still, draw, lead=lead)
        played.append(np.asarray(rows.reading.angle)[:, lead:])
        if floats(model):
            falls |= fallen(np.asarray(rows.up)).any(-1)
    change = np.square((played[0] - played[1]) / noise)
    apart = [
        float(np.sqrt(one[: len(target)].mean()))
        for one, target in zip(change, targets, strict=True)
    ]
    stood = np.isfinite(apart) & ~falls
    return [one if ok else 0.0 for one, ok in zip(apart, stood, strict=True)]
