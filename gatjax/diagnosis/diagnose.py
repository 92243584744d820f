"""The whole diagnosis: logs in, a folder with the verdict out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import gatjax
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import (
    closeness,
    experiment,
    extend,
    fallback,
    measure,
    mjcf,
    result,
    sensitivity,
)
from gatjax.diagnosis.drawn import drawn_errors
from gatjax.diagnosis.gain import Predicted, gained, half_second
from gatjax.diagnosis.given import Given, Logs, Tell, given, judged
from gatjax.diagnosis.logged import signals
from gatjax.diagnosis.signals import grip, odd_sensors, write_signals
from gatjax.diagnosis.simulated import as_close
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.suitable import check_replay
from gatjax.diagnosis.tolerances import USUAL, Tolerances
from gatjax.diagnosis.unexplained import conditions
from gatjax.diagnosis.unseen import Seen, borne_out
from gatjax.diagnosis.verdict import Verdict, conclude, doubted
from gatjax.robot import model as robot_model
from gatjax.runs import write_json
from gatjax.sim.compiled import on_cpu
from gatjax.sim.stored import carried, write_world
from gatjax.sim.world import World


@on_cpu()
def diagnose(
    start: Start, files: Logs, out: Path, seed: int, tell: Tell,
    allowed: Tolerances = USUAL,
) -> dict[str, Any]:  # fmt: skip
    """Show, name, extend and measure; write the folder.

    On the CPU: thousands of steps one after the other, of a joint and a few dozen
    hypotheses, keep no GPU busy (docs/diagnosis.md).

    Nothing is written before everything is known but a copy of the model and learned/;
    an old diagnosis.json goes first and the new one comes last: a folder that has one
    is whole.

    Args:
        start: the model, and what is known of the robot besides.
        files: what the robot did.
        out: folder for diagnosis.json, signals.parquet, world.json, extended.xml,
            tolerances.json (of a fixed base), and learned/ where a joint is not
            explained.
        seed: of everything that is drawn.
        tell: is called with a stage and the share of it that is done.
        allowed: how far the numbers of the model may be off.

    Returns:
        What diagnosis.json says.

    Raises:
        ValueError: one line: the model or the logs cannot carry a diagnosis.
    """
    began = time.monotonic()
    data = given(start, files, seed)
    made = {"nominal": start.world(data.period, extend.TIMESTEP)}
    pairs, near = {}, allowed
    if not data.floating:
        pairs["nominal"] = _checked(data, made["nominal"])
        near = as_close(data, allowed)
    verdict = conclude(judged(data, tell, near))
    tell("extend", 0.0)
    if data.floating:  # what it logged upright
        data = data._replace(logs=verdict.judge.case.runs)
        (pairs["nominal"],) = _predicted(data, [made["nominal"]])
    made["extended"], pairs["extended"], alone = _extended(
        verdict, data, made["nominal"]
    )
    if data.unseen and not data.floating:
        verdict = _borne_out(verdict, data, made, pairs)
    verdict = doubted(verdict)
    left = None
    if not data.floating:
        left = closeness.left(verdict, data, made["extended"], near)
    made["extended"] = carried(made["extended"], out)
    text = _told(data, verdict, made, pairs, alone, out, tell)
    write_signals(
        out / "signals.parquet", data.joints, data.logs, data.unseen, pairs, verdict
    )
    _write_extended(out, made["extended"], seed, left)
    text["made_by"] = _made_by(start, seed, allowed)
    text["seconds"] = round(time.monotonic() - began, 1)
    odd = odd_sensors(text["signals"], ", ".join(log.name for log in files.fit))
    text["data_checks"] = [*odd, *grip(made["extended"]), *files.checks]
    write_json(out / "diagnosis.json", text)
    return text


def _checked(data: Given, nominal: World) -> Predicted:
    """What the model predicts; refuses logs that it cannot have been moved by."""
    (predicted,) = _predicted(data, [nominal])
    servos = robot_model.servoed(data.model)
    parts = zip(data.files[:2], (data.logs, data.unseen), predicted.angles(),
                strict=True)  # fmt: skip
    for part, runs, angles in parts:
        check_replay(data.start.source, part, runs, angles, servos)
    return predicted


def _write_extended(
    out: Path, extended: World, seed: int, left: dict[str, Any] | None
) -> None:
    """Write the extended world, as MJCF too, and how close it comes where known."""
    write_world(out / "world.json", extended, {"verb": "diagnose", "seed": seed}, None)
    if left is not None:
        write_json(out / "tolerances.json", left)
    mjcf.write_model(out / "extended.xml", extended)


def _borne_out(
    verdict: Verdict, data: Given, made: dict[str, World], pairs: dict[str, Predicted]
) -> Verdict:
    """The verdict, its causes doubted where they do not predict held-out logs."""
    series = {name: each.angles()[1] for name, each in pairs.items()}
    errors = measure.log_errors(data.unseen, series)
    seen = Seen(
        (errors["nominal"], errors["extended"]),
        cache(lambda: half_second(made["nominal"], made["extended"], data.unseen)),
        drawn_errors(verdict.judge, data.unseen),
    )
    return borne_out(verdict, seen)


def _told(
    data: Given, verdict: Verdict, made: dict[str, World],
    pairs: dict[str, Predicted], alone: Predicted | None, out: Path, tell: Tell,
) -> dict[str, Any]:  # fmt: skip
    """What diagnosis.json says; the folder holds learned/ then, and no old verdict."""
    tell("measure", 0.0)
    case, seed = verdict.judge.case, data.seed
    gain = None
    if data.unseen:
        gain = gained(made, pairs, alone, data.whole, data.unseen, case, seed)
    tell("measure", 0.4)
    advice = experiment.propose(
        verdict, data.start, data.period, seed, out / "world.json"
    )
    tell("measure", 0.6)
    beside = [{} for _ in case.runs] if data.floating else conditions(data.files.fit)
    logs = [log.name for log in data.files.fit for _ in np.unique(log.trajectory)]
    said = result.told(verdict, logs, data.whole, beside, seed)
    if not data.floating:
        played = {name: each.fit for name, each in pairs.items()}
        said["signals"] = signals(played, data.files.fit, data.joints)
    out.mkdir(parents=True, exist_ok=True)
    for name in ("report.html", "diagnosis.json", "tolerances.json"):
        (out / name).unlink(missing_ok=True)
    fallback.withdraw(out)
    lacks, learned = bool(verdict.unexplained) and not data.floating, None
    angles = robot_model.servoed(data.model)
    if lacks and angles and not any(run.stiffness is not None for run in data.logs):
        learned = fallback.offer(out, made["extended"], data.logs, data.unseen, seed)
    tell("measure", 0.9)
    fit, unfit = ([log.name for log in logs] for logs in data.files[:2])
    name = data.model.names.split(b"\0")[0].decode()
    first = data.files.fit[0]
    return said | {
        "gain": gain,
        "fallback": learned,
        "robot": first.metadata.get("robot", name),
        "command_unit": first.command_unit,
        "files": {"fit": fit, "held_out": unfit},
        "not_expressible": mjcf.lacking(made["extended"]),
        "smallest_effects": sensitivity.smallest(verdict.judge),
        "next_experiment": advice,
    }


def _made_by(start: Start, seed: int, allowed: Tolerances) -> dict[str, Any]:
    """What a diagnosis was made with, as in diagnosis.json."""
    changed = {
        name: share
        for name, share in allowed._asdict().items()
        if share != getattr(USUAL, name)
    }
    return {
        "gatjax": gatjax.__version__, "model": start.source, "seed": seed,
        "tolerances": changed or "usual", "world": start.world_file,
    }  # fmt: skip


def _extended(
    verdict: Verdict, data: Given, start: World
) -> tuple[World, Predicted, Predicted | None]:
    """The extended world, made of the one at the start, and its predictions.

    The third are the predictions of its causes alone, where it has a calibration too.

    The calibration is in it if that predicts the fit logs better. Worlds with it and
    with neutral numbers in its place are of one structure: one batch plays both.
    """
    rows = extend.calibration(verdict)
    tried = [
        extend.extended(verdict, start, some)
        for some in ((extend.neutral(rows), rows) if rows else ([],))
    ]
    told = _predicted(data, tried)
    pair = {
        str(k): _counted(verdict, data.logs, each.angles()[0])
        for k, each in enumerate(told)
    }
    lost = [sum(np.isnan(angles).sum() for angles in fit) for fit in pair.values()]
    errors = measure.log_errors(data.logs, pair)
    size = [error.squared.sum() for error in errors.values()]
    best = min(range(len(tried)), key=lambda k: (lost[k], size[k]))
    if best == 0 and rows:
        return extend.extended(verdict, start, []), told[0], None
    return tried[best], told[best], told[0] if best and verdict.causes else None


def _counted(
    verdict: Verdict, logs: list[JointRun], angles: list[np.ndarray]
) -> list[np.ndarray]:
    """Predictions [N, J] of runs, as measured where a joint's run is left aside."""
    out = [each.copy() for each in angles]
    for joint, runs in verdict.judge.case.aside.items():
        for run in runs:
            out[run][:, joint] = logs[run].angle[:, joint]
    return out


def _predicted(data: Given, worlds: Sequence[World]) -> list[Predicted]:
    """Open-loop predictions by worlds of one structure."""
    runs = [*data.logs, *data.unseen]
    values = [world.values for world in worlds for _ in runs]
    played = measure.replayed(worlds[0], runs * len(worlds), values)
    parts = [played[k : k + len(runs)] for k in range(0, len(played), len(runs))]
    fit = len(data.logs)
    return [Predicted(part[:fit], part[fit:]) for part in parts]
