"""A simulated world in the place of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from gatjax import task as tasks
from gatjax.motions import Limbs
from gatjax.records import (
    Array,
    Base,
    Outcome,
    Played,
    Reading,
    Sensed,
    Trajectory,
)
from gatjax.robot.model import check_walker
from gatjax.sim.backend import prepare
from gatjax.sim.limbs import limbs_of, put_down, settling
from gatjax.sim.replay import replay_many
from gatjax.sim.world import World, stacked
from gatjax.task import Task

SETTLE = 1.0  # s at the first target, before the first row
FALLEN_SHARE = 0.6  # of the height at the first row; a NAO's 0.20 m of 0.33 m


class Simulator:
    """A world that walks policies and plays motions as a robot does."""

    name = "simulator"

    def __init__(self, world: World) -> None:
        """Prepare the runs of a world on the CPU."""
        self.world = world
        self._backend = prepare(world, "native")

    def constants(self) -> dict[str, Any]:
        """Return the causes that the world carries."""
        return {"model": self.world.source, "causes": list(self.world.causes)}

    def walk(
        self,
        policies: Array,
        seeds: Sequence[int] | np.ndarray,
        task: Task | None = None,
    ) -> tuple[Trajectory, Outcome]:
        """Walk policies [N, 15] with seeds [N]."""
        if task is not None and task != self.world.task:
            raise ValueError("this simulator was prepared for another task")
        check_walker(self.world.model, str(self.world.source))
        keys = jax.vmap(jax.random.key)(np.asarray(list(seeds)))
        return self._backend.rollout(self.world.values, policies, keys)

    def limbs(self) -> Limbs:
        """Return what a motion must know of the world's robot."""
        return limbs_of(self.world.model)

    def play(
        self, targets: np.ndarray, rate_hz: float, seeds: Sequence[int] | np.ndarray
    ) -> Trajectory:
        """Follow targets [N, T, J] rad, open loop, hung up or standing as the model is.

        Args:
            targets: from `gatjax.motions`; the first one is held before, till the robot
                rests.
            rate_hz: rows per second, the world's.
            seeds: [N] int, which draw the noise.

        Returns:
            Trajectory [N, T, ...]; `alive` is False from a fall on. Where the model has
            no IMU or foot sensors, their axis has length 0.

        Raises:
            ValueError: another rate.
        """
        world = self.world
        if abs(rate_hz - world.rate_hz) > 0.05:
            raise ValueError(
                f"this simulator was prepared for {world.rate_hz:g} Hz, "
                f"not {rate_hz:g} Hz"
            )
        rest = max(SETTLE, settling(world.model))
        before = round(rest / world.task.control_period)
        held = np.repeat(targets[:, :1], before, axis=1)
        commands = np.concatenate([held, targets], axis=1)
        draws = [np.random.default_rng([int(seed), 8]) for seed in seeds]
        noise = np.stack([draw.normal(size=commands.shape[1:]) for draw in draws])
        qpos = np.stack([put_down(world.model, first) for first in targets[:, 0]])
        values = stacked([world.values] * len(targets))
        still = np.zeros(world.model.nv)
        rows = replay_many(world, values, commands, qpos, still, noise, lead=before)
        reading = Reading(*(field[:, before:] for field in rows.reading))
        base = Base(*(field[:, before:] for field in rows.base))
        time = np.arange(targets.shape[1]) * world.task.control_period
        return Trajectory(
            time=np.tile(time, (len(targets), 1)),
            command=np.asarray(targets),
            reading=_noisy(world, reading, draws),
            base=base,
            alive=_alive(self.limbs(), rows)[:, before:],
        )


def _noisy(world: World, reading: Reading, draws: list) -> Reading:
    """Add the world's sensor noise to readings [N, T, ...]."""
    if "noise" not in world.sensor:
        return reading
    normal = Reading(
        *(
            np.stack([draw.normal(size=field.shape[1:]) for draw in draws])
            for field in reading
        )
    )
    signal = Sensed(reading, normal)
    _, signal = world.sensor["noise"].apply(world.values.sensor["noise"], (), signal)
    return signal.reading


def _alive(limbs: Limbs, rows: Played) -> np.ndarray:
    """Return which rows [N, T] come before a fall or the end of the simulation.

    Where the physics gave up, numbers are not finite or a moving robot stands still.
    """
    fine = np.isfinite(rows.reading.angle).all(-1)
    moving = (np.abs(rows.velocity[:, 1:]) > 1e-6).any(-1)
    stuck = (rows.velocity[:, 1:] == rows.velocity[:, :-1]).all(-1)
    fine[:, 1:] &= ~(moving & stuck)
    if limbs.floating:
        x, y = rows.base.quaternion[..., 1], rows.base.quaternion[..., 2]
        height = rows.base.position[..., 2]
        fine &= 1.0 - 2.0 * (x**2 + y**2) >= tasks.FALLEN_UP
        fine &= height >= FALLEN_SHARE * height[:, :1]
    return np.logical_and.accumulate(fine, axis=1)
