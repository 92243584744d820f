"""Hidden truths: real logs, and a description of the robot with one wrong fact.

A robot is diagnosed on some of its logs until nothing new is named; the simulation
that this gives is then told one thing wrong (a mass, a gain, shifted stamps, ...), or
nothing, and diagnosed on other logs, with the tolerances that were left: as close as it
came to logs that it was not made from (of the pendulum, which has two logs: to the one
that it was made from). Right is who names that one thing: first on a robot of one
joint, among others on an arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import bam
import dfki
import mujoco
import numpy as np
import so101
from lies import Lie, of_arm, of_pendulum, of_servo
from rounds import repeated

from gatjax.cli import main as gatjax
from gatjax.data.recording import read_recording, write_recording
from gatjax.diagnosis.aliases import ALIASES, ONE_JOINT, UPSIDE_DOWN
from gatjax.diagnosis.start import Start, read_start
from gatjax.runs import read_json, write_json
from gatjax.sim.stored import write_world

HERE = Path(__file__).parent
LEFT = float(np.deg2rad(0.25))  # rad, that what is known of the pendulum leaves


class Robot(NamedTuple):
    """A robot, what it is known from, and the logs that lies are tried on."""

    name: str
    model: Path
    first: tuple[str, ...]  # `gatjax diagnose` is given these until nothing is new
    logs: tuple[Path, ...]
    period: float  # s
    lies: dict[str, Lie | None]


def told(lie: Lie | None, robot: Robot, world: Path, out: Path) -> list[str]:
    """Write a robot's world and logs with a lie; arguments of `gatjax diagnose`."""
    out.mkdir(parents=True, exist_ok=True)
    known, files = read_start(world), []
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
    given = ["--data", *files, "--tolerances", str(world.parent / "tolerances.json")]
    return ["--world", str(out / "start.json"), *given]


def named(lie: Lie | None, said: dict[str, Any]) -> list[bool]:
    """Of each cause that a diagnosis names, whether it is the lie.

    On a robot of one joint an offset of what a servo sees, or of a motor that is told
    its torque, turns the load like a tilted mounting; one of the log does not.
    """
    rows = said["causes"] if said["verdict"] in ("named", "ambiguous") else []
    if lie is None:
        return [False for _ in rows]
    alone, servoed = len(said["joints"]) == 1, said["command_unit"] == "rad"
    over = lie.variant == UPSIDE_DOWN
    turned = alone and not over and not (servoed and lie.cause == "encoder_offset")
    classes = (*ALIASES, ONE_JOINT) if turned else ALIASES
    everywhere = [["all"]] if alone else []
    same = next((each for each in classes if lie.cause in each), {lie.cause})
    return [
        row["cause"] in same
        and row["where"] in ([lie.joint], *everywhere)
        and (row["variant"] == UPSIDE_DOWN) == over
        for row in rows
    ]


def right(lie: Lie | None, said: dict[str, Any]) -> bool:
    """Whether a diagnosis names the lie, or nothing where there is none.

    On a robot of one joint it has to be named first.
    """
    hits = named(lie, said)
    if lie is None:
        return not hits
    return any(hits[:1] if len(said["joints"]) == 1 else hits)


def tried(
    title: str, lie: Lie | None, robot: Robot, world: Path, out: Path
) -> dict[str, Any]:
    """Diagnose one case, beside what is known of the robot; what was said of it."""
    folder = out / robot.name / title
    row = {"robot": robot.name, "case": title, "truth": lie and lie.cause}
    if not (folder / "said/diagnosis.json").is_file():
        given = told(lie, robot, world, folder)
        if code := gatjax(["diagnose", *given, "--out", str(folder / "said")]):
            failed = {"verdict": f"failed with {code}", "right": False, "causes": [],
                      "besides": 0}  # fmt: skip
            return row | failed
    said = read_json(folder / "said/diagnosis.json")
    return row | {
        "verdict": said["verdict"], "right": right(lie, said),
        "besides": named(lie, said).count(False),
        "causes": [(row["cause"], row["where"]) for row in said["causes"]],
    }  # fmt: skip


def of_bam(out: Path) -> Iterator[Robot]:
    """The servo at four gains with four motions each, in four parts of a Latin square.

    Every part has all gains and all motions. It is known from two parts (each motion at
    two gains, one four times the other), how close that comes is measured on the third,
    and lies are told on the fourth.
    """
    source = out / "bam"
    source.mkdir(parents=True, exist_ok=True)
    logs = sorted((HERE / "data/bam").glob("*.parquet"))
    for log in logs:
        write_recording(source / log.name, bam.even(read_recording(log)))
    wide = source / "wide.json"
    write_json(wide, bam.TOLERANCES)
    lies = {"unaltered": None} | of_servo("servo", 7.4)
    files = [source / log.name for log in logs]  # by gain, then by motion
    parts = [[files[4 * gain + (gain + k) % 4] for gain in range(4)] for k in range(4)]
    for number in range(4):
        one, third, two, fourth = parts[number:] + parts[:number]
        given = ["--data", *map(str, (*one, *two)), "--held-out", *map(str, third)]
        first = (*given, "--tolerances", str(wide))
        yield Robot(f"bam_{number}", bam.MODEL, first, tuple(fourth), bam.PERIOD, lies)


def of_dfki(out: Path) -> Iterator[Robot]:
    """The pendulum, known from one of its runs and told lies on the other."""
    (out / "dfki").mkdir(parents=True, exist_ok=True)
    swings = tuple(map(Path, dfki.swung(dfki.LIGHT, out / "dfki")))
    limits = out / "dfki/tolerances.json"
    write_json(limits, dfki.USUAL | {"angle": LEFT, "friction": 0.1})
    lies = {"unaltered": None} | of_pendulum("motor", 0.15)
    for one, other in (swings, swings[::-1]):
        first = ("--data", str(one), "--tolerances", str(limits))
        title = f"dfki_{one.stem}"
        yield Robot(title, dfki.MODEL, first, (other,), 0.005, lies)


def of_so101(out: Path) -> Iterator[Robot]:
    """The arm, known from its fit motions, told lies on the others, and vice versa."""
    (out / "so101").mkdir(parents=True, exist_ok=True)
    files = []
    for names in ((*so101.HALVES[0], *so101.HALVES[1]), so101.HELD_OUT):
        files.append(tuple(out / f"so101/{name}.parquet" for name in names))
        for file, log in zip(files[-1], so101.logs(names), strict=True):
            write_recording(file, log)
    for number, (known, others) in enumerate((files, files[::-1])):
        given = ["--data", *map(str, known), "--held-out", *map(str, others[::2])]
        first = (*given, "--tolerances", str(so101.TOLERANCES))
        lies = {"unaltered": None} | ({} if number else of_arm())
        yield Robot(f"so101_{number}", so101.MODEL, first, others[1::2], 0.0201, lies)


def compared(out: Path) -> dict[str, Any]:
    """How often a lie is named, and nothing where there is none; all robots."""
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for robot in (*of_bam(out), *of_dfki(out), *of_so101(out)):
        model, known = ["--model", str(robot.model)], out / robot.name / "known"
        _, world = repeated(model, list(robot.first), known)
        for title, lie in robot.lies.items():
            rows.append(tried(title, lie, robot, world, out))
            write_json(out / "cases.json", {"cases": rows})
    lied = [row for row in rows if row["truth"]]
    true = [row for row in rows if not row["truth"]]
    return {
        "cases": len(rows),
        "cause_right": sum(row["right"] for row in lied) / len(lied),
        "wrong_causes_a_lie": sum(row["besides"] for row in lied) / len(lied),
        "nothing_new": sum(row["right"] for row in true) / len(true),
        "nothing_wrong": sum(row["verdict"] == "none" for row in true) / len(true),
        "rows": rows,
    }
