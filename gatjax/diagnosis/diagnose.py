"""The whole diagnosis: logs in, a folder with the verdict out."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
from pyarrow import parquet

import gatjax
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, to_arrays
from gatjax.diagnosis import (
    experiment,
    extend,
    fallback,
    measure,
    mjcf,
    result,
    sensitivity,
)
from gatjax.diagnosis.case import Case, held, prepare
from gatjax.diagnosis.floor import channels, standing
from gatjax.diagnosis.floor.judge import StandingJudge
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.measure import Errors
from gatjax.diagnosis.suitable import check_replay
from gatjax.diagnosis.tolerances import USUAL, Tolerances
from gatjax.diagnosis.unexplained import conditions
from gatjax.diagnosis.unseen import borne_out
from gatjax.diagnosis.verdict import Verdict, conclude
from gatjax.grounding.network import Network
from gatjax.robot import model as robot_model
from gatjax.sim import world as worlds
from gatjax.sim.limbs import floats
from gatjax.sim.world import World
from gatjax.task import Task

Tell = Callable[[str, float], None]
RATES = (50.0, 250.0 / 3.0, 100.0)  # Hz, of control


def cut(recordings: list[Recording], joints: tuple[str, ...]) -> list[JointRun]:
    """Cut recordings into runs of the model's joints."""
    return [run for recording in recordings for run in to_arrays(recording, joints)]


def control_period(runs: list[JointRun]) -> float:
    """Median period of the logs, s; that of whole Hz or of a usual rate if near."""
    period = float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
    whole = float(round(1.0 / period))
    if abs(whole * period - 1.0) < 0.001:
        return 1.0 / whole
    return next((1.0 / r for r in RATES if abs(r * period - 1.0) < 0.02), period)


def diagnose(
    source: str, fit: list[Recording], unfit: list[Recording], out: Path, seed: int,
    tell: Tell, allowed: Tolerances = USUAL,
) -> dict[str, Any]:  # fmt: skip
    """Show, name, extend and measure; write all of the folder but diagnosis.json.

    Nothing is written before everything is known but learned/, and an old
    diagnosis.json goes first: a folder that has one is whole.

    Args:
        source: model file (MJCF), or "nao".
        fit: recordings to explain.
        unfit: recordings that nothing is fitted to: they measure the gain, and causes
            that do not predict them are doubted; may be empty.
        out: folder for signals.parquet, world.json, extended.xml, and learned/ where a
            joint is not explained.
        seed: of everything that is drawn.
        tell: is called with a stage and the share of it that is done.
        allowed: how far the numbers of the model may be off.

    Returns:
        What diagnosis.json is to say, without `data_checks`.

    Raises:
        ValueError: one line: the model or the logs cannot carry a diagnosis.
    """
    began = time.monotonic()
    model = robot_model.load(source)
    joints = robot_model.joint_names(model)
    logs, unseen = cut(fit, joints), cut(unfit, joints)
    period = control_period(logs)
    nominal = worlds.nominal(Task(control_period=period), source, extend.TIMESTEP)
    pairs = {"nominal": _predicted(nominal, logs, unseen)}
    if not floats(model):
        played = [*pairs["nominal"][0], *pairs["nominal"][1]]
        check_replay(source, [*fit, *unfit], [*logs, *unseen], played)
    verdict = conclude(_judge(model, fit, logs, period, seed, tell, allowed))
    tell("extend", 0.0)
    world, pairs["extended"] = _extended(verdict, source, period, logs, unseen)
    out.mkdir(parents=True, exist_ok=True)
    tell("measure", 0.0)
    if unseen and not floats(model):
        series = {name: each[1] for name, each in pairs.items()}
        errors = measure.log_errors(unseen, series)
        verdict = borne_out(verdict, errors["nominal"], errors["extended"], seed)
    case = verdict.judge.case
    gain = _gain(nominal, world, logs, unseen, pairs, case, seed) if unfit else None
    tell("measure", 0.4)
    advice = experiment.propose(verdict, source, period, seed, out / "world.json")
    tell("measure", 0.6)
    (out / "diagnosis.json").unlink(missing_ok=True)
    fallback.withdraw(out)
    beside = [{} for _ in case.runs] if floats(model) else conditions(fit)
    lacks = verdict.verdict == "unknown" and not floats(model)
    learned = fallback.offer(out, world, logs, unseen, seed) if lacks else None
    tell("measure", 0.9)
    text = result.told(verdict, beside, seed) | {
        "gain": gain,
        "fallback": learned,
        "robot": fit[0].metadata.get("robot", model.names.split(b"\0")[0].decode()),
        "files": {"fit": [r.name for r in fit], "held_out": [r.name for r in unfit]},
        "not_expressible": mjcf.lacking(world),
        "smallest_effects": sensitivity.smallest(verdict.judge),
        "next_experiment": advice,
        "made_by": made_by(source, seed, allowed),
        "seconds": round(time.monotonic() - began, 1),
    }
    _write_signals(out / "signals.parquet", joints, logs, unseen, pairs, verdict)
    worlds.write_world(
        out / "world.json", world, {"verb": "diagnose", "seed": seed}, None
    )
    mjcf.write_model(out / "extended.xml", world)
    return text


def _judge(
    model: mujoco.MjModel, fit: list[Recording], logs: list[JointRun], period: float,
    seed: int, tell: Tell, allowed: Tolerances,
) -> Judge:  # fmt: skip
    """The judge of a case, tolerances fitted."""
    if not floats(model):
        return Judge(prepare(held(model, logs, seed, allowed), logs, tell), tell)
    felt = [run for recording in fit for run in channels.cut(recording)]
    base = standing.prepare(model, logs, felt, period, tell, seed, allowed)
    return StandingJudge(prepare(base, base.runs, tell), base, tell)


def made_by(source: str, seed: int, allowed: Tolerances) -> dict[str, Any]:
    """What a diagnosis was made with, as in diagnosis.json."""
    changed = {
        name: share
        for name, share in allowed._asdict().items()
        if share != getattr(USUAL, name)
    }
    return {
        "gatjax": gatjax.__version__, "model": source, "seed": seed,
        "tolerances": changed or "usual",
    }  # fmt: skip


def _extended(
    verdict: Verdict, source: str, period: float, logs: list[JointRun],
    unseen: list[JointRun],
) -> tuple[World, tuple[list, list]]:  # fmt: skip
    """The extended world and its predictions.

    The calibration is in it if that predicts the fit logs better.
    """
    tried = []
    for rows in ([], extend.calibration(verdict)):
        world = extend.extended(verdict, source, period, rows)
        predicted = _predicted(world, logs, unseen)
        tried.append((world, predicted))
    lost = [sum(np.isnan(rows).sum() for rows in each[0]) for _, each in tried]
    pair = {str(k): each[0] for k, (_, each) in enumerate(tried)}
    errors = measure.log_errors(logs, pair)
    size = [error.squared.sum() for error in errors.values()]
    return min(zip(lost, size, tried, strict=True), key=lambda row: row[:2])[2]


def _predicted(
    world: World, logs: list[JointRun], unseen: list[JointRun]
) -> tuple[list, list]:
    """Open-loop predictions of the fit and the held-out runs."""
    both = measure.whole_log(world, [*logs, *unseen])
    return both[: len(logs)], both[len(logs) :]


def _gain(
    nominal: World, world: World, logs: list[JointRun], unseen: list[JointRun],
    pairs: dict, case: Case, seed: int,
) -> dict[str, Any] | None:  # fmt: skip
    """Errors on the held-out runs, before and after, at all horizons."""
    forward, names = measure.learn(logs, seed), [joint.name for joint in case.joints]
    whole = measure.log_errors(
        unseen,
        {
            "before": pairs["nominal"][1], "after": pairs["extended"][1],
            "learned": measure.learned_log(forward, unseen),
        },
    )  # fmt: skip
    rows = sum(len(run.time) for run in unseen)
    compared = len(whole["before"].block) / rows
    if compared == 0.0:
        return None  # a robot fell at once
    horizons = _rows(None, whole, names, seed)
    if not floats(nominal.model):
        horizons += _ahead(nominal, world, unseen, forward, names, seed)
    first = horizons[0]
    learnable = first["before"] - first["learned"]
    return {
        "metric": "position rmse", "unit": "rad", **{
            key: first[key] for key in ("before", "after", "low", "high")
        },
        "noise_floor": float(np.sqrt(np.mean([j.noise**2 for j in case.joints]))),
        "learned_ceiling": first["learned"],
        "learned_share": (first["before"] - first["after"]) / learnable
        if learnable > 0.0 else None,
        "compared_share": compared,
        "promoted": bool(first["low"] > 0.0),
        "horizons": horizons,
    }  # fmt: skip


def _ahead(
    nominal: World, world: World, unseen: list[JointRun], forward: Network,
    joints: list[str], seed: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """Rows of the short horizons, which start from measured states."""
    period = nominal.task.control_period
    cut = measure.windows(unseen, period)
    if cut is None:
        return []
    played = {
        "before": measure.windowed(nominal, cut, period),
        "after": measure.windowed(world, cut, period),
        "learned": measure.learned_windows(forward, cut, period),
    }
    rows = []
    for horizon in measure.HORIZONS:
        errors = {
            name: measure.window_errors(cut, angles, horizon, period)
            for name, angles in played.items()
        }
        rows += _rows(horizon or period, errors, joints, seed)
    return rows


def _rows(
    horizon: float | None, errors: dict[str, Errors], joints: list[str], seed: int
) -> list[dict[str, Any]]:
    """Rows of one horizon: all joints together, then each."""
    rows = []
    for index, name in [(None, "all"), *enumerate(joints)]:
        low, high = measure.interval(errors["before"], errors["after"], index, seed)
        pick = slice(None) if index is None else index
        values = {
            key: float(np.sqrt(error.squared[:, pick].mean()))
            for key, error in errors.items()
        }
        rows.append(
            {"horizon_s": horizon, "joint": name, **values, "low": low, "high": high}
        )
    return rows


def _write_signals(
    path: Path, joints: tuple[str, ...], logs: list[JointRun], unseen: list[JointRun],
    pairs: dict, verdict: Verdict,
) -> None:  # fmt: skip
    """Write what the report draws: measured, nominal and extended, row by row."""
    runs = [*logs, *unseen]
    nominal = [*pairs["nominal"][0], *pairs["nominal"][1]]
    extended = [*pairs["extended"][0], *pairs["extended"][1]]
    columns: dict[str, np.ndarray] = {
        "time": np.concatenate([run.time for run in runs]),
        "trajectory": np.concatenate(
            [np.full(len(run.time), k) for k, run in enumerate(runs)]
        ),
        "part": np.concatenate(
            [np.full(len(run.time), int(k >= len(logs))) for k, run in enumerate(runs)]
        ),
    }
    case = verdict.judge.case
    for j, name in enumerate(joints):
        load = [
            np.interp(run.time - run.time[0], motion.time, weight.nominal.rest[:, j])
            for run, motion, weight in zip(
                case.runs, case.motions, case.loads, strict=True
            )
        ]
        load += [np.full(len(run.time), np.nan) for run in unseen]
        parts = {
            "command": [run.command[:, j] for run in runs],
            "measured": [run.angle[:, j] for run in runs],
            "nominal": [rows[:, j] for rows in nominal],
            "extended": [rows[:, j] for rows in extended],
            "load": load,
        }
        columns |= {f"{key}.{name}": np.concatenate(v) for key, v in parts.items()}
    parquet.write_table(pa.table(columns), path)
