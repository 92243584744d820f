"""The plant in MuJoCo C: rigid bodies only, everything in the joints is `drive`'s."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from gatjax.surrogate.hidden import feet
from gatjax.surrogate.hidden.drive import Drive
from gatjax.surrogate.hidden.numbers import Numbers, stack
from gatjax.surrogate.hidden.plant import PIECE, SETTLE, History, Tape
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Lane, Targets

STEP = 0.0005  # s
OFF = ("ACTUATION", "LIMIT", "FRICTIONLOSS", "SPRING", "DAMPER")
GRAVITY = 9.81


def bare(robot: Robot) -> mujoco.MjModel:
    """The robot without actuators, joint friction and damping."""
    model = mujoco.MjModel.from_xml_string(robot.xml)
    model.opt.timestep = STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    off = OFF if robot.floating else (*OFF, "CONTACT")
    for name in off:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
    return model


def gravity(tilt: np.ndarray) -> np.ndarray:
    """Gravity [L, 3] in the frame of mountings tilted by roll and pitch [L, 2]."""
    roll, pitch = tilt.T
    down = np.stack(
        [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)],
        axis=-1,
    )
    return GRAVITY * down


def _dress(batch: Batch, robot: Robot, numbers: Numbers, armature: np.ndarray) -> None:
    """Writes the specimens' bodies into a batch."""
    batch.expand("body_mass")[:] = numbers["mass"]
    batch.expand("body_ipos")[:] = numbers["centre"]
    batch.expand("body_inertia")[:] = numbers["inertia"]
    batch.expand("dof_armature")[:] = armature
    batch.expand("opt.gravity")[:] = gravity(numbers["tilt"])
    if robot.floating:
        feet.dress(batch, numbers)


def simulate(robot: Robot, lanes: Sequence[Lane]) -> list[History]:
    """Lets L robots run.

    Args:
        robot: their nominal robot.
        lanes: specimens and commands.

    Returns:
        L histories; where a run has diverged they hold NaN.
    """
    specimens = [lane.specimen for lane in lanes]
    numbers = stack(specimens)
    own = numbers["armature"][:, robot.velocity]
    drive = Drive(specimens, own, STEP)
    armature = numbers["armature"].copy()
    armature[:, robot.velocity] = drive.link_armature(own)
    model = bare(robot)
    batch = Batch(model, nsim=len(lanes), nthread=1)
    _dress(batch, robot, numbers, armature)
    targets = Targets(lanes, numbers, STEP)
    qpos, qvel, force = (batch.bind(n) for n in ("qpos", "qvel", "qfrc_applied"))
    batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
    first = np.stack([lane.log.commands[0] for lane in lanes])
    if robot.floating:
        qpos[:] = feet.stand(robot, first)
    else:
        qpos[:] = model.qpos0
        qpos[:, robot.position] = first
        _follow(robot, qpos)
    drive.start(first)
    body = feet.Sensors(robot, batch, numbers) if robot.floating else None
    tape = Tape(lanes, feet.CHANNELS if robot.floating else 0, STEP)
    start, size = round(SETTLE / STEP), round(PIECE / STEP)
    none = np.zeros((len(lanes), 0))
    for index in range(tape.steps):
        if index % size == 0:
            piece = targets.piece(index - start, size)
        angle = qpos[:, robot.position]
        speed = qvel[:, robot.velocity]
        torque = drive.act((index - start) * STEP, piece[index % size], angle, speed)
        if tape.due(index):
            lost = drive.servo.lost().reshape(angle.shape)
            pull = drive.now.torque.reshape(angle.shape)
            felt = body.read() if body else none
            tape.keep(index, (drive.seen(), speed, pull, lost), felt)
        force[:, robot.velocity] = torque
        batch.step()
    return tape.histories()


def _follow(robot: Robot, qpos: np.ndarray) -> None:
    """Sets the joints that follow others [L, nq] (one motor for two hip joints)."""
    model = robot.model
    for row in range(model.neq):
        one, two = model.eq_obj1id[row], model.eq_obj2id[row]
        qpos[:, model.jnt_qposadr[one]] = qpos[:, model.jnt_qposadr[two]]
