"""The stand-in robot `dart`: a NAO in DART, the engine that Gazebo runs, at 1 ms.

The contact (LCP), dry friction (in the same LCP) and integrator are DART's own; links
and floor are those of `skeleton.py`, built from the nominal model's numbers. The servo
is written out at 1 ms, explicitly: a step is far below its time constants. The one
motor of both hip-yaw-pitch joints sits on the left; a stiff shaft turns the right one
(0.2 deg at 2 N m; dartpy's coupled mimic joints proved unstable at 1 ms).
"""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial
from multiprocessing import get_context
from typing import Any

import dartpy
import mujoco
import numpy as np

from gatjax import processors
from gatjax import task as tasks
from gatjax.motions import Limbs, standing_nao
from gatjax.records import JOINTS, Base, Outcome, Reading, Trajectory
from gatjax.surrogate import course
from gatjax.surrogate.e1 import E1, Body, draw_body, nominal, published
from gatjax.surrogate.hung import Hung, hung_state
from gatjax.surrogate.servo import COUPLED, encode, error, servo, torque
from gatjax.surrogate.skeleton import TORSO, Ground, Rotors, World, skeleton
from gatjax.surrogate.start import (
    Floor,
    Run,
    draw_floor,
    draw_run,
    first_state,
    playing,
)
from gatjax.task import Task

STEP = 0.001  # s, physics and servo
SHAFT_STIFFNESS, SHAFT_DAMPING = 500.0, 0.5  # N m/rad, N m s/rad, between the hips
FOLLOWER = "RHipYawPitch"


class Nao:
    """One robot on its floor; a `course.Machine` with N = 1."""

    def __init__(
        self, body: Body, floor: Floor, run: Run, pose: np.ndarray, task: Task
    ) -> None:
        """Put a robot down with joint angles `pose` [J] rad."""
        model = nominal()
        self.body, self.patch = body, run.patch
        self.substeps = round(task.control_period / STEP)
        self.robot = skeleton(body)
        self.ground = Ground(floor, self.robot)
        self.torso = self.robot.getBodyNode(TORSO)
        self._wire(model)
        self.world = dartpy.simulation.World()
        self.world.setTimeStep(STEP)
        self.world.setGravity(model.opt.gravity)
        self.world.setCollisionDetector(dartpy.collision.DARTCollisionDetector())
        self.world.addSkeleton(self.robot)
        self.world.addSkeleton(self.ground.skeleton)
        self._begin(pose, run, floor)
        self.rotors = Rotors(self.robot)
        self._prepare(pose)

    def _wire(self, model: mujoco.MjModel) -> None:
        """Find the joints in DART's vectors, by name, and the motors' numbers."""
        count = self.robot.getNumDofs()
        names = [self.robot.getDof(index).getName() for index in range(count)]
        self.slots = np.array([names.index(name) for name in JOINTS])
        self.twin = names.index(FOLLOWER)
        self.motors = servo(E1)
        for name in names[6:]:
            motor = JOINTS.index(name.replace(FOLLOWER, JOINTS[COUPLED]))
            sides = 2 if motor == COUPLED else 1  # one motor, friction on both sides
            self.robot.getJoint(name).setCoulombFriction(
                0, self.motors.friction[motor] / sides
            )
        self.from_model = np.array([model.joint(name).qposadr[0] for name in names[6:]])
        self.imu = model.site("imu").pos

    def _begin(self, pose: np.ndarray, run: Run, floor: Floor) -> None:
        """Put the robot down."""
        self._place(*first_state(pose, run, floor))

    def _place(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set DART's state: rotation before position, both in the torso's axes."""
        position = np.zeros(self.robot.getNumDofs())
        velocity = np.zeros_like(position)
        position[3:6] = qpos[:3]
        position[6:] = qpos[self.from_model]
        velocity[:3], velocity[3:6] = qvel[3:6], qvel[:3]
        self.robot.setPositions(position)
        self.robot.setVelocities(velocity)

    def _prepare(self, pose: np.ndarray) -> None:
        """Fill the delay lines with the first pose and the first reading."""
        self.step = 0
        self.late = round(E1.command_delay / STEP)
        self.lag = round(E1.sensor_delay / STEP)
        self.queue: deque = deque()
        self.target = pose
        self.seen: deque = deque([(-self.lag, self._look())])

    def _look(self) -> Reading:
        """Return what the sensors feel now, without errors."""
        angle = self.robot.getPositions()[self.slots]
        turn = self.torso.getWorldTransform().rotation().T
        world = World()
        pull = self.torso.getLinearAcceleration(self.imu, world, world)
        return Reading(
            angle=angle,
            gyro=turn @ self.torso.getAngularVelocity(),
            accelerometer=turn @ (pull - self.world.getGravity()),
            force=self.ground.forces(self.world.getLastCollisionResult().getContacts()),
        )

    def sense(self) -> Reading:
        """Return what was true one sensor delay ago; see `course.Machine`."""
        due = self.step - self.lag
        while len(self.seen) > 1 and self.seen[1][0] <= due:
            self.seen.popleft()
        return Reading(*(field[None] for field in self.seen[0][1]))

    def base(self) -> Base:
        """Return where the torso is; see `course.Machine`."""
        frame = self.torso.getWorldTransform()
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, frame.rotation().ravel())
        position = frame.translation().copy()
        position[:2] -= self.patch
        return Base(position[None], quaternion[None])

    def advance(self, target: np.ndarray, alive: np.ndarray) -> None:
        """Run for one control tick; see `course.Machine`."""
        self.queue.append((self.step + self.late, target[0].copy()))
        for _ in range(self.substeps):
            self._substep()
            if (self.step + self.lag) % self.substeps == 0:
                self.seen.append((self.step, self._look()))

    def _substep(self) -> None:
        while self.queue and self.queue[0][0] <= self.step:
            self.target = self.queue.popleft()[1]
        position = self.robot.getPositions()
        velocity = self.robot.getVelocities()
        angle, speed = position[self.slots], velocity[self.slots]
        seen = error(E1, self.target, encode(E1, angle, self.body.offset))
        force = np.zeros(position.shape)
        force[self.slots] = torque(self.motors, seen, speed)
        left, twin = self.slots[COUPLED], self.twin
        shaft = SHAFT_STIFFNESS * (position[left] - position[twin])
        shaft += SHAFT_DAMPING * (velocity[left] - velocity[twin])
        force[left] -= shaft
        force[twin] += shaft
        self.robot.setForces(force)
        self.rotors.act(STEP)
        self.ground.lay()
        self.world.step()
        self.step += 1


class HungNao(Nao):
    """The same robot, its torso held in the air."""

    def _begin(self, pose: np.ndarray, run: Run, floor: Floor) -> None:
        """Lift the robot and lock its torso."""
        self._place(*hung_state(pose, run, floor))
        locked = dartpy.dynamics.ActuatorType.LOCKED
        self.robot.getRootJoint().setActuatorType(locked)


@lru_cache(maxsize=4)
def _series(body_seed: int) -> tuple[Body, Floor]:
    body = draw_body(body_seed)
    return body, draw_floor(body, E1)


def walk_one(
    body_seed: int, policy: np.ndarray, seed: int, task: Task
) -> tuple[Trajectory, Outcome]:
    """Let one robot walk: policy [15]; records with a leading axis of 1."""
    body, floor = _series(body_seed)
    run = draw_run(body, seed, task, E1)
    machine = Nao(body, floor, run, tasks.pose(policy), task)
    return course.walk(machine, E1, body, [run], policy[None], task)


def play_one(
    kind: type[Nao], body_seed: int, targets: np.ndarray, rate_hz: float, seed: int
) -> Trajectory:
    """Let one robot play targets [T, J] rad; records with a leading axis of 1."""
    body, floor = _series(body_seed)
    task = playing(len(targets), rate_hz)
    run = draw_run(body, seed, task, E1)
    machine = kind(body, floor, run, targets[0], task)
    return course.play(machine, E1, body, [run], targets[None], task)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Dart:
    """The robot `dart`: one body of the series; see `gatjax.surrogate.make_robot`."""

    name = "dart"

    def __init__(self, body_seed: int, workers: int | None = None) -> None:
        """Choose a body; `workers` processes (default: all cores) share the runs."""
        self.body_seed = body_seed
        self.workers = workers or len(processors.usable())
        self._pool: ProcessPoolExecutor | None = None

    def constants(self) -> dict:
        """Return what `robot.json` says about this robot."""
        return published("DART, 1 ms", draw_body(self.body_seed))

    def walk(
        self,
        policies: np.ndarray,
        seeds: Sequence[int] | np.ndarray,
        task: Task | None = None,
    ) -> tuple[Trajectory, Outcome]:
        """Let N robots walk.

        Args:
            policies: [N, 15] walk parameters.
            seeds: [N] int, one per run.
            task: the task; by default `Task()`.

        Returns:
            Trajectory [N, T, ...] and Outcome [N]; they do not depend on the number of
            workers.
        """
        task = task or Task()
        jobs = [
            (self.body_seed, policy, int(seed), task)
            for policy, seed in zip(policies, seeds, strict=True)
        ]
        walks, verdicts = zip(*self._shared(walk_one, jobs), strict=True)
        return _join(walks), _join(verdicts)

    def limbs(self) -> Limbs:
        """Return what a motion must know of this robot, which stands."""
        return standing_nao()

    def play(
        self, targets: np.ndarray, rate_hz: float, seeds: Sequence[int] | np.ndarray
    ) -> Trajectory:
        """Let N standing robots follow targets, open loop.

        Args:
            targets: [N, T, J] rad, from `gatjax.motions`; held for a second before.
            rate_hz: rows per second: 50, 100 or 83.3.
            seeds: [N] int, one per run.

        Returns:
            Trajectory [N, T, ...]; `alive` is False from a fall on.

        Raises:
            ValueError: another rate.
        """
        return self._play(Nao, targets, rate_hz, seeds)

    def hung(self) -> Hung:
        """Return this robot with its torso held in the air."""
        return Hung(self.name, partial(self._play, HungNao))

    def _play(
        self,
        kind: type[Nao],
        targets: np.ndarray,
        rate_hz: float,
        seeds: Sequence[int] | np.ndarray,
    ) -> Trajectory:
        jobs = [
            (kind, self.body_seed, target, rate_hz, int(seed))
            for target, seed in zip(targets, seeds, strict=True)
        ]
        return _join(self._shared(play_one, jobs))

    def _shared(self, run: Callable, jobs: list[tuple]) -> list:
        """Run jobs in the worker processes; in this one if there is only one."""
        if min(self.workers, len(jobs)) == 1:
            return [run(*job) for job in jobs]
        try:
            return list(self._workers().map(run, *zip(*jobs, strict=True)))
        except BaseException:
            self.close()
            raise

    def _workers(self) -> ProcessPoolExecutor:
        """Return the worker processes; they start once and serve all later walks."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self.workers,
                mp_context=get_context("spawn"),
                initializer=_leave_interrupts_to_the_parent,
            )
        return self._pool

    def close(self) -> None:
        """End the worker processes; runs that wait are dropped."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def _join(parts: Sequence[Any]) -> Any:
    """Put equal records together along their first axis."""
    first = parts[0]
    if isinstance(first, tuple):
        return type(first)(*map(_join, zip(*parts, strict=True)))
    return np.concatenate(parts)
