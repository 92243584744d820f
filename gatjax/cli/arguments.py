"""What each verb of the command line takes: one frozen dataclass a verb."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from gatjax.settings import DEMO, PRESETS, LoopSettings, SearchSettings

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


@dataclass(frozen=True, kw_only=True)
class Collect:
    """Record walks of a robot into one Parquet file."""

    out: Path
    """Parquet or CSV file to write."""
    robot: Literal["simulator", "dart", "stiff"] = "dart"
    policy: Path | None = None
    """Policy JSON; the hand-tuned walk (theta0) if left out."""
    trajectories: int = 15
    world: Path | None = None
    """world.json, for --robot simulator."""
    body_seed: int = 0
    rate_hz: float = 50.0
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Learn a grounding from recordings of robot and simulator."""

    robot_log: Path
    """Recording of the robot."""
    simulator_log: Path
    """Recording of the simulator, same policy (gatjax collect --robot simulator)."""
    out: Path
    """Folder to write; its world.json is a simulation for every verb."""
    method: Literal["envelope", "guided", "gat"] = "gat"
    policy: Path | None = None
    """Policy of the recordings, for choosing alpha; theta0 if left out."""
    map: Path | None = None
    """YAML map of the robot log's column names, units and signs."""
    world: Path | None = None
    """world.json of the simulator to ground, without a grounding; ideal if left out."""
    rate_hz: float = 50.0
    seed: int = 0


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
    rollouts: int = 4
    generations: int = 8
    backend: Literal["auto", "native", "mjx"] = "auto"
    impl: Literal["jax", "warp"] = "jax"
    rate_hz: float = 50.0
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Walk policies on a robot and print speed and falls."""

    policies: tuple[Path, ...] = ()
    """Policy JSON files; theta0 if none."""
    robot: Literal["simulator", "dart", "stiff"] = "dart"
    world: Path | None = None
    """world.json, for --robot simulator."""
    runs: int = 10
    body_seed: int = 0
    forward: float = 0.75
    """Forward request, a share of max_forward."""
    rate_hz: float = 50.0
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class View:
    """Show one walk: an html animation, a video, or a live window."""

    out: Path = Path("walk.html")
    """html file to write; .mp4 for a video (pip install 'gatjax[video]')."""
    policy: Path | None = None
    robot: Literal["simulator", "dart", "stiff"] = "simulator"
    world: Path | None = None
    live: bool = False
    """Open MuJoCo's window instead of writing a file."""
    body_seed: int = 0
    rate_hz: float = 50.0
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write report.html of a run folder."""

    run: Path | None = None
    """Run folder; the latest in `runs` if left out."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measure steps/s of each backend beside a bare loop of the same engine."""

    worlds: int = 256
    seconds: float = 2.0
    """Simulated time of each run."""
    json: Path | None = None
    """Also write the table to this file."""
    backends: tuple[Literal["native", "mjx-jax", "mjx-warp"], ...] = ("native",)


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this installation: versions, devices, engines, and a short walk."""


VERBS: dict[str, type] = {
    "run": Run,
    "collect": Collect,
    "ground": Ground,
    "search": Search,
    "evaluate": Evaluate,
    "view": View,
    "report": Report,
    "bench": Bench,
    "doctor": Doctor,
}


def _preset(arguments: list[str]) -> str:
    """Find the preset on the command line; it sets the defaults of all the rest."""
    for index, word in enumerate(arguments):
        name, _, value = word.partition("=")
        if name == "--preset":
            return value or "".join(arguments[index + 1 : index + 2])
    return "demo"


def _typed(arguments: list[str]) -> tuple[str, ...]:
    """Name the settings of a run that the command line gives, defaults left out."""
    flags = {word.partition("=")[0].replace("-", "_") for word in arguments}
    names = [setting.name for setting in dataclasses.fields(LoopSettings)]
    names += [setting.name for setting in dataclasses.fields(SearchSettings)]
    return tuple(name for name in ("preset", *names) if f"__{name}" in flags)


def parse(arguments: list[str]) -> Any:
    """Read the command line into the verb's dataclass."""
    preset = _preset(arguments)
    run = Run(loop=PRESETS.get(preset, DEMO), typed=_typed(arguments))
    verbs: Any = None
    for name, kind in VERBS.items():
        default = run if kind is Run else tyro.MISSING_NONPROP
        verb = Annotated[kind, tyro.conf.subcommand(name, default=default)]
        verbs = verb if verbs is None else verbs | verb
    return tyro.cli(verbs, args=arguments, prog="gatjax", description=ABOUT)
