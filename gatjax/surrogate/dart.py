"""The stand-in robot `dart`: NAOs in DART, the engine that Gazebo runs, at 1 ms.

The contact (LCP), dry friction (in the same LCP) and integrator are DART's own; the
links are those of `skeleton`, the rotors those of `legs`, the floor that of `plates`.
The servo is written out at 1 ms, explicitly: a step is far below its time constants.
The one motor of both hip-yaw-pitch joints sits on the left; a stiff shaft turns the
right one (0.2 deg at 2 N m; dartpy's coupled mimic joints proved unstable at 1 ms).
"""

from __future__ import annotations

from collections import deque

import dartpy
import mujoco
import numpy as np

from gatjax.records import JOINTS, Base, Reading
from gatjax.surrogate.e1 import E1, Body, nominal
from gatjax.surrogate.hung import hung_state
from gatjax.surrogate.legs import PLACE, TURN, Chains, Rotors
from gatjax.surrogate.plates import CORNERS, Ground
from gatjax.surrogate.servo import COUPLED, encode, error, servo, torque
from gatjax.surrogate.skeleton import TORSO, skeleton
from gatjax.surrogate.standin import Engine
from gatjax.surrogate.start import Floor, Run, first_state
from gatjax.task import Task

STEP = 0.001  # s, physics and servo
SHAFT_STIFFNESS, SHAFT_DAMPING = 500.0, 0.5  # N m/rad, N m s/rad, between the hips
FOLLOWER = "RHipYawPitch"
WORLD = dartpy.dynamics.Frame.World


class Flock:
    """N robots of one body on one floor; a `course.Machine`."""

    def __init__(
        self, body: Body, floor: Floor, runs: list[Run], poses: np.ndarray, task: Task
    ) -> None:
        """Put N robots down with joint angles `poses` [N, J] rad."""
        self.body, self.patch = body, np.stack([run.patch for run in runs])
        self.substeps = round(task.control_period / STEP)
        self.robots = [skeleton(body) for _ in runs]
        self.torsos = [robot.getBodyNode(TORSO) for robot in self.robots]
        self._wire()
        self.motors = servo(E1)
        self._rub()
        self.ground = Ground(floor, len(runs))
        self.worlds = [
            _world(robot, plates)
            for robot, plates in zip(self.robots, self.ground.skeletons, strict=True)
        ]
        self._begin(poses, runs, floor)
        self.chains = Chains(self.robots[0])
        self.rotors = Rotors(self.chains, *self._state())
        self._prepare(poses)

    def _wire(self) -> None:
        """Find the joints in DART's vectors, by name."""
        robot, model = self.robots[0], nominal()
        names = [robot.getDof(index).getName() for index in range(robot.getNumDofs())]
        self.slots = np.array([names.index(name) for name in JOINTS])
        self.twin, self.bent = names.index(FOLLOWER), names[PLACE:]
        bent = [model.joint(name).qposadr[0] for name in self.bent]
        self.from_model = np.array(bent)
        self.imu = model.site("imu").pos

    def _rub(self) -> None:
        """Give the joints dry friction; that of one motor acts on both sides."""
        for name in self.bent:
            motor = JOINTS.index(name.replace(FOLLOWER, JOINTS[COUPLED]))
            friction = self.motors.friction[motor] / (2 if motor == COUPLED else 1)
            for robot in self.robots:
                robot.getJoint(name).setCoulombFriction(0, friction)

    def _begin(self, poses: np.ndarray, runs: list[Run], floor: Floor) -> None:
        """Put the robots down."""
        for robot, pose, run in zip(self.robots, poses, runs, strict=True):
            self._place(robot, *first_state(pose, run, floor))

    def _place(
        self, robot: dartpy.dynamics.Skeleton, qpos: np.ndarray, qvel: np.ndarray
    ) -> None:
        """Set DART's state of an upright robot: rotation before position."""
        position = np.zeros(robot.getNumDofs())
        velocity = np.zeros_like(position)
        position[TURN:PLACE] = qpos[:3]
        position[PLACE:] = qpos[self.from_model]
        velocity[:TURN], velocity[TURN:PLACE] = qvel[3:6], qvel[:3]
        robot.setPositions(position)
        robot.setVelocities(velocity)

    def _state(self) -> tuple[np.ndarray, np.ndarray]:
        """DART's positions and velocities, [N, D]."""
        return (
            np.array([robot.getPositions() for robot in self.robots]),
            np.array([robot.getVelocities() for robot in self.robots]),
        )

    def _prepare(self, poses: np.ndarray) -> None:
        """Fill the delay lines with the first pose and the first reading."""
        count = len(self.robots)
        self.step = 0
        self.late = round(E1.command_delay / STEP)
        self.lag = round(E1.sensor_delay / STEP)
        self.queue: deque = deque()
        self.target = poses
        nothing = (np.zeros((count, size)) for size in (len(JOINTS), 3, 3, CORNERS))
        first = self._look(Reading(*nothing), np.arange(count))
        self.seen: deque = deque([(-self.lag, first)])

    def _look(self, before: Reading, living: np.ndarray) -> Reading:
        """Return what the sensors of living robots feel now, without errors."""
        now = Reading(*(field.copy() for field in before))
        world = WORLD()
        for index in living:
            torso, physics = self.torsos[index], self.worlds[index]
            turn = torso.getWorldTransform().rotation().T
            pull = torso.getLinearAcceleration(self.imu, world, world)
            contacts = physics.getLastCollisionResult().getContacts()
            now.angle[index] = self.robots[index].getPositions()[self.slots]
            now.gyro[index] = turn @ torso.getAngularVelocity()
            now.accelerometer[index] = turn @ (pull - physics.getGravity())
            now.force[index] = self.ground.forces(index, contacts)
        return now

    def sense(self) -> Reading:
        """Return what was true one sensor delay ago; see `course.Machine`."""
        due = self.step - self.lag
        while len(self.seen) > 1 and self.seen[1][0] <= due:
            self.seen.popleft()
        return self.seen[0][1]

    def base(self) -> Base:
        """Return where the torsos are; see `course.Machine`."""
        frames = [torso.getWorldTransform() for torso in self.torsos]
        position = np.array([frame.translation() for frame in frames])
        position[:, :2] -= self.patch
        quaternion = np.zeros((len(frames), 4))
        for row, frame in zip(quaternion, frames, strict=True):
            mujoco.mju_mat2Quat(row, frame.rotation().ravel())
        return Base(position, quaternion)

    def advance(self, target: np.ndarray, alive: np.ndarray) -> None:
        """Run for one control tick; see `course.Machine`."""
        living = np.flatnonzero(alive)
        self.queue.append((self.step + self.late, target.copy()))
        for _ in range(self.substeps):
            self._substep(living)
            if (self.step + self.lag) % self.substeps == 0:
                self.seen.append((self.step, self._look(self.seen[-1][1], living)))

    def _substep(self, living: np.ndarray) -> None:
        while self.queue and self.queue[0][0] <= self.step:
            self.target = self.queue.popleft()[1]
        position, velocity = self._state()
        legs = self.chains.at(position)
        self.ground.lay(legs.turn, legs.place)
        force = self._drive(position, velocity)
        force += self.rotors.act(legs, velocity, STEP)
        for index in living:
            self.robots[index].setForces(force[index])
            self.worlds[index].step()
        self.step += 1

    def _drive(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Torques of motors and shafts in DART's coordinates [N, D]."""
        angle, speed = position[:, self.slots], velocity[:, self.slots]
        seen = error(E1, self.target, encode(E1, angle, self.body.offset))
        force = np.zeros(position.shape)
        force[:, self.slots] = torque(self.motors, seen, speed)
        left, twin = self.slots[COUPLED], self.twin
        shaft = SHAFT_STIFFNESS * (position[:, left] - position[:, twin])
        shaft += SHAFT_DAMPING * (velocity[:, left] - velocity[:, twin])
        force[:, left] -= shaft
        force[:, twin] += shaft
        return force


class HungFlock(Flock):
    """The same robots, their torsos held in the air."""

    def _begin(self, poses: np.ndarray, runs: list[Run], floor: Floor) -> None:
        """Lift the robots and lock their torsos."""
        for robot, pose, run in zip(self.robots, poses, runs, strict=True):
            self._place(robot, *hung_state(pose, run, floor))
            locked = dartpy.dynamics.ActuatorType.LOCKED
            robot.getRootJoint().setActuatorType(locked)


def _world(*skeletons: dartpy.dynamics.Skeleton) -> dartpy.simulation.World:
    """Put skeletons into a world of their own."""
    world = dartpy.simulation.World()
    world.setTimeStep(STEP)
    world.setGravity(nominal().opt.gravity)
    world.setCollisionDetector(dartpy.collision.DARTCollisionDetector())
    for each in skeletons:
        world.addSkeleton(each)
    return world


ENGINE = Engine("DART, 1 ms", Flock, HungFlock, together=8)
