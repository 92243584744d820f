"""Bring logs that others measured into data/, as recordings.

    python experiments/real_data/carry.py FOLDER

FOLDER holds bam_pendulum, so101_sage and dfki_simple_pendulum with the files of
their repositories (README.md names the commits). This was done once; the recordings
are kept here, so that the experiment needs no network. Nothing is resampled.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
import yaml

from gatjax.cli import main as gatjax

DATA = Path(__file__).parent / "data"
MOTIONS = (  # of the SO-101
    "backlash_detection", "chirp_sweep", "figure_eight", "frequency_sweep",
    "friction_gravity", "large_amplitude", "multisine", "pick_place",
    "prbs_excitation", "static_holding", "step_response", "velocity_ramp",
)  # fmt: skip
RUNS = {  # of the DFKI pendulum: those whose commands are torques
    "energy_shaping": ("energy_shaping", ""),
    "energy_shaping_1kg": ("energy_shaping", "_1kg"),
    "sac": ("sac", ""),
}
JAW = {"scale": 1.919862, "offset": -0.174533}  # its range; the logs have 0 to 1
MAP = """
columns:
  time: {unit: s}
  command.motor: {from: told, unit: N m}
  position.motor: {from: position, unit: rad}
  velocity.motor: {from: velocity, unit: rad/s}
  torque.motor: {from: torque, unit: N m}
metadata: {robot: dfki_pendulum, base: fixed}
"""


def brought(source: Path, out: Path, names: str = "") -> str:
    """Write one recording, with a map or the draft of one; the draft."""
    with tempfile.TemporaryDirectory() as made:
        log, given = Path(made) / "log.parquet", Path(made) / "given.yaml"
        given.write_text(names)
        more = ["--map", str(given)] if names else []
        if gatjax(["import", str(source), "--out", str(log), *more]) != 0:
            raise SystemExit(f"{source} was not brought in")
        out.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(log, out)
        draft = log.with_suffix(".map.yaml")
        return draft.read_text() if draft.exists() else ""


def with_jaw(draft: str) -> str:
    """A draft of a map, with what the jaw of the SO-101 means by 0 to 1."""
    names = yaml.safe_load(draft)
    for kind in ("command", "position"):
        names["columns"][f"{kind}.Jaw"] |= JAW
    return yaml.safe_dump(names)


def table(folder: Path, end: str, out: Path) -> None:
    """What the pendulum was told and did, in one table.

    Both files have the stamps of one loop, within 25 ms; rows belong together.
    """
    told, done = (
        np.genfromtxt(folder / f"data_{kind}{end}.csv", delimiter=",", names=True)
        for kind in ("desired", "measured")
    )
    names = "time", "told", "position", "velocity", "torque"
    rows = [done["time"], told["torque"], *(done[name] for name in names[2:])]
    text = np.stack(rows, 1)[: 1 + int(np.flatnonzero(done["time"]).max())]
    np.savetxt(out, text, "%.9g", ",", header=",".join(names), comments="")


def main() -> None:
    """Bring in all of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of the original files")
    source = parser.parse_args().folder
    for file in sorted((source / "bam_pendulum" / "xl330").glob("*.json")):
        facts = json.loads(file.read_text())
        name = f"kp{facts['kp']}_{facts['trajectory']}.parquet"
        brought(file, DATA / "bam" / name)
    for motion in MOTIONS:
        folder, out = source / "so101_sage" / motion, DATA / "so101" / motion
        draft = brought(folder, out.with_suffix(".parquet"))
        brought(folder, out.with_suffix(".parquet"), with_jaw(draft))
    with tempfile.TemporaryDirectory() as made:
        csv = Path(made) / "run.csv"
        for run, (controller, end) in RUNS.items():
            folder = source / "dfki_simple_pendulum" / f"control_method_{controller}"
            table(folder, end, csv)
            brought(csv, DATA / "dfki" / f"{run}.parquet", MAP)


if __name__ == "__main__":
    main()
