"""Play a motion on any robot and record it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import to_recording
from gatjax.motions import Limbs, Motion
from gatjax.records import JOINTS, Trajectory


@runtime_checkable
class Player(Protocol):
    """What playing a motion needs of a robot, simulated or real."""

    name: str

    def limbs(self) -> Limbs:
        """Return what a motion must know of it."""
        ...

    def play(
        self, targets: np.ndarray, rate_hz: float, seeds: Sequence[int] | np.ndarray
    ) -> Trajectory:
        """Follow targets [N, T, J] rad, one run a seed [N]; records [N, T, ...]."""
        ...


@runtime_checkable
class Hangable(Protocol):
    """A robot that can hang, its torso held: its joints then move as far as they can.

    What a floor does to it is in no such log, and it cannot fall.
    """

    def hung(self) -> Player:
        """Return it, hung."""
        ...


class Play(NamedTuple):
    """How a motion is played; the first axis of the results is one run a seed."""

    motion: Motion
    joints: np.ndarray  # [J] bool, those that move
    rate_hz: float
    seeds: Sequence[int]  # [N]
    reach: float  # share of the joint ranges
    seconds: float


def record_motion(robot: Player, play: Play) -> tuple[Recording, int]:
    """Play a motion on a robot, each run with a draw of its own, and record it.

    Returns:
        The recording, and how many runs ended in a fall.

    Raises:
        ValueError: one line: the motion can not be played so.
    """
    trajectory = played(robot, play)
    falls = int((~np.asarray(trajectory.alive)[:, -1]).sum())
    return recorded(robot, play, trajectory), falls


def played(robot: Player, play: Play) -> Trajectory:
    """Play a motion on a robot: N runs, each with a draw of its own."""
    limbs = robot.limbs()
    targets = np.stack(
        [
            play.motion.build(
                limbs, play.joints, play.rate_hz, seed,
                reach=play.reach, seconds=play.seconds,
            )
            for seed in play.seeds
        ]
    )  # fmt: skip
    return robot.play(targets, play.rate_hz, play.seeds)


def recorded(robot: Player, play: Play, trajectory: Trajectory) -> Recording:
    """Turn runs of a motion into a recording.

    Raises:
        ValueError: one line: there is nothing to record.
    """
    limbs, alive = robot.limbs(), np.asarray(trajectory.alive)
    ended = ~alive[:, -1]
    if not limbs.floating and ended.any():
        second = float(trajectory.time[ended][~alive[ended]].min())
        raise ValueError(
            f"{robot.name}: the simulation falls apart {second:.1f} s into the motion; "
            f"use a smaller --reach, or a finer physics step in the model"
        )
    names = np.array(limbs.names)[play.joints]
    notes = {
        "motion": play.motion.name,
        "joints": ",".join(names),
        "reach": play.reach,
        "seconds": play.seconds,
        "seed": play.seeds[0],
    }
    return _recorded(trajectory, limbs, robot.name, play.rate_hz, notes)


def _recorded(
    trajectory: Trajectory, limbs: Limbs, robot: str, rate_hz: float, notes: dict
) -> Recording:
    """Turn runs [N, T, ...] of any robot into a recording."""
    if limbs.floating and limbs.names == JOINTS:
        return to_recording(trajectory, robot, rate_hz, notes)
    alive, reading = trajectory.alive, trajectory.reading
    if not alive.any():
        raise ValueError(f"{robot}: no trajectory has a row before its fall")
    families = {
        "command": (limbs.names, trajectory.command),
        "position": (limbs.names, reading.angle),
        "gyro": ("xyz", reading.gyro),
        "accelerometer": ("xyz", reading.accelerometer),
    }
    runs = np.arange(len(alive))[:, None]
    return Recording(
        name=robot,
        time=trajectory.time[alive],
        trajectory=np.broadcast_to(runs, alive.shape)[alive],
        columns={
            f"{family}.{part}": values[alive][:, index]
            for family, (parts, values) in families.items()
            for index, part in enumerate(parts)
            if values.shape[-1] == len(parts)
        },
        metadata={
            **{key: str(value) for key, value in notes.items()},
            "robot": robot,
            "base": "floating" if limbs.floating else "fixed",
            "rate_hz": float(rate_hz),
        },
    )
