"""What each verb of the command line takes: one frozen dataclass a verb."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gatjax.motions import MENU
from gatjax.settings import DEMO, LoopSettings

ABOUT = (
    "Ground a robot simulator in logs of the robot, search for a better walk in it, "
    "and show whether the walk transfers. Start with: gatjax run. "
    "Every verb also takes --debug (tracebacks); gatjax --version prints the version."
)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Collect, ground, search, evaluate and report: the main job."""

    preset: Literal["demo", "paper"] = "demo"
    """demo: 2 cores, ten minutes. paper: 150 policies, 20 rollouts, 10 generations."""
    loop: tyro.conf.OmitArgPrefixes[LoopSettings] = field(default_factory=lambda: DEMO)
    out: Path = Path("runs")
    """Folder of run folders."""
    resume: bool = False
    """Go on with the latest run in `out`, with its own settings."""
    run: Path | None = None
    """With --resume: the run folder to go on with, instead of the latest."""
    typed: tyro.conf.Suppress[tuple[str, ...]] = ()
    """Settings named on the command line; a resumed run must have them already."""


MOTIONS = "\n".join(
    [
        "Play a motion instead of walking, for a diagnosis. The menu:",
        *(f"{each.name}: {each.title} ({each.seconds:g} s)" for each in MENU.values()),
        "Each starts and ends at rest at home and stays within limits and top speeds. "
        "A standing robot may still fall: leave --reach to its default at first. On a "
        "real robot, look for links that could hit each other: that is not checked.",
    ]
)


@dataclass(frozen=True, kw_only=True)
class Collect:
    """Record walks of a robot, or a motion with --motion, into one Parquet file.

    Walks: gatjax collect --out walks.parquet. A motion that tells causes apart: gatjax
    collect --motion rich --joints LKneePitch,RKneePitch --out knees.parquet
    """

    out: Path
    """Parquet or CSV file to write."""
    robot: str = "dart"
    """dart and stiff: stand-in NAOs on their feet; simulator: the robot of --world;
    lola: a NAO v6 (or gatjax nao), lola:SOCKET for another socket than /tmp/robocup;
    simspark, simspark-v4: the NAOs of rcssserver3d, :HOST:PORT:MONITORPORT after it.
    Between runs of a NAO somebody puts it back and presses the button on its chest."""
    motion: Annotated[str | None, tyro.conf.arg(help=MOTIONS)] = None
    hung: bool = False
    """With --motion: the robot hangs by its torso and moves its joints far; the model
    to diagnose such a log with is --model nao_hung."""
    joints: tuple[str, ...] = ()
    """With --motion: joints to move, with commas or spaces between; all if left out."""
    reach: float | None = None
    """With --motion: share of the way to the limits, up to 1; safe if left out."""
    seconds: float | None = None
    """With --motion: length of a run with its rests; the motion's own if left out."""
    trajectories: Annotated[int | None, tyro.conf.arg(aliases=("--runs",))] = None
    """Runs, each with random numbers of its own; by default 15 walks or 3 motions."""
    policy: Path | None = None
    """Policy JSON of the walk; the hand-tuned one (theta0) if left out."""
    world: Path | None = None
    """world.json, for --robot simulator."""
    body_seed: int = 0
    """Which robot of the series, for dart and stiff."""
    rate_hz: float = 50.0
    """Rows per second: 50, 100 or 83.3; any for a motion of the simulator."""
    seed: int = 0
    """0 to 9999."""


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
class Ground:
    """Learn a grounding from recordings of robot and simulator."""

    robot_log: Path
    """Recording of the robot."""
    simulator_log: Path
    """Recording of the simulator, same policy (gatjax collect --robot simulator)."""
    out: Path
    """Folder to write; its world.json is a simulation, for --world."""
    method: Literal[
        "envelope", "guided", "gat", "dagger", "sgat", "sensing", "rgat", "garat"
    ] = "gat"
    policy: Path | None = None
    """Policy of the recordings, for choosing alpha; theta0 if left out."""
    map: Path | None = None
    """YAML map of the robot log's column names, units and signs."""
    world: Path | None = None
    """world.json of the simulator to ground, without a grounding; ideal if left out."""
    rate_hz: float = 50.0
    """Control rate of the recordings: 50, 100 or 83.3."""
    seed: int = 0
    """Of all that is drawn and trained."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """Search for a faster walk in one world."""

    out: Path
    """Folder for policies and checkpoints; an existing search in it goes on."""
    world: Path | None = None
    """world.json; the ideal simulator if left out."""
    policy: Path | None = None
    """Policy to start from; theta0 if left out."""
    population: int = 40
    """Policies a generation."""
    rollouts: int = 4
    """Rollouts a policy."""
    generations: int = 8
    """How many; more of them later go on with the same search."""
    race: int = 0
    """Rollouts after which the worse half of the policies drops out; 0: never."""
    model: Literal["light", "full"] = "light"
    """light: without the joints that the walk never moves, longer physics steps, fewer
    solver iterations; full: the whole robot."""
    backend: Literal["auto", "native", "mjx"] = "auto"
    """native: CPU threads; mjx: one compiled call; auto: mjx on an accelerator."""
    impl: Literal["auto", "jax", "warp"] = "auto"
    """Of mjx; auto: warp where it can run (NVIDIA, warp-lang), four times as fast."""
    listen: int | None = None
    """Port at which other hosts join, with gatjax work, before and while it runs."""
    hosts: int = 0
    """With --listen: others to wait for, up to five minutes, before it begins."""
    rate_hz: float = 50.0
    """Control rate: 50, 100 or 83.3; a grounding has that it was learned at."""
    seed: int = 0
    """Of all that is drawn."""


@dataclass(frozen=True, kw_only=True)
class Work:
    """Run a share of the policies of a search that another host leads.

    On the leader: gatjax search --listen 5123 ... On any other host, as many as there
    are, started by hand or by Slurm, Kubernetes, Ray or mpirun, now or later:

        gatjax work --leader node0:5123

    A host needs gatjax of the same version, no files. It may be killed at any time.
    On a network with strangers give all hosts the same secret in GATJAX_SECRET.
    """

    leader: str
    """HOST:PORT of the search."""
    backend: Literal["auto", "native", "mjx"] = "auto"
    """native: CPU threads; mjx: one compiled call; auto: mjx on an accelerator."""
    impl: Literal["auto", "jax", "warp"] = "auto"
    """Of mjx; auto: warp where it can run (NVIDIA, warp-lang), four times as fast."""
    patience: float = 300.0
    """Seconds to wait for a leader that is not there yet, or died."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Walk policies on a robot and print speed and falls."""

    policies: tuple[Path, ...] = ()
    """Policy JSON files; theta0 if none."""
    robot: str = "dart"
    """dart, stiff, simulator, or a robot behind a link (see gatjax collect)."""
    out: Path = Path("evaluated")
    """Folder for frames and walks of a robot behind a link; the same one goes on."""
    world: Path | None = None
    """world.json, for --robot simulator."""
    runs: int = 10
    """Walks of each policy."""
    body_seed: int = 0
    """Which robot of the series, for dart and stiff."""
    forward: float = 0.75
    """Forward request, a share of max_forward."""
    rate_hz: float = 50.0
    """Control rate: 50, 100 or 83.3 (lola)."""
    seed: int = 0
    """Of the walks' starts and noise, 0 to 9999."""


@dataclass(frozen=True, kw_only=True)
class View:
    """Show one walk: an html animation, a video, or a live window."""

    out: Path = Path("walk.html")
    """html file to write; .mp4 for a video, which needs imageio-ffmpeg (README)."""
    policy: Path | None = None
    """Policy JSON file; theta0 if left out."""
    robot: str = "simulator"
    """simulator, dart, stiff, or a robot behind a link (see gatjax collect)."""
    world: Path | None = None
    """world.json, for --robot simulator."""
    live: bool = False
    """Open MuJoCo's window instead of writing a file."""
    body_seed: int = 0
    """Which robot of the series, for dart and stiff."""
    rate_hz: float = 50.0
    """Control rate: 50, 100 or 83.3 (lola)."""
    seed: int = 0
    """Of the walk's start and noise."""


@dataclass(frozen=True, kw_only=True)
class Deploy:
    """Let a robot walk a policy, under guard, with a log of every frame.

    gatjax deploy runs/.../policies/gat_0_5_mean.json --robot lola

    On the NAO itself it is gatjax-deploy, which needs Python 3.8 and numpy only
    (docs/hardware.md). Ctrl-C or the button on the chest lets the robot crouch; a
    second Ctrl-C takes its power. gatjax nao starts a simulated NAO to try it on.
    """

    policy: tyro.conf.Positional[Path]
    """Policy JSON of a run; theta0 is the walk that was tuned by hand."""
    robot: str = "lola"
    """lola, simspark or simspark-v4, with or without an address (gatjax collect)."""
    walks: int = 1
    """How many; the robot is put up again for each."""
    forward: float = 0.75
    """Forward request, a share of the policy's top speed."""
    seconds: float = 7.5
    """Length of a walk."""
    out: Path | None = None
    """Folder for the log; named by the time, in `deployed`, if left out."""


@dataclass(frozen=True, kw_only=True)
class SimulateNao:
    """Start a simulated NAO that speaks LoLA: any NAO software can connect to it.

    It waits in somebody's hands, is put down when its pose is steady and its power on,
    and picked up when its power is off again. Its faults are those of the stand-in
    robot: three frames of delay, play, weak motors, calibration errors.
    """

    robot: Literal["dart", "stiff"] = "dart"
    socket: Path = Path("/tmp/robocup")
    lockstep: bool = False
    """Wait for every answer, as fast as both can; otherwise in real time."""
    hung: bool = False
    """Hang it up instead of putting it on its feet, for motions (collect --hung)."""
    body_seed: int = 0
    """Which robot of the series."""
    seed: int = 0
    """Of its starts and its noise."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write report.html of a run folder."""

    run: Path | None = None
    """Run folder; the latest in `runs` if left out."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measure a generation of the search beside bare loops of the same engines.

    gatjax bench --backends native mjx-jax environment --json bench.json

    prints physics steps a second, compile time, and where the time of a generation
    goes; bench.png shows it. `environment` is a loop around a compiled step, as users
    write it around an environment of Brax, with the walk engine on the host.
    gatjax bench diagnose --help: measure the diagnosis on cases with known answers.
    """

    worlds: int = 256
    """Robots in parallel: policies x rollouts."""
    seconds: float = 2.0
    """Simulated time of each run."""
    json: Path | None = None
    """Also write the table to this file, and a picture beside it."""
    backends: tuple[Literal["native", "mjx-jax", "mjx-warp", "environment"], ...] = (
        "native",
    )
    models: tuple[Literal["full", "light"], ...] = ("full", "light")
    """With all joints, or without those that the walk never moves."""
    kinds: tuple[Literal["plain", "grounded", "explained"], ...] = (
        "plain", "grounded", "explained",
    )  # fmt: skip
    """Worlds: sensor noise only; GAT's networks besides; effects of causes besides."""


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


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this installation: versions, devices, engines, and a short walk."""


VERBS: dict[str, type] = {
    "run": Run,
    "collect": Collect,
    "import": Import,
    "diagnose": Diagnose,
    "ground": Ground,
    "search": Search,
    "work": Work,
    "evaluate": Evaluate,
    "view": View,
    "deploy": Deploy,
    "nao": SimulateNao,
    "report": Report,
    "bench": Bench,
    "doctor": Doctor,
}
