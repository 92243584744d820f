"""Why candidates fall on `stiff`: one thing at a time made as in the simulator.

    python experiments/table1/falls.py DIR/stiff_0 DIR/stiff_1    # run folders

The candidates of generations 2 to 5 of a method walk again on the stand-in robot,
as it is and with one of its hidden constants changed. Each change is a process of its
own, since the robot's constants are fixed once it is built.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

from gatjax.runs import read_policy
from gatjax.surrogate import make_robot
from gatjax.surrogate.e1 import E1
from gatjax.task import Task

WALKS, FIRST_SEED = 6, 500
CHANGES = {
    "as it is": {},
    "grip": {"floor_friction": 1.0},
    "smooth floor": {"floor_roughness": 1e-5},
    "masses": {"mass_error": 0.0, "extra_mass": 0.0},
    "calibration": {"offset": 0.0},
    "foot sensors": {"force_gain": 0.0, "force_noise": 0.0},
    "start": {"start_angle": 0.0, "start_velocity": 0.0, "start_turn": 0.0},
    "torque limit out of reach": {"net_torque_pitch": 4.5, "net_torque_roll": 5.6},
}


def asked() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="run folders of run.py")
    parser.add_argument("--method", default="explained")
    parser.add_argument(
        "--change", choices=CHANGES, help="one of them, in this process"
    )
    return parser.parse_args()


def fallen(folders: list[Path], method: str, change: str) -> str:
    """Walk the candidates on a changed robot; say how many fell."""
    for name, value in CHANGES[change].items():
        object.__setattr__(E1, name, value)  # before anything is built of it
    files = [
        file for folder in folders for generation in range(2, 6)
        for file in sorted(folder.glob(f"policies/{method}_0_{generation}_*.json"))
    ]  # fmt: skip
    policies = np.repeat(np.stack([read_policy(file) for file in files]), WALKS, axis=0)
    seeds = [FIRST_SEED + number for number in range(WALKS)] * len(files)
    robot = make_robot("stiff", workers=1)  # other processes have E1 as it is
    _, outcome = robot.walk(policies, seeds, Task())
    fell = np.isfinite(outcome.fell_at).reshape(len(files), WALKS).sum(1)
    each = " ".join(map(str, fell))
    return f"{change:<26} {fell.sum()} of {len(seeds)} fall; by candidate {each}"


def main() -> None:
    """Print a line for each change."""
    told = asked()
    if told.change is not None:
        print(fallen(told.runs, told.method, told.change), flush=True)
        return
    for change in CHANGES:
        given = [*map(str, told.runs), "--method", told.method, "--change", change]
        subprocess.run([sys.executable, __file__, *given], check=True)


if __name__ == "__main__":
    main()
