"""Robots that are wrong in several ways at all joints: what of it is found.

    python experiments/diagnosis/everywhere.py --out DIR --seed 61000 --cases 12

Each case is a robot of many joints with two to four causes at all of them, drawn from
CAUSES, and in half of the cases an encoder offset at one joint besides. A cause counts
where it is visible (d of 3 or more) at most joints, and is found where it is named with
a probability of 0.5 or more at most joints. Ctrl-C keeps what is solved, and
the same command goes on. It writes everywhere/SEED.json and prints a line a case.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.data.recording import write_recording
from gatjax.diagnosis.aliases import ALIASES
from gatjax.runs import read_json, write_json
from gatjax.surrogate.hidden import dart, design, rigid
from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.measure import Channels, channels, log_of, recording
from gatjax.surrogate.hidden.numbers import Specimen, draw
from gatjax.surrogate.hidden.robots import Robot, robot
from gatjax.surrogate.hidden.sight import rms
from gatjax.surrogate.hidden.targets import Lane

HERE = Path(__file__).parent
ROBOTS = ("leg_six", "quad_hung", "nao_hung")
MOTIONS = ("rich", "steps", "multisine")  # the last one is held out
ENGINES = {"rigid": rigid.simulate, "dart": dart.simulate}
VISIBLE = 3.0
REFUSED = 1  # exit code of logs that carry no diagnosis
LINE = 6  # robots of the production line, whose scatter is the unit of visibility

Size = Callable[[Robot, int, float], float]


def _plain(robot: Robot, joint: int, share: float) -> float:
    return share


def _gain(robot: Robot, joint: int, share: float) -> float:
    return share * float(robot.model.actuator_gainprm[joint, 0])


def _braking(robot: Robot, joint: int, share: float) -> float:
    own = robot.model.dof_damping[robot.velocity[joint]]
    return share * float(own - robot.model.actuator_biasprm[joint, 2])


def _limit(robot: Robot, joint: int, share: float) -> float:
    return share * float(robot.model.actuator_forcerange[joint, 1])


CAUSES: dict[str, tuple[float, float, Size, dict[str, Any]]] = {
    "command_delay": (0.01, 0.05, _plain, {}),
    "first_order_lag": (0.01, 0.05, _plain, {}),
    "coulomb_friction": (0.01, 0.05, _gain, {}),
    "viscous_friction": (0.3, 1.5, _braking, {}),
    "load_friction": (0.15, 0.5, _plain, {}),
    "gain_error": (0.3, 0.8, _plain, {}),
    "torque_limit": (0.1, 0.4, _limit, {}),
    "speed_limit": (1.0, 3.0, _plain, {"law": "target"}),
    "dead_band": (0.005, 0.03, _plain, {}),
    "backlash": (0.01, 0.04, _plain, {}),
}
"""Least and largest size of the scored parameter, log-uniform, and its unit."""


class Hidden(NamedTuple):
    """What one robot has."""

    machine: Robot
    engine: str
    rate: float
    sizes: dict[str, float]  # of causes at all joints, in the units of CAUSES
    odd: tuple[int, float] | None  # joint with an encoder offset, rad


def drawn(seed: int, index: int) -> Hidden:
    """What case `index` of a seed has."""
    rng = np.random.default_rng([seed, index])
    machine = robot(ROBOTS[index % len(ROBOTS)])
    names = rng.permutation(list(CAUSES))[: int(rng.integers(2, 5))]
    sizes = {
        str(name): float(np.exp(rng.uniform(*np.log(CAUSES[name][:2]))))
        for name in names
    }
    odd = int(rng.integers(len(machine.joints))), float(rng.uniform(0.03, 0.08))
    engine = "rigid" if machine.model.neq else str(rng.choice(list(ENGINES)))
    rate = float(rng.choice(design.RATES))
    return Hidden(machine, engine, rate, sizes, odd if rng.uniform() < 0.5 else None)


def specimen(case: Hidden, body: Specimen, without: str = "") -> Specimen:
    """A robot of the line with what a case hides, or with all but one cause of it."""
    for name, share in case.sizes.items():
        _, _, size, more = CAUSES[name]
        for joint in range(len(case.machine.joints) if name != without else 0):
            value = size(case.machine, joint, share)
            body = CATALOGUE[name].apply(body, case.machine, [joint], value, more)
    if case.odd is not None:
        joint, offset = case.odd
        effect = CATALOGUE["encoder_offset"]
        body = effect.apply(body, case.machine, [joint], offset, {"in_loop": False})
    return body


def made(folder: Path, seed: int, index: int) -> dict[str, Any]:
    """Simulate a case into a folder; what is true of it."""
    case = drawn(seed, index)
    machine = case.machine
    bodies = [
        Specimen(draw(machine, np.random.default_rng([seed, index, number, 1])))
        for number in range(LINE)
    ]
    logs = [
        design._log(machine, motion, case.rate, 4e-4, (seed, index, number))
        for number, motion in enumerate(MOTIONS)
    ]
    lanes = [Lane(specimen(case, bodies[0]), log) for log in logs]
    lanes += [Lane(specimen(case, bodies[0], name), logs[0]) for name in case.sizes]
    lanes += [Lane(body, logs[0]) for body in bodies]
    histories = ENGINES[case.engine](machine, lanes)
    shown = [channels(*pair) for pair in zip(lanes, histories, strict=True)]
    scatter = np.stack(shown[-LINE:]).std(axis=0, ddof=1)
    scatter = np.sqrt(np.square(scatter).mean(0))
    first = len(MOTIONS)
    seen = {
        name: float(np.median(rms(shown[0] - shown[first + n]) / scatter))
        for n, name in enumerate(case.sizes)
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.xml").write_text(machine.xml, encoding="utf-8")
    for name, lane, history in zip(
        ("fit_0", "fit_1", "held"), lanes, histories, strict=False
    ):
        log = log_of(machine, lane, history, Channels())
        write_recording(
            folder / f"{name}.parquet", recording(machine, [log], case.rate)
        )
    odd = None if case.odd is None else [machine.joints[case.odd[0]], case.odd[1]]
    return {
        "robot": machine.name, "engine": case.engine, "sizes": case.sizes,
        "visibility": seen, "offset": odd,
    }  # fmt: skip


def solved(folder: Path) -> dict[str, Any]:
    """Diagnose a case in a process of its own; its diagnosis.json, {} if refused."""
    files = [str(folder / f"{name}.parquet") for name in ("fit_0", "fit_1")]
    command = [sys.executable, "-m", "gatjax.cli", "diagnose"]
    command += ["--model", str(folder / "model.xml"), "--data", *files]
    command += ["--held-out", str(folder / "held.parquet")]
    with (folder / "log.txt").open("w") as log:
        done = subprocess.run(
            [*command, "--out", str(folder / "out")], stdout=log,
            stderr=subprocess.STDOUT,
        )  # fmt: skip
    if done.returncode == REFUSED:  # a joint that never moves, say
        return {}
    done.check_returncode()
    return read_json(folder / "out/diagnosis.json")


def _alike(name: str) -> frozenset[str]:
    return next((group for group in ALIASES if name in group), frozenset({name}))


def marked(truth: dict[str, Any], said: dict[str, Any], joints: int) -> dict[str, Any]:
    """What of the truth was named at most joints, and what else was."""
    if not said:
        return {"verdict": "refused"}
    where: dict[str, set[str]] = {}
    for row in said["causes"]:
        names = {f"{k}" for k in range(joints)} if row["where"] == ["all"] else set()
        if row["probability"] >= 0.5 and row["borne_out"] is not False:
            where.setdefault(row["cause"], set()).update(names or row["where"])
    common = {name for name, places in where.items() if len(places) > 0.5 * joints}
    visible = [n for n, d in truth["visibility"].items() if d >= VISIBLE]
    found = [name for name in visible if _alike(name) & common]
    wrong = [n for n in common if not any(n in _alike(t) for t in truth["sizes"])]
    local, odd = None, None
    if truth["offset"]:
        odd = truth["offset"][0]
        local = odd in where.get("encoder_offset", set())
    here = [
        f"{name} at {place}"
        for name, places in where.items()
        for place in places
        if name not in common and not any(name in _alike(t) for t in truth["sizes"])
        and (name, place) != ("encoder_offset", odd)
    ]  # fmt: skip
    gain = said["gain"]
    return {
        "verdict": said["verdict"], "visible": visible, "found": found,
        "not_there": wrong, "not_there_at": here, "offset_found": local,
        "before": gain["before"],
        "after": gain["after"], "noise": gain["noise_floor"],
        "learned": gain["learned_ceiling"], "unexplained": said["unexplained"]["where"],
        "seconds": said["seconds"],
    }  # fmt: skip


def main() -> None:
    """Make, diagnose and mark cases."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the cases")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=12)
    asked = parser.parse_args()
    marks, rows = HERE / "everywhere" / f"{asked.seed}.json", []
    marks.parent.mkdir(exist_ok=True)
    for index in range(asked.cases):
        folder = asked.out / f"e{asked.seed}_{index:04d}"
        kept = folder / "mark.json"
        if not kept.exists():
            began = time.monotonic()
            truth = made(folder, asked.seed, index)
            joints = len(robot(truth["robot"]).joints)
            row = {
                "case": folder.name,
                **truth,
                **marked(truth, solved(folder), joints),
            }
            write_json(kept, row | {"wall": round(time.monotonic() - began, 1)})
        row = read_json(kept)
        rows.append(row)
        write_json(marks, {"cases": rows})
        if row["verdict"] == "refused":
            print(f"{row['case']} {row['robot']:9s} refused", flush=True)
            continue
        wrong = ", ".join(row["not_there"] + row["not_there_at"])
        print(
            f"{row['case']} {row['robot']:9s} {row['verdict']:9s} "
            f"{len(row['found'])} of {len(row['visible'])} "
            f"({', '.join(row['visible'])}); not there: "
            f"{wrong or '-'}; offset {row['offset_found']}; "
            f"{np.degrees(row['before']):.2f} -> {np.degrees(row['after']):.3f} deg, "
            f"{row['seconds']:.0f} s", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main()
