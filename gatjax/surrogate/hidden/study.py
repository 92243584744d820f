"""Runs cases: finds the strengths, makes the truth and what an oracle reaches.

Stage one runs, on the most lively fit motion, the robot without effects, more robots of
its line (their scatter is the unit of visibility) and every rung of the ladders. Stage
two runs the robot with its effects on all motions. Cases of one robot share batches;
no case depends on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gatjax.surrogate.hidden import dart, rigid, single
from gatjax.surrogate.hidden.design import Case
from gatjax.surrogate.hidden.feet import BODY_COLUMNS
from gatjax.surrogate.hidden.measure import channels, log_of
from gatjax.surrogate.hidden.oracle import oracle
from gatjax.surrogate.hidden.plant import EVERY, History
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.sight import (
    Sight,
    first_lanes,
    look,
    rms,
    sane,
    settle,
    strength,
)
from gatjax.surrogate.hidden.targets import Lane

PLANTS = {"single": single.simulate, "rigid": rigid.simulate, "dart": dart.simulate}
TRIES = 3
MILDER = 0.4  # aim of the next try, where a robot fell or ran away


class Result(NamedTuple):
    """What came out of a case."""

    values: tuple[float, ...]  # of the scored parameters
    visibility: tuple[float, ...]  # per effect, largest over the channels
    where: tuple[float, ...]  # the same on the named joints only
    largest: tuple[str, ...]  # the channel with the largest
    fits: tuple[dict[str, np.ndarray], ...]  # columns of the recordings
    held: dict[str, np.ndarray]
    oracle: dict[str, float]
    measured: dict[str, float]  # lost_fraction, max_drop


def second_lanes(case: Case, values: Sequence[float]) -> list[Lane]:
    """What stage two runs: fits and held-out, the oracle on it, the bare robot."""
    truth, known = case.bare, case.ideal
    for effect, value in zip(case.effects, values, strict=True):
        truth = effect.on(truth, case.robot, value)
        known = effect.on(known, case.robot, value)
    lanes = [Lane(truth, log) for log in (*case.fits, case.held)]
    lanes.append(Lane(known, case.held))
    return [*lanes, *_without(case, values)]


def _without(case: Case, values: Sequence[float]) -> list[Lane]:
    """The robot without each of its effects in turn, on the first fit motion."""
    lanes = []
    for left_out in range(len(case.effects)):
        body = case.bare
        for number, effect in enumerate(case.effects):
            if number != left_out:
                body = effect.on(body, case.robot, values[number])
        lanes.append(Lane(body, case.fits[0]))
    return lanes


def conclude(
    case: Case,
    values: Sequence[float],
    sight: Sight,
    lanes: list[Lane],
    histories: list[History],
) -> Result:
    """Turns the runs of stage two into recordings and answers."""
    robot, fits = case.robot, len(case.fits)
    logs = [
        log_of(robot, lane, history, case.channels)
        for lane, history in zip(lanes[: fits + 1], histories[: fits + 1], strict=True)
    ]
    truth = channels(lanes[0], histories[0])
    seen = [
        rms(truth - channels(lane, history)) / sight.scatter
        for lane, history in zip(lanes[fits + 2 :], histories[fits + 2 :], strict=True)
    ]
    names = [*robot.joints, *BODY_COLUMNS]
    named = [effect.joints for effect in case.effects]
    return Result(
        values=tuple(values),
        visibility=tuple(float(d.max()) for d in seen),
        where=tuple(
            float(d[joints].max()) for d, joints in zip(seen, named, strict=True)
        ),
        largest=tuple(names[int(d.argmax())] for d in seen),
        fits=tuple(logs[:-1]),
        held=logs[-1],
        oracle=oracle(case, logs[-1], lanes[fits : fits + 2], histories[fits:][:2]),
        measured=_lost(lanes[:fits], histories),
    )


def _lost(lanes: Sequence[Lane], histories: Sequence[History]) -> dict[str, float]:
    """Shares of gain and torque limit lost in the fit motions, each to its own end.

    A history goes on as long as the longest one of its batch.
    """
    shares = [
        history.lost[: 1 + round(lane.seconds / EVERY)]
        for lane, history in zip(lanes, histories, strict=False)
    ]
    return {
        "lost_fraction": max(float(share[-1].max()) for share in shares),
        "max_drop": max(float(share.max()) for share in shares),
    }


def run(
    cases: Sequence[Case], done: Callable[[Case, Result], None] | None = None
) -> list[Result]:
    """Runs cases of one robot and one engine in common batches."""
    robot = cases[0].robot
    search = single.simulate if cases[0].engine == "single" else rigid.simulate
    plant = PLANTS[cases[0].engine]
    sights = _share([first_lanes(case) for case in cases], search, robot)
    settled = [settle(c, look(c, *pair)) for c, pair in zip(cases, sights, strict=True)]
    cases, looks = zip(*settled, strict=True)
    results: list[Result | None] = [None] * len(cases)
    open_cases = list(range(len(cases)))
    for attempt in range(TRIES):
        values = {
            index: [
                strength(effect.ladder, seen, effect.target * MILDER**attempt)
                for effect, seen in zip(
                    cases[index].effects, looks[index].rungs, strict=True
                )
            ]
            for index in open_cases
        }
        lanes = [second_lanes(cases[i], values[i]) for i in open_cases]
        pairs = _share(lanes, plant, robot)
        bad = []
        for index, (ran, histories) in zip(open_cases, pairs, strict=True):
            case, last = cases[index], attempt + 1 == TRIES
            fine = all(sane(case, *p) for p in zip(ran, histories, strict=True))
            if not fine and not last:
                bad.append(index)
                continue
            result = conclude(case, values[index], looks[index], ran, histories)
            results[index] = result
            if done:
                done(case, result)
        open_cases = bad
        if not open_cases:
            break
    return [result for result in results if result is not None]


def _share(
    lanes: list[list[Lane]],
    plant: Callable,
    robot: Robot,
) -> list[tuple[list[Lane], list[History]]]:
    """Runs the lanes of several cases in one batch and hands them back by case."""
    histories = plant(robot, [lane for group in lanes for lane in group])
    out, first = [], 0
    for group in lanes:
        out.append((group, histories[first : first + len(group)]))
        first += len(group)
    return out
