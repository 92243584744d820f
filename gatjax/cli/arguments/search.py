"""What the verbs take that ground a simulator and search in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from gatjax.settings import DEMO, LoopSettings


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
class Doctor:
    """Check this installation: versions, devices, engines, and a short walk."""
