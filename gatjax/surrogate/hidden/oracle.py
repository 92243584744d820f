"""What the nominal file, and one that knows the effect, reach on held-out motion."""

from __future__ import annotations

import mujoco
import numpy as np

from gatjax.surrogate.hidden.design import Case
from gatjax.surrogate.hidden.feet import stand
from gatjax.surrogate.hidden.measure import positions
from gatjax.surrogate.hidden.plant import History
from gatjax.surrogate.hidden.robots import Robot
from gatjax.surrogate.hidden.targets import Lane, Log

SETTLE = 1.0  # s


def nominal_run(robot: Robot, log: Log) -> np.ndarray:
    """Joint angles [K, J] rad of the nominal file in plain MuJoCo."""
    model = robot.model
    data, step = mujoco.MjData(model), model.opt.timestep
    place = robot.position
    if robot.floating:
        data.qpos[:] = stand(robot, log.commands[:1])[0]
    else:
        data.qpos[place] = log.commands[0]
    data.ctrl[:] = log.commands[0]
    mujoco.mj_step(model, data, round(SETTLE / step))
    count = round(log.times[-1] / step) + 2
    moments = step * np.arange(count)
    rows = np.searchsorted(log.times, moments + 1e-9, side="right") - 1
    angles = np.empty((count, len(place)))
    for index, row in enumerate(rows):
        angles[index] = data.qpos[place]
        data.ctrl[:] = log.commands[row]
        mujoco.mj_step(model, data)
    return np.column_stack([np.interp(log.times, moments, a) for a in angles.T])


def oracle(
    case: Case,
    log: dict[str, np.ndarray],
    lanes: list[Lane],
    histories: list[History],
) -> dict[str, float]:
    """RMS errors of all joint positions on the held-out motion, rad."""
    joints = case.robot.joints
    measured = np.column_stack([log[f"position.{name}"] for name in joints])
    before = measured - nominal_run(case.robot, case.held)
    floor = measured - positions(lanes[0], histories[0])
    after = measured - positions(lanes[1], histories[1])
    if not case.effects:
        after = before
    touched = sorted({joint for effect in case.effects for joint in effect.joints})
    touched = touched or list(range(len(joints)))
    errors = {
        "before": before,
        "after": after,
        "noise_floor": floor,
        "before_where": before[:, touched],
        "after_where": after[:, touched],
    }
    found = {name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}
    return {**found, "gain": 1.0 - found["after"] / found["before"]}
