"""`gatjax collect`: walks or motions of a robot, into one recording."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from gatjax import motions
from gatjax.cli import arguments as verbs
from gatjax.cli.inputs import (
    check_least,
    check_seconds,
    policy_of,
    robot_of,
    walker_of,
    world_of,
)
from gatjax.cli.progress import shown_beside
from gatjax.data.excitation import LEAST_RANGE
from gatjax.data.recording import Recording, check_output, write_recording
from gatjax.data.trajectories import to_recording
from gatjax.hardware.robot import Hardware, HungHardware
from gatjax.loop.play import Hangable, Play, Player, record_motion
from gatjax.runs import make_folder
from gatjax.settings import ROBOT_LOG, SIMULATOR_LOG, check_seed, seeds
from gatjax.task import RATES, Task, task_at


def record(verb: verbs.Collect) -> None:
    """Record walks or a motion of a robot."""
    walks = verb.motion is None
    runs_asked = (
        (15 if walks else 3) if verb.trajectories is None else verb.trajectories
    )
    check_least(1, trajectories=runs_asked)
    check_seed("--seed", verb.seed)
    check_least(0, body_seed=verb.body_seed)
    hung = verb.hung or None
    given = {"joints": verb.joints or None, "reach": verb.reach, "hung": hung}
    given = given | {"seconds": verb.seconds} if walks else {"policy": verb.policy}
    extra = next((name for name, value in given.items() if value is not None), None)
    if extra is not None:
        kind = "goes with --motion" if walks else "is for walks, not for --motion"
        raise ValueError(f"--{extra} {kind}; leave it out")
    if verb.seconds is not None:
        check_seconds(verb.seconds)
    check_output(verb.out)
    make_folder(verb.out.parent)
    asked = None if verb.motion is None else motions.motion(verb.motion)
    task = task_at(verb.rate_hz) if walks else playing_at(verb.rate_hz, verb.robot)
    folder = verb.out.with_suffix("")
    read = walker_of if walks else world_of
    robot = robot_of(verb.robot, verb.body_seed, verb.world, task, folder, read)
    robot = hung_up(robot) if verb.hung else robot
    purpose = SIMULATOR_LOG if verb.robot == "simulator" else ROBOT_LOG
    drawn = seeds(purpose, verb.seed, runs_asked)
    if asked is None:
        recording, told = walked(verb, robot, drawn)
    else:
        recording, told = played(verb, robot, asked, drawn)
    write_recording(verb.out, recording)
    print(f"{verb.out}: {told}")


def hung_up(robot: Any) -> Player:
    """Return a robot with its torso held in the air."""
    if isinstance(robot, Hardware):
        return HungHardware(robot.address, robot.folder, robot.attendant)
    if isinstance(robot, Hangable):
        return robot.hung()
    raise ValueError("--hung: give the simulator a model that hangs, with --world")


def playing_at(rate_hz: float, robot: str) -> Task:
    """Return the task of playing motions: a simulation does it at any rate."""
    if robot != "simulator" or rate_hz in RATES:
        return task_at(rate_hz)
    if not motions.SLOWEST <= rate_hz <= 1000.0:
        low = f"{motions.SLOWEST:g}"
        raise ValueError(f"--rate-hz is {rate_hz:g}; motions take {low} to 1000 Hz")
    return Task(control_period=1.0 / rate_hz)


def walked(verb: verbs.Collect, robot: Any, drawn: range) -> tuple[Recording, str]:
    """Record walks; return what to say about them."""
    policies = np.tile(policy_of(verb.policy), (len(drawn), 1))
    with shown_beside(verb.robot, 1.0) as progress:
        progress.stage(f"{len(drawn)} walks of {robot.name}")
        trajectory, outcome = robot.walk(policies, drawn, task_at(verb.rate_hz))
        progress.work(1.0)
    recording = to_recording(trajectory, robot.name, verb.rate_hz, {"seed": verb.seed})
    return recording, f"{len(drawn)} trajectories, {summary(outcome)}"


def played(
    verb: verbs.Collect, robot: Player, motion: motions.Motion, drawn: range
) -> tuple[Recording, str]:
    """Record a motion; return what to say about it."""
    limbs = robot.limbs()
    names = tuple(name for word in verb.joints for name in word.split(",") if name)
    moving = motions.chosen(limbs, names)
    play = Play(
        motion=motion,
        joints=moving,
        rate_hz=verb.rate_hz,
        seeds=drawn,
        reach=motion.reach(limbs, moving) if verb.reach is None else verb.reach,
        seconds=motion.seconds if verb.seconds is None else verb.seconds,
    )
    with shown_beside(verb.robot, 1.0) as progress:
        progress.stage(f"{len(drawn)} times {motion.name} on {robot.name}")
        recording, falls = record_motion(robot, play)
        progress.work(1.0)
    pairs = zip(limbs.names, moving, strict=True)
    warn_of_rest(recording, [name for name, moves in pairs if moves])
    fell = f", {counted(falls, 'fall')}" if limbs.floating else ""
    advice = "; try a smaller --reach" if falls else ""
    return recording, (
        f"{counted(len(drawn), 'run')} of {motion.name} with reach {play.reach:g}"
        f"{fell}{advice}\n{motion.use}"
    )


def warn_of_rest(recording: Recording, names: Sequence[str]) -> None:
    """Name joints that were hardly told to move, on stderr."""
    told = {name: np.ptp(recording.columns[f"command.{name}"]) for name in names}
    still = [name for name, moved in told.items() if moved < LEAST_RANGE]
    if still:
        print(
            f"warning: {', '.join(still)}: told to move less than {LEAST_RANGE} rad; "
            f"try a larger --reach, or is the range in the model wrong (MJCF means "
            f'degrees, unless its compiler says angle="radian")?',
            file=sys.stderr,
        )


def summary(outcome: Any) -> str:
    """Say speed and falls in one line."""
    falls = int(np.isfinite(outcome.fell_at).sum())
    speed = 100.0 * np.asarray(outcome.velocity)
    spread = f" +- {speed.std():.1f}" if len(speed) > 1 else ""
    return f"{speed.mean():.1f}{spread} cm/s, {counted(falls, 'fall')}"


def upright(outcome: Any) -> str:
    """Say how fast those were that did not fall, where others did."""
    stood = ~np.isfinite(outcome.fell_at)
    if stood.all() or not stood.any():
        return ""
    speed = 100.0 * np.asarray(outcome.velocity)[stood].mean()
    return f"; {speed:.1f} cm/s without those that fell"


def counted(number: int, thing: str) -> str:
    """So many things, one without an s."""
    return f"{number} {thing}{'s' * (number != 1)}"
