"""The stand-in robot `stiff`: MuJoCo C at 0.5 ms with its native motors and delays.

The nominal model is rewritten: `dcmotor` actuators (voltage clamp, back EMF, net torque
limit), dry friction, an uneven height field, and delay buffers for the commands and the
sensors. Play, encoder steps and offsets are the servo's, which reads the encoders every
1 ms and hands the motors a target. A native delay of those targets would delay the
encoder as well, so each command runs through a delay line of its own: an actuator with
gear 0, which moves nothing and whose force is the command that has arrived.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import lru_cache

import mujoco
import numpy as np
from mujoco.batch import Batch

from gatjax.records import JOINTS, Base, Reading
from gatjax.robot import nao
from gatjax.robot.model import slots
from gatjax.surrogate.e1 import E1, Body, inertials
from gatjax.surrogate.hung import hung_state
from gatjax.surrogate.servo import encode, error, servo
from gatjax.surrogate.standin import Engine
from gatjax.surrogate.start import Floor, Run, first_state, series
from gatjax.task import Task

STEP = 0.0005  # s, physics
SERVO_STEPS = 2  # physics steps in a servo period of 1 ms
BATTERY = 21.6  # V, nominal; only its products with the motor constants matter [S6]
LINE = "command."  # prefix of the delay lines
FLOOR_BASE = 0.1  # m, thickness of the floor under its lowest point
ROOT = 6  # degrees of freedom of the torso
HELD = 1e9  # kg, kg m^2: inertia that holds a torso where it is
CLOSE = 1e-15  # the solver's tolerance beside it, which goes by the mean inertia


def _numbers(*values: float | int) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _motors(root: ElementTree.Element) -> None:
    """Replace the position servos by `dcmotor` and add the delay lines."""
    actuators = root.find("actuator")
    if actuators is None:
        raise ValueError("the nominal model has no actuators; give it position servos")
    actuators.clear()
    motors, count = servo(E1), round(E1.command_delay / STEP)
    for index, (joint, motor) in enumerate(zip(JOINTS, nao.MOTORS, strict=True)):
        share = motors.push[index] / motor.stall_torque
        actuators.append(
            ElementTree.Element(
                "dcmotor", name=joint, joint=joint, input="pos",
                nominal=_numbers(BATTERY, motor.stall_torque, motor.no_load_speed),
                controller=_numbers(
                    motors.gain[index], 0, motors.damping[index], 0, 0, share * BATTERY
                ),
                saturation=_numbers(motors.limit[index], 0, 0),
            )
        )  # fmt: skip
    for joint in JOINTS:
        # Forces are seen one physics step late, so the line is one step shorter.
        actuators.append(
            ElementTree.Element(
                "general", name=LINE + joint, joint=joint, gear="0",
                nsample=str(count - 1), delay=_numbers((count - 1) * STEP),
            )
        )  # fmt: skip


def _joints(root: ElementTree.Element) -> None:
    """Move the back EMF into the motors; add dry friction."""
    for default in root.iter("default"):
        for servo_default in default.findall("position"):
            default.remove(servo_default)
        for joint in default.findall("joint"):
            joint.attrib.pop("damping", None)
    friction: dict[str, float] = dict(zip(JOINTS, servo(E1).friction, strict=True))
    friction["LHipYawPitch"] *= 0.5  # one motor, half of it on each side
    friction["RHipYawPitch"] = friction["LHipYawPitch"]
    for joint in root.iter("joint"):
        if joint.get("name") in friction and joint.get("axis"):
            joint.set("frictionloss", _numbers(friction[joint.get("name", "")]))


def _ground(root: ElementTree.Element, floor: Floor) -> None:
    """Replace the plane by a height field of the floor's size; soles touch it alike."""
    low, high, half = floor.height.min(), floor.height.max(), 0.5 * E1.floor_side
    count = str(floor.height.shape[0])
    touch = {
        "friction": _numbers(E1.floor_friction, 0.005, 0.0001),
        "solref": _numbers(E1.floor_time_constant, 1),
    }
    for geom in root.iter("geom"):
        if geom.get("name") == "floor":
            geom.attrib.pop("material", None)
            geom.attrib.update(
                touch, type="hfield", hfield="floor", pos=_numbers(0, 0, low)
            )
            geom.attrib.pop("size")
        elif geom.get("type") == "sphere" and geom.get("conaffinity"):
            geom.attrib.update(touch)
    assets = root.find("asset")
    if assets is None:
        assets = ElementTree.SubElement(root, "asset")
    size = _numbers(half, half, high - low, FLOOR_BASE)
    ElementTree.SubElement(
        assets, "hfield", name="floor", nrow=count, ncol=count, size=size
    )


def _sensors(root: ElementTree.Element) -> None:
    """Add joint angles and delay all sensors."""
    sensors = root.find("sensor")
    if sensors is None:
        raise ValueError("the nominal model has no sensors; give it feet and IMU")
    for joint in JOINTS:
        ElementTree.SubElement(sensors, "jointpos", name=joint, joint=joint)
    count = round(E1.sensor_delay / STEP) - 1  # values are seen one step late
    for sensor in sensors:
        sensor.set("nsample", str(count))
        sensor.set("delay", _numbers(count * STEP))


def build(body: Body, floor: Floor) -> mujoco.MjModel:
    """Return the model of a drawn robot on its floor."""
    root = ElementTree.parse(nao.MODEL_FILE).getroot()
    for edit in (_motors, _joints, _sensors):
        edit(root)
    _ground(root, floor)
    option = root.find("option")
    if option is not None:
        solver = {"iterations": "20", "ls_iterations": "20"}
        option.attrib.update(solver, timestep=_numbers(STEP))
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, "unicode"))
    low, high = floor.height.min(), floor.height.max()
    # Rows of a height field run along y, columns along x.
    model.hfield_data[:] = ((floor.height.T - low) / (high - low)).ravel()
    weights = inertials(body)
    model.body_mass[1:], model.body_ipos[1:] = weights.mass, weights.centre
    for link, inertia in enumerate(weights.inertia, start=1):
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        model.body_inertia[link] = moments
        mujoco.mju_mat2Quat(model.body_iquat[link], axes.ravel())
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


class Flock:
    """N robots of one body on one floor; a `course.Machine`."""

    def __init__(
        self, body: Body, floor: Floor, runs: list[Run], poses: np.ndarray, task: Task
    ) -> None:
        """Put N robots down with joint angles `poses` [N, J] rad."""
        model = self._built(body.seed)
        self.body, self.patch = body, np.stack([run.patch for run in runs])
        self.periods = round(task.control_period / (STEP * SERVO_STEPS))
        joints = len(JOINTS)
        place = slots(model)
        self.angle, self.sensor = place.position[:joints], place
        first = int(model.sensor(JOINTS[0]).adr[0])
        self.joint_sensor = slice(first, first + joints)
        self.motor, self.line = slice(0, joints), slice(joints, 2 * joints)
        # a run that diverges must stay so: MuJoCo would set it up again, standing
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        batch = self.batch = Batch(model, nsim=len(runs), nthread=1)
        self.qpos, self.ctrl = batch.bind("qpos"), batch.bind("ctrl")
        self.arrived = batch.bind("actuator_force")
        self.sensordata = batch.bind("sensordata")
        self.seen = self._put_down(model, floor, runs, poses)
        self.fresh = True

    @staticmethod
    def _built(body_seed: int) -> mujoco.MjModel:
        return _model(body_seed)

    @staticmethod
    def _first(pose: np.ndarray, run: Run, floor: Floor) -> tuple:
        return first_state(pose, run, floor)

    def _put_down(
        self, model: mujoco.MjModel, floor: Floor, runs: list[Run], poses: np.ndarray
    ) -> np.ndarray:
        """Set the first states with full delay buffers; return what sensors feel."""
        qvel, history = self.batch.bind("qvel"), self.batch.bind("history")
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        seen = np.zeros((len(runs), model.nsensordata))
        data = mujoco.MjData(model)
        for index, (run, pose) in enumerate(zip(runs, poses, strict=True)):
            qpos, speed = self._first(pose, run, floor)
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = qpos, speed
            data.ctrl[self.motor], data.ctrl[self.line] = qpos[self.angle], pose
            felt = _undelayed(model, data)
            _fill(model, data, np.tile(pose, 2), felt)
            self.qpos[index], qvel[index] = qpos, speed
            self.ctrl[index], history[index] = data.ctrl, data.history
            seen[index] = felt
        return seen

    def sense(self) -> Reading:
        """Return what was true one sensor delay ago; see `course.Machine`."""
        data = self.seen if self.fresh else self.sensordata
        return Reading(
            angle=data[:, self.joint_sensor].copy(),
            gyro=data[:, self.sensor.gyro].copy(),
            accelerometer=data[:, self.sensor.accelerometer].copy(),
            force=data[:, self.sensor.force].copy(),
        )

    def base(self) -> Base:
        """Return where the torsos are; see `course.Machine`."""
        position = self.qpos[:, :3].copy()
        position[:, :2] -= self.patch
        return Base(position, self.qpos[:, 3:7].copy())

    def advance(self, target: np.ndarray, alive: np.ndarray) -> None:
        """Run for one control tick; see `course.Machine`."""
        ids = np.flatnonzero(alive).astype(np.int32)
        arrived = self.ctrl[:, self.line] if self.fresh else self.arrived[:, self.line]
        arrived = arrived.copy()
        self.ctrl[:, self.line] = target
        for _ in range(self.periods):
            angle = self.qpos[:, self.angle]
            seen = error(E1, arrived, encode(E1, angle, self.body.offset))
            self.ctrl[:, self.motor] = angle + seen
            self.batch.step(ids=ids, nstep=SERVO_STEPS)
            arrived = self.arrived[:, self.line]
        self.fresh = False


class HungFlock(Flock):
    """The same robots, their torsos held in the air."""

    @staticmethod
    def _built(body_seed: int) -> mujoco.MjModel:
        model = mujoco.MjModel.__copy__(_model(body_seed))
        model.dof_armature[:ROOT] = HELD
        model.opt.tolerance = CLOSE
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    @staticmethod
    def _first(pose: np.ndarray, run: Run, floor: Floor) -> tuple:
        return hung_state(pose, run, floor)


def _undelayed(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return what the sensors would say at once, without their delay."""
    held = model.sensor_delay.copy()
    model.sensor_delay[:] = 0.0
    mujoco.mj_forward(model, data)
    model.sensor_delay[:] = held
    return data.sensordata.copy()


def _fill(
    model: mujoco.MjModel, data: mujoco.MjData, command: np.ndarray, felt: np.ndarray
) -> None:
    """Fill the delay buffers: `command` [2 J] rad, `felt` [nsensordata]."""
    for index in np.flatnonzero(model.actuator_history[:, 0]):
        count = model.actuator_history[index, 0]
        values = np.full((count, 1), command[index])
        mujoco.mj_initCtrlHistory(model, data, index, None, values)
    for index in range(model.nsensor):
        first, size = model.sensor_adr[index], model.sensor_dim[index]
        count = model.sensor_history[index, 0]
        values = np.tile(felt[first : first + size], (count, 1))
        mujoco.mj_initSensorHistory(model, data, index, None, values, 0.0)


@lru_cache(maxsize=2)
def _model(body_seed: int) -> mujoco.MjModel:
    return build(*series(body_seed))


ENGINE = Engine("MuJoCo C, 0.5 ms", Flock, HungFlock, together=32)
