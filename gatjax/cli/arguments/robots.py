"""What the verbs take that let a robot, or a stand-in, move."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gatjax.motions import MENU

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
    """simulator, dart, stiff, or a robot behind a link (see gatjax collect): that one's
    walk stays in a folder named as `out`, and the same command shows it again."""
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
