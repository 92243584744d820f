"""`gatjax diagnose`: checked logs in, the verdict on the screen and in a folder."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gatjax.cli.arguments import Diagnose
from gatjax.cli.found import (
    closeness_lines,
    fallback_lines,
    gain_lines,
    named_lines,
    next_lines,
    unseen_lines,
)
from gatjax.cli.progress import shown
from gatjax.data import checks, sampling
from gatjax.data.mapping import JOINT_FAMILIES, ColumnMap, read_map
from gatjax.data.misread import mended
from gatjax.data.recording import (
    Recording,
    check_one_unit,
    check_recording,
    read_recording,
)
from gatjax.data.trajectories import check_logged
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.excerpt import shortened
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.measure import mean_period
from gatjax.diagnosis.start import Start, read_start
from gatjax.diagnosis.suitable import (
    cautions,
    check_commands,
    check_model,
    check_ranges,
)
from gatjax.diagnosis.tolerances import USUAL, Tolerances, check_joints, read_tolerances
from gatjax.loop.staged import staged
from gatjax.report.diagnosis import write_report
from gatjax.robot import model as robot_model
from gatjax.sim.limbs import floats

WRITTEN = ("extended.xml", "signals.parquet", "tolerances.json", "world.json")
FIRST = "signals.parquet"  # a diagnosis writes it before its other files
SAME_RATE = 1.005  # longest over shortest mean period of the files


def read_given(verb: Diagnose) -> tuple[Start, Logs, Tolerances]:
    """Read and check everything that a diagnosis takes.

    Raises:
        ValueError: one line with what cannot be trusted, and what to do.
        FileNotFoundError: a file is not there.
    """
    if not verb.data:
        raise ValueError("--data names no file; give at least one recording")
    allowed = USUAL if verb.tolerances is None else read_tolerances(verb.tolerances)
    start = _start(verb)
    model = start.model()
    check_model(model, Path(start.source))
    given = start.source, start.world_file, verb.tolerances
    _check_files(verb, [Path(file) for file in given if file is not None])
    joints = robot_model.joint_names(model)
    if verb.tolerances is not None:
        check_joints(allowed, joints, verb.tolerances)
    ranges = {
        joint: (float(low), float(high)) if limited else (-np.inf, np.inf)
        for joint, limited, (low, high) in zip(
            joints,
            model.jnt_limited[model.actuator_trnid[:, 0]],
            model.jnt_range[model.actuator_trnid[:, 0]],
            strict=True,
        )
    }
    mapping = None if verb.map is None else read_map(verb.map)
    fit, fit_found = _checked(verb.data, mapping, ranges, model, "fit")
    held, held_found = _checked(verb.held_out, mapping, ranges, model, "held-out")
    check_one_unit([*fit, *held], "diagnose files of one unit together")
    _check_rates([*fit, *held])
    shared = checks.same_data(fit, held)
    if shared is not None:
        raise ValueError(shared)
    told = checks.same_commands(fit, held)
    held_found = [[*a, *b] for a, b in zip(held_found, told, strict=True)]
    found = [*fit_found, *held_found]
    rows = checks.summary(list(zip([*fit, *held], found, strict=True)))
    model_rows = [
        {"file": start.source, "level": "warning", "check": "model", "text": text}
        for text in cautions(model)
    ]
    length = None if floats(model) else shortened(fit, len(joints))
    if length is not None:
        model_rows.append({"file": str(verb.data[0]), "level": "warning",
                           "check": "length", "text": length})  # fmt: skip
    return start, Logs(fit, held, [*model_rows, *rows]), allowed


def _start(verb: Diagnose) -> Start:
    """A model, or a world with what is known besides."""
    if (verb.model is None) == (verb.world is None):
        raise ValueError(
            "give either --model robot.xml, or --world world.json of an earlier "
            "diagnosis, to look for what that does not explain"
        )
    return Start(str(verb.model)) if verb.world is None else read_start(verb.world)


def _checked(
    paths: Sequence[Path],
    mapping: ColumnMap | None,
    ranges: dict[str, tuple[float, float]],
    model: mujoco.MjModel,
    role: checks.Role,
) -> tuple[list[Recording], list[list[checks.Finding]]]:
    """Recordings of one role with their findings; refused ones raise."""
    logs, before = [], []
    base = "floating" if floats(model) else "fixed"
    for path in paths:
        log, beside = _driven(read_recording(path, mapping), model)
        check_commands(model, log)
        check_recording(log, list(ranges))
        check_logged(log, robot_model.joint_names(model))
        stated = log.metadata.get("base", base)
        if stated != base:
            raise ValueError(
                f"{path}: metadata base is {stated}, but that of the model is {base}; "
                f"give the model of the robot as it was logged"
            )
        log, short = sampling.lasting(log)
        log, misread = mended(log)
        before.append([*beside, *short, *misread, *check_ranges(model, log)])
        logs.append(log)
    found = checks.trusted(logs, ranges, role)
    return logs, [[*a, *b] for a, b in zip(before, found, strict=True)]


def _driven(
    log: Recording, model: mujoco.MjModel
) -> tuple[Recording, list[checks.Finding]]:
    """A recording without the encoders of joints that nothing drives, as a tied one."""
    own = [model.joint(k).name for k in range(model.njnt)]
    free = set(own) - set(robot_model.joint_names(model))
    free = {joint for joint in free if f"command.{joint}" not in log.columns}
    kept = {name: values for name, values in log.columns.items()
            if name.partition(".")[2] not in free
            or name.partition(".")[0] not in JOINT_FAMILIES}  # fmt: skip
    gone = [name for name in log.columns if name not in kept]
    if not gone:
        return log, []
    text = f"{log.name}: {', '.join(gone)} not used: no actuator of the model is there"
    return log._replace(columns=kept), [checks.Finding("info", "undriven", text, {})]


def _check_files(verb: Diagnose, start: Sequence[Path]) -> None:
    """Refuse a file that would count double, or that this diagnosis writes."""
    for flag, paths in (("--data", verb.data), ("--held-out", verb.held_out)):
        seen: set[Path] = set()
        for path in paths:
            if path.resolve() in seen:
                raise ValueError(f"{path}: is named twice after {flag}; name it once")
            seen.add(path.resolve())
    for path in (*start, *verb.data, *verb.held_out):
        if path.parent.resolve() == verb.out.resolve() and path.name in WRITTEN:
            raise ValueError(
                f"{path}: --out {verb.out} would write over it; choose another folder"
            )
    for name in (*WRITTEN, "report.html"):
        if (verb.out / name).exists() and not (verb.out / FIRST).exists():
            raise ValueError(
                f"{verb.out / name} is not of a diagnosis, and would be written over; "
                f"choose another --out"
            )


def _check_rates(logs: Sequence[Recording]) -> None:
    """Refuse files of different rates: horizons and periods are those of all."""
    periods = [(_period(log), log.name) for log in logs]
    (least, fast), (most, slow) = min(periods), max(periods)
    if most > SAME_RATE * least:
        raise ValueError(
            f"{slow} has a row every {1e3 * most:.5g} ms, {fast} every "
            f"{1e3 * least:.5g} ms; diagnose files of one rate together"
        )


def _period(log: Recording) -> float:
    """Mean time from row to row of a trajectory, s; the file may mix several."""
    runs = np.unique(log.trajectory)
    return mean_period([log.time[log.trajectory == run] for run in runs])


def explain(verb: Diagnose, start: Start, logs: Logs, allowed: Tolerances) -> None:
    """Diagnose, write the folder and say what was found."""
    for row in logs.checks:
        if row["level"] == "warning":
            print(f"warning: {row['text']}", file=sys.stderr)
    with shown(1.0) as progress:
        tell = staged(progress)
        found = diagnose(start, logs, verb.out, verb.seed, tell, allowed)
    report = write_report(verb.out)
    print("\n".join(said(found, verb.out, report)))


def said(found: dict[str, Any], out: Path, report: Path) -> list[str]:
    """What a diagnosis prints: verdict, causes, gain, files."""
    return [
        found["sentence"],
        *(
            f"warning    {row['text']}"
            for row in found["data_checks"]
            if row["check"] in ("sensor", "contact")
        ),
        *named_lines(found["causes"]),
        *gain_lines(found["gain"], bool(found["files"]["held_out"])),
        *fallback_lines(found["fallback"], out),
        *unseen_lines(found),
        *next_lines(found["next_experiment"]),
        f"report     {report}",
        f"numbers    {out / 'diagnosis.json'}",
        f"simulation {out / 'world.json'}: {_use(found)}",
        *closeness_lines(out / "tolerances.json"),
        f"model      {out / 'extended.xml'}: what plain MJCF can say of it",
    ]


def _use(found: dict[str, Any]) -> str:
    """What the extended simulation is good for."""
    gain = found["gain"]
    if gain and gain["high"] < 0.0:
        return "worse on the held-out logs: a world to look at, not to learn in"
    if gain and not gain.get("promoted", True):
        return "what was found, as a world to look at; no gain is proven"
    return "use it as --world, as docs/files.md says"
