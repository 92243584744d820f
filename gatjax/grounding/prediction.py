"""How well a world predicts the robot: open-loop replay of held-out recordings."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gatjax.data.recording import Recording
from gatjax.data.trajectories import to_arrays
from gatjax.grounding.posture import torso_poses
from gatjax.grounding.transitions import HISTORY
from gatjax.records import JOINTS
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim.backend import Backend
from gatjax.sim.causes import reported_late
from gatjax.sim.limbs import moving
from gatjax.sim.native import Native
from gatjax.sim.world import World

Array = Any
HORIZON = 0.5  # s
SOON = 0.2  # s, of predictions that something is fitted to
WARM = 0.12  # s that fill an effect's memory, and HISTORY + 1 samples at least


class Windows(NamedTuple):
    """Pieces of recordings to be replayed."""

    command: Array  # [W, T, J] rad
    angle: Array  # [W, T + 1, J] rad, recorded
    warm: Array  # [W, L, J] rad, where the joints were before the physics starts
    qpos: Array  # [W, nq] physics state at the sample after that
    qvel: Array  # [W, nv]
    row: Array  # [W] int, of the recording: the last sample that is known
    known: int  # samples before that one


def _spin(before: Array, after: Array, seconds: float) -> Array:
    """Angular velocity [W, 3] rad/s in the body frame between two attitudes."""
    w, v = before[:, :1], -before[:, 1:]  # conjugate
    vector = w * after[:, 1:] + after[:, :1] * v + np.cross(v, after[:, 1:])
    scalar = w[:, 0] * after[:, 0] - (v * after[:, 1:]).sum(-1)
    return 2.0 * vector * np.sign(scalar)[:, None] / seconds


def _slope(samples: Array, seconds: float) -> Array:
    """Rate of change [W, ...] at the last of three samples [W, 3, ...], a second."""
    first, middle, last = samples[:, 0], samples[:, 1], samples[:, 2]
    return (3.0 * last - 4.0 * middle + first) / (2.0 * seconds)


def _state(world: World, angle: Array, base: Array, seconds: float) -> tuple:
    """Physics state [W, nq], [W, nv] at the last of three samples [W, 3, ...].

    Velocities are backward differences, of second order but for the spin: the samples
    that are to be predicted must not enter the state.
    """
    model = world.model
    qpos = np.zeros((len(angle), model.nq))
    qvel = np.zeros((len(angle), model.nv))
    qpos[:, :7] = base[:, 2]
    qvel[:, :3] = _slope(base[..., :3], seconds)
    qvel[:, 3:6] = _spin(base[:, 1, 3:], base[:, 2, 3:], seconds)
    return moving(model, qpos, qvel, angle[:, 2], _slope(angle, seconds))


def base_poses(world: World, recording: Recording, angle: Array) -> Array:
    """Torso poses [N, 7] of a recording: position m, quaternion w x y z.

    A robot seldom knows them: without `base.*` columns they are `torso_poses`.

    Args:
        world: whose model stands on the floor.
        recording: of N rows.
        angle: [N, J] rad, of its joints.
    """
    names = [f"base.{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    columns = recording.columns
    if all(name in columns for name in names):
        return np.stack([columns[name] for name in names], axis=-1)
    return torso_poses(world.model, recording, angle, world.task.control_period)


def warming(seconds: float) -> int:
    """Samples, `seconds` apart, before the one from which on is predicted."""
    return max(HISTORY + 1, round(WARM / seconds))


def shortest(seconds: float) -> int:
    """Rows that a trajectory must have more than to be cut, `seconds` apart."""
    return warming(seconds) + round(HORIZON / seconds) + 1


def _seen(joints: Array, late: Array) -> tuple[Array, int]:
    """Where joints were at samples [N, J] of a run that encoders report late.

    Args:
        joints: [N, J] rad, as reported.
        late: [J] samples.

    Returns:
        The angles, the last ones held, and how many samples those reach back.
    """
    if not late.any():
        return joints, 0
    rows = np.arange(len(joints))
    at = np.minimum(rows[:, None] + late, rows[-1])
    moved = [CubicSpline(rows, own)(when)
             for own, when in zip(joints.T, at.T, strict=True)]  # fmt: skip
    angles = np.stack(moved, axis=-1)
    return angles, int(np.ceil(late.max() - 1e-9)) + 1


def cut(
    world: World, recording: Recording, held_out: Array, count: int, seed: int
) -> Windows:
    """Draw windows of the warm-up plus 0.5 s from held-out trajectories.

    The joints are where the world's encoders report what was recorded. Where they
    report late, the physics starts so long before the last sample that is known.

    Args:
        world: whose model is replayed; its control period must be the recording's.
        recording: of a floating-base robot.
        held_out: ids of trajectories that nothing was fitted to.
        count: windows in all.
        seed: of the draw.
    """
    seconds = world.task.control_period
    length, warm = shortest(seconds) - 1, warming(seconds)
    late = reported_late(world.model, world.causes) / seconds
    recorded = np.stack([recording.columns[f"position.{j}"] for j in JOINTS], axis=-1)
    turned = Native(world).behind(world.values, recorded)
    base = base_poses(world, recording, turned)
    generator = np.random.default_rng(seed)
    runs = [
        (run, np.flatnonzero(recording.trajectory == run.trajectory))
        for run in to_arrays(recording, JOINTS)
        if run.trajectory in held_out and len(run.time) > shortest(seconds)
    ]
    if not runs:
        raise ValueError("no held-out trajectory is long enough to test predictions on")
    pieces = []
    for number in range(count):
        run, rows = runs[number % len(runs)]
        first = generator.integers(0, len(run.time) - length)
        now = first + warm  # the last sample that is known
        joints, back = _seen(turned[rows[first : now + 1]], late)
        start = warm - min(back, warm - 2)  # here the physics does
        pieces.append(
            (
                run.command[first : first + length],
                run.angle[first : first + length + 1],
                joints[:start],
                joints[start - 2 : start + 1],
                base[rows[first + start - 2 : first + start + 1]],
                rows[now],
            )
        )
    command, angle, before, joints, pose, row = (
        np.stack(part) for part in zip(*pieces, strict=True)
    )
    qpos, qvel = _state(world, joints, pose, seconds)
    return Windows(command, angle, before, qpos, qvel, row, warm)


def errors(backend: Backend, values: Any, windows: Windows, seconds: float) -> dict:
    """RMS error of the walking joints at one step and at 0.5 s.

    Returns:
        {(joint, horizon in s): error in rad}.
    """
    error = _wrong(backend, values, windows, windows.command.shape[1] - windows.known)
    found = {}
    for steps in (1, error.shape[1]):
        rms = np.sqrt(np.mean(error[:, steps - 1] ** 2, axis=0))
        for joint, index in zip(WALKING_JOINTS, WALKING, strict=True):
            found[joint, round(steps * seconds, 6)] = float(rms[index])
    return found


def error_soon(
    backend: Backend, values: Any, windows: Windows, seconds: float
) -> float:
    """RMS error in rad over the next 0.2 s, all walking joints; inf if it diverges.

    What is not known of the torso makes a robot fall another way, which motors do not
    tell of: later predictions blame them for it.
    """
    error = _wrong(backend, values, windows, round(SOON / seconds))
    square = np.mean(error[..., WALKING] ** 2)
    return float(np.sqrt(square)) if np.isfinite(square) else np.inf


def _wrong(backend: Backend, values: Any, windows: Windows, steps: int) -> Array:
    """Predicted minus recorded angles [W, steps, J] rad."""
    start = windows.warm, windows.qpos, windows.qvel
    known, early = windows.known, windows.known - windows.warm.shape[1]
    command = windows.command[:, : known + steps]
    predicted = np.asarray(backend.replay(values, command, *start))
    return predicted[:, early:] - windows.angle[:, known + 1 : known + 1 + steps]
