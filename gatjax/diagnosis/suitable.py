"""Which models can be diagnosed: what the single-joint simulation does not know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from gatjax.data.finding import Finding, cell
from gatjax.data.metadata import ANGLE
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.effects.ground import touching
from gatjax.robot import model as robot_model
from gatjax.sim.limbs import floats
from gatjax.sim.tied import ties

LOST = 100.0  # rad, no servo joint turns that far
MOVING = 0.05  # rad of a command that a joint has to follow
SLACK = 1e-6  # of a command, that rounding may add


def check_model(model: mujoco.MjModel, path: Path) -> None:
    """Refuse robots that cannot be simulated joint by joint.

    Raises:
        ValueError: one line with what is in the way, and what to change.
    """
    if (model.jnt_type[1:] == mujoco.mjtJoint.mjJNT_FREE).any():
        raise ValueError(
            f"{path}: a free joint that is not the robot's base; gatjax diagnose needs "
            f"a model of the robot and its floor alone, its base first"
        )
    bodies = model.geom_bodyid[touching(model)]
    if floats(model) and (model.body_weldid[bodies] != 0).all():
        raise ValueError(
            f"{path}: the base floats (a free joint), and there is no ground to stand "
            f"on; add a plane, or take the free joint out and log the robot hanging"
        )
    closed = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
    if np.isin(model.eq_type, closed).any():
        raise ValueError(
            f"{path}: a connect or weld constraint closes a chain; gatjax diagnose "
            f"needs a tree: cut it open, or tie the joints by <equality><joint/>"
        )
    followers, _, polynomials = ties(model)
    curved = polynomials[:, 2:].any(axis=1)
    if curved.any():
        name = model.joint(int(followers[curved][0])).name
        raise ValueError(
            f"{path}: joint {name!r} follows another one by a curve; gatjax diagnose "
            f"takes straight lines: give polycoef two numbers, offset and ratio"
        )
    if model.nu == 0:
        raise ValueError(
            f"{path}: no actuators; give every driven joint one (a URDF has none: save "
            f"it as MJCF and add <position joint=... kp=...>)"
        )
    robot_model.joint_names(model)
    _check_drives(model, path)
    angles = model.actuator_biasprm[:, 1] != 0.0
    if not angles.all() and (angles.any() or floats(model)):
        raise ValueError(
            f"{path}: only some actuators are position servos; gatjax diagnose takes "
            f"either servos at all joints, or, on a fixed base, motors at all"
        )


def _check_drives(model: mujoco.MjModel, path: Path) -> None:
    """Refuse actuators that are neither servos nor motors of a hinge, at its side."""
    kp, position = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1]
    plain = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)
    is_drive = (
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & np.isin(model.actuator_biastype, plain)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
        & (kp > 0.0)
        & (np.isclose(kp, -position) | (position == 0.0))
    )
    joints = model.actuator_trnid[:, 0]
    shared = np.array([(joints[:k] == joint).any() for k, joint in enumerate(joints)])
    apart = (model.actuator_damping != 0.0) | (model.actuator_armature != 0.0)
    curved = model.dof_dampingpoly[model.jnt_dofadr[joints]].any(axis=1)
    hinge = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE
    low, high = model.actuator_forcerange.T
    lopsided = model.actuator_forcelimited.astype(bool) & ~np.isclose(-low, high)
    for wrong, text in (
        (~is_drive, 'is no drive that gatjax diagnose knows; it takes <position '
         'kp=".." kv=".."/>, <motor/> for torques and <general gainprm="kt/R" '
         'biastype="affine" biasprm="0 0 -kt^2/R"/> for voltages'),
        (~hinge, "drives no hinge; angles, units and thresholds of gatjax diagnose "
         "are those of hinges: lock other joints, or leave them out"),
        (~np.isclose(model.actuator_gear[:, 0], 1.0), "has a gear; take it out, and "
         "give kp, kv and forcerange as the joint feels them"),
        (shared, "drives a joint that another one drives, too; logs have one command "
         "of each joint: put both together"),
        (apart | model.actuator_dampingpoly.any(axis=1), "has damping or armature of "
         "its own; add them to those of its joint"),
        (curved, "drives a joint whose damping is a polynomial; give it one number"),
        (model.actuator_delay > 0.0, "has a delay; take it out, and give the "
         "world.json that knows it as --world"),
        (lopsided, "has a torque limit (forcerange, or actuatorfrcrange of its joint) "
         "that is not symmetric; give the smaller limit on both sides"),
    ):  # fmt: skip
        if wrong.any():
            name = model.actuator(int(np.flatnonzero(wrong)[0])).name
            raise ValueError(f"{path}: actuator {name!r} {text}")


def check_commands(model: mujoco.MjModel, recording: Recording) -> None:
    """Refuse a log whose commands are not what the model's actuators take.

    Raises:
        ValueError: one line with what to change.
    """
    stiff = {c: v for c, v in recording.columns.items() if c.startswith("stiffness.")}
    changed = next((c for c, v in stiff.items() if (v != 1.0).any()), None)
    if changed and floats(model):
        raise ValueError(
            f"{recording.name}: column {changed!r} is not 1 all the time; of a robot "
            f"that stands gatjax takes the model's gains only: log it hanging"
        )
    unit = recording.command_unit
    if robot_model.servoed(model) == (unit == ANGLE):
        return
    drive = "position servos" if unit != ANGLE else "no position servos"
    raise ValueError(
        f"{recording.name}: commands are in {unit}, but the model has {drive}; say "
        f"what they are by a map (command.<joint>: {{unit: N m}} or V), or give the "
        f"model the actuators of the robot: <position>, <motor> or <general>"
    )


def check_ranges(model: mujoco.MjModel, recording: Recording) -> list[Finding]:
    """Commands beyond the control range of their actuators, of a checked recording."""
    found = []
    names, ranges = robot_model.joint_names(model), robot_model.command_range(model)
    for name, low, high in zip(names, *ranges, strict=True):
        column = f"command.{name}"
        values = recording.columns[column]
        out = np.flatnonzero((values < low - SLACK) | (values > high + SLACK))
        if out.size:
            text = (
                f"{cell(recording, out[0], column)}: {values[out[0]]:.3g} lies beyond "
                f"the ctrlrange {low:.3g} to {high:.3g} of the model's actuator "
                f"({out.size} such rows), which takes no more than that; does the robot"
                f" clip its commands too? If not, change the model"
            )
            found.append(Finding("warning", "limits", text, {name: float(out.size)}))
    return found


def check_replay(
    source: str, recordings: Sequence[Recording], runs: Sequence[JointRun],
    predicted: Sequence[np.ndarray], servos: bool,
) -> None:  # fmt: skip
    """Refuse a model that falls apart on the commands of the logs.

    Args:
        source: of the model, for the message.
        recordings: in the order of the runs.
        runs: all their trajectories.
        predicted: open-loop angles [N, J] rad of the model at the rows of each run.
        servos: whether they hold it; motors may carry it far away.

    Raises:
        ValueError: one line with file, trajectory and time.
    """
    names = [r.name for r in recordings for _ in np.unique(r.trajectory)]
    for name, run, angle in zip(names, runs, predicted, strict=True):
        lost = np.asarray(~np.all(np.abs(angle) < (LOST if servos else np.inf), axis=1))
        same = (angle == angle[-1]) | ~np.isfinite(angle)
        still = np.all(same, axis=1)  # physics that gave up repeat a row
        begin = len(still) - int(np.argmin(still[::-1])) if not still.all() else 0
        if servos and np.ptp(run.command[begin:], axis=0).max(initial=0.0) > MOVING:
            lost[begin:] = True
        if lost.any():
            seconds = run.time[int(np.argmax(lost))] - run.time[0]
            raise ValueError(
                f"{source}: its simulation falls apart {seconds:.2f} s into trajectory "
                f"{run.trajectory} of {name}; look for inertias or an armature that "
                f"are too small for kp and kv, and for links that start inside others"
            )


def cautions(model: mujoco.MjModel) -> Iterator[str]:
    """What a user should know of a model that can be diagnosed, a line each."""
    driven = {*model.actuator_trnid[:, 0]}
    followers, leaders, _ = ties(model)
    driven |= {*followers[np.isin(leaders, list(driven))]}
    free = [
        model.joint(k).name or f"number {k}"
        for k in range(model.njnt)
        if k not in driven and model.jnt_type[k] != mujoco.mjtJoint.mjJNT_FREE
    ]
    if free:
        yield (
            f"joint {', '.join(free)} is not driven, and taken to stand still at its "
            f"zero; if it moves, log and drive it, or weld it"
        )
