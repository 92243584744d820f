"""What the verbs take that read logs and say what they tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True, kw_only=True)
class Diagnose:
    """Say what a simulation gets wrong: cause, joint, size, and how sure.

    gatjax diagnose --model arm.xml --data fit_1.parquet fit_2.parquet --held-out
    walk.parquet --out found

    takes a robot file whose joints are driven by position servos (or by motors, told
    torques or voltages), and logs of commands and positions (docs/files.md). It prints
    the verdict and writes found/report.html, diagnosis.json, world.json (a better
    simulation, for --world), tolerances.json (how close it comes) and extended.xml.
    Good logs are lively: gatjax collect --motion rich records one.
    """

    model: Path | None = None
    """Robot file (MJCF) to diagnose: its base fixed, or standing on its floor; or nao,
    nao_hung, which ship."""
    world: Path | None = None
    """world.json of an earlier diagnosis, instead of --model: what it knows of the
    robot is taken for known, and only what is wrong besides is named."""
    data: tuple[Path, ...]
    """Recordings to explain, .parquet or .csv; several after one --data."""
    held_out: tuple[Path, ...] = ()
    """Recordings of another motion: the gain is measured on them, and causes that do
    not predict them are doubted."""
    out: Path
    """Folder to write; a diagnosis in it is replaced."""
    map: Path | None = None
    """YAML map of the logs' column names, units and signs."""
    tolerances: Path | None = None
    """JSON of how far the model's numbers may be off, where that is not as usual, such
    as {"mass": 0.1, "angle": 0.01}: shares, and rad; docs/diagnosis.md lists all.
    tolerances.json of an earlier diagnosis beside its --world: what changed since."""
    seed: int = 0
    """Of all that is drawn: robots within the tolerances, intervals, the motion of the
    next experiment."""


@dataclass(frozen=True, kw_only=True)
class Import:
    """Turn logs as people have them into one recording, for every other verb.

    gatjax import walk.mcap --out walk.parquet

    reads MCAP and rosbag2 (JointState, JointTrajectory, Float64MultiArray, Imu),
    LeRobot datasets, BAM .json, SAGE folders, PACE .pt (no code in it is run), and
    .npz, .csv and .parquet tables. It prints what it found and writes walk.parquet, a
    picture of it, and walk.map.yaml: which signal was taken for which column, in which
    unit. Correct that and give it as --map. Commands hold until the next one; rows are
    those of the positions.
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """Files or folders of one robot; each run becomes a trajectory of its own."""
    out: Path
    """Parquet or CSV file to write."""
    map: Path | None = None
    """YAML map of the signals' names, units, signs and offsets."""


@dataclass(frozen=True, kw_only=True)
class BenchDiagnose:
    """Diagnose robots with hidden effects, and score the answers.

    gatjax bench diagnose --cases 40 --seed 7 --out blind

    makes 40 cases, runs gatjax diagnose on each as from outside, and prints how often
    cause and joint are right, with 95 % intervals. Ctrl-C keeps what is diagnosed; the
    same command goes on. blind/ gets scores.md, scores.json, confusion.png and
    detection.png.
    """

    out: Path
    """Folder for cases, diagnoses and scores."""
    cases: int | None = None
    """How many cases to make, 20 if left out; of a --folder the first so many."""
    folder: Path | None = None
    """Take the cases of a folder with answers.json instead of making some."""
    seed: int = 0
    """Of the cases to make, and of each diagnosis."""
    robots: tuple[str, ...] = ()
    """Robots that take turns; all with a fixed base if left out."""
    kinds: tuple[Literal["single", "null", "pair", "outside"], ...] = ()
    """Kinds of cases; all if left out."""
    causes: tuple[str, ...] = ()
    """Causes of the singles and pairs to make; the whole catalogue if left out."""
    least_visibility: float = 0.8
    """Least visibility d that the made effects aim at; from 3 on they are plain."""
    jobs: int = 2
    """Diagnoses at a time."""
    baselines: bool = False
    """Also score simpler methods: the best single number, BIC, fitting everything."""
