"""Hidden truths: real logs, and a description of the robot with one wrong fact.

A robot is diagnosed on some of its logs until nothing new is named; the simulation
that this gives is then told one thing wrong (a mass, a gain, shifted stamps, ...), or
nothing, and diagnosed on other logs. Right is who names that one thing first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import bam
import dfki
import mujoco
import numpy as np
from rounds import repeated

from gatjax.cli import main as gatjax
from gatjax.data.recording import Recording, read_recording, write_recording
from gatjax.diagnosis.aliases import ALIASES, ONE_JOINT
from gatjax.diagnosis.start import Start, read_start
from gatjax.runs import read_json, write_json
from gatjax.sim.world import write_world

HERE = Path(__file__).parent
Rows = tuple[dict[str, Any], ...]
Log = Callable[[Recording], Recording]


class Lie(NamedTuple):
    """A wrong fact, and the cause that is there because of it."""

    cause: str
    joint: str
    spec: Callable[[Any], None] = lambda spec: None  # changes the model
    log: Log = lambda log: log
    rows: Callable[[Rows], Rows] = lambda rows: rows  # changes what is known besides


class Robot(NamedTuple):
    """Logs that a lie is tried on, and the world that others of it gave."""

    name: str
    world: Path  # folder of the diagnosis
    logs: tuple[Path, ...]
    period: float  # s
    tolerances: Path | None = None


def shifted(joint: str, seconds: float) -> Log:
    """Commands that a log has earlier than they were sent."""

    def change(log: Recording) -> Recording:
        name = f"command.{joint}"
        sent = np.array(log.columns[name])
        for run in np.unique(log.trajectory):
            rows = log.trajectory == run
            time = log.time[rows]
            held = np.searchsorted(time, time + seconds + 1e-6, side="right") - 1
            sent[rows] = sent[rows][np.minimum(held, rows.sum() - 1)]
        return log._replace(columns=log.columns | {name: sent})

    return change


def read_as(joint: str, scale: float, offset: float) -> Log:
    """Positions as an encoder with a wrong scale and zero has them."""

    def change(log: Recording) -> Recording:
        name = f"position.{joint}"
        seen = scale * log.columns[name] + offset
        return log._replace(columns=log.columns | {name: seen})

    return change


def more(cause: str, joint: str, **values: float) -> Callable[[Rows], Rows]:
    """A correction of the model the wrong way."""
    row = {"cause": cause, "where": [joint], "values": values, "role": "calibration"}
    return lambda rows: (*rows, row)


def without(cause: str) -> Callable[[Rows], Rows]:
    """What is known, but for one cause."""

    def change(rows: Rows) -> Rows:
        return tuple(
            row for row in rows
            if row["cause"] != cause or row.get("role") == "calibration"
        )  # fmt: skip

    return change


def lighter(body: str, kg: float) -> Callable[[Any], None]:
    """A link that is heavier than its model by `kg`."""

    def change(spec: Any) -> None:
        spec.body(body).mass -= kg

    return change


def nearer(body: str, share: float) -> Callable[[Any], None]:
    """A link whose centre of mass is farther out than its model says."""

    def change(spec: Any) -> None:
        spec.body(body).ipos = np.asarray(spec.body(body).ipos) * (1.0 - share)

    return change


def tilted(pitch: float) -> Callable[[Any], None]:
    """A mounting that is turned about y."""

    def change(spec: Any) -> None:
        spec.option.gravity = 9.81 * np.array([np.sin(pitch), 0.0, -np.cos(pitch)])

    return change


def told(lie: Lie | None, robot: Robot, out: Path) -> list[str]:
    """Write a robot's world and logs with a lie; arguments of `gatjax diagnose`."""
    out.mkdir(parents=True, exist_ok=True)
    known, files = read_start(robot.world), []
    lie = Lie("", "") if lie is None else lie
    spec = mujoco.MjSpec.from_file(known.source)
    lie.spec(spec)
    spec.compile()
    (out / "model.xml").write_text(spec.to_xml())
    start = Start(str(out / "model.xml"), lie.rows(known.rows))
    write_world(out / "start.json", start.world(robot.period), {}, None)
    for log in robot.logs:
        files.append(str(out / log.name))
        write_recording(files[-1], lie.log(read_recording(log)))
    limits = ["--tolerances", str(robot.tolerances)] if robot.tolerances else []
    return ["--world", str(out / "start.json"), "--data", *files, *limits]


def right(lie: Lie | None, said: dict[str, Any], servoed: bool) -> bool:
    """Whether a diagnosis names the lie first, or nothing where there is none.

    The robots have one joint. An offset of what a servo sees, or of a motor that is
    told its torque, turns the load like a tilted mounting; one of the log does not.
    """
    named = said["causes"] if said["verdict"] in ("named", "ambiguous") else []
    if lie is None or not named:
        return lie is None and not named
    logged = servoed and lie.cause == "encoder_offset"
    classes = ALIASES if logged else (*ALIASES, ONE_JOINT)
    same = next((each for each in classes if lie.cause in each), {lie.cause})
    first = named[0]
    return first["cause"] in same and first["where"] in ([lie.joint], ["all"])


def tried(name: str, lie: Lie | None, robot: Robot, out: Path) -> dict[str, Any]:
    """Diagnose one case; what was said of it."""
    folder = out / name
    if not (folder / "said/diagnosis.json").is_file():
        given = told(lie, robot, folder)
        if code := gatjax(["diagnose", *given, "--out", str(folder / "said")]):
            return {"case": name, "truth": lie and lie.cause, "right": False,
                    "verdict": f"failed with {code}", "causes": []}  # fmt: skip
    said = read_json(folder / "said/diagnosis.json")
    return {
        "case": name, "truth": lie and lie.cause, "verdict": said["verdict"],
        "right": right(lie, said, said["command_unit"] == "rad"),
        "causes": [(row["cause"], row["where"]) for row in said["causes"]],
    }  # fmt: skip


def of_pendulum(joint: str, size: float) -> dict[str, Lie]:
    """Lies about one joint with a pendulum; `size` scales those of its drive."""
    lies = {
        f"offset {rad:+.2f}": Lie("encoder_offset", joint, log=read_as(joint, 1.0, rad))
        for rad in (0.1, -0.15)
    }
    lies |= {
        f"scale {scale}": Lie("encoder_scale", joint, log=read_as(joint, scale, 0.0))
        for scale in (1.1, 0.88)
    }
    lies |= {
        f"delay {late}": Lie("command_delay", joint, log=shifted(joint, late))
        for late in (0.03, 0.06)
    }
    lies |= {
        f"gain {told}": Lie(
            "gain_error", joint, rows=more("gain_error", joint, scale=told)
        )
        for told in (0.7, 1.4)
    }
    lies |= {
        f"lighter {kg}": Lie("payload", joint, spec=lighter("pendulum", kg))
        for kg in (0.12, 0.2)
    }
    lies["nearer"] = Lie("com_shift", joint, spec=nearer("pendulum", 0.25))
    lies["tilted"] = Lie("gravity_tilt", joint, spec=tilted(0.2))
    lies["less friction"] = Lie(
        "coulomb_friction", joint,
        rows=more("coulomb_friction", joint, torque=-size),
    )  # fmt: skip
    return lies


def halves(out: Path) -> Iterator[tuple[str, list[str], list[str], tuple[Path, ...]]]:
    """Every robot's name, its model, what it is diagnosed on first, and the rest."""
    source = out / "bam"
    source.mkdir(parents=True, exist_ok=True)
    logs = sorted((HERE / "data/bam").glob("*.parquet"))
    for log in logs:
        write_recording(source / log.name, bam.even(read_recording(log)))
    names = [log.name for log in logs]
    for words in (("kp100", "kp400"), ("sin_sin", "up_and_down")):
        parts = [[source / n for n in names if any(w in n for w in words) == this]
                 for this in (True, False)]  # fmt: skip
        for first, then in (parts, parts[::-1]):
            title = "bam_" + ("other_" if first is parts[1] else "") + words[0]
            yield (
                title,
                ["--model", str(bam.MODEL)],
                [*map(str, first)],
                tuple(then[::2]),
            )
    (out / "dfki").mkdir(exist_ok=True)
    swings = dfki.swung(dfki.LIGHT, out / "dfki")
    for first, then in (swings, swings[::-1]):
        model = ["--model", str(dfki.MODEL)]
        yield f"dfki_{Path(first).stem}", model, [first], (Path(then),)


def compared(out: Path) -> dict[str, Any]:
    """How often a lie is named, and nothing where there is none; all robots."""
    limits = out / "tolerances.json"
    out.mkdir(parents=True, exist_ok=True)
    write_json(limits, {"schema": bam.TOLERANCES["schema"],
                        "angle": bam.TOLERANCES["angle"]})  # fmt: skip
    rows = []
    for name, model, first, then in halves(out):
        servo = name.startswith("bam")
        given = ["--data", *first]
        if servo:
            wide = out / "wide.json"
            write_json(wide, bam.TOLERANCES)
            given += ["--tolerances", str(wide)]
        world = repeated(model, given, out / name / "known")[-1]
        period = bam.PERIOD if servo else 0.005
        robot = Robot(name, world, then, period, limits if servo else None)
        lies = of_pendulum("servo" if servo else "motor", 0.03 if servo else 0.15)
        for title, lie in ({"unaltered": None} | lies).items():
            rows.append(tried(title, lie, robot, out / name))
            write_json(out / "cases.json", rows)
    lied = [row for row in rows if row["truth"]]
    true = [row for row in rows if not row["truth"]]
    return {
        "cases": len(rows),
        "cause_right": sum(row["right"] for row in lied) / len(lied),
        "nothing_new": sum(row["right"] for row in true) / len(true),
        "rows": rows,
    }
