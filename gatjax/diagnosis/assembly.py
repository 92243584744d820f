"""Joints put together: a model's numbers, loads and readings on one grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from gatjax.data import sampling, starts, stops
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import laws, noise
from gatjax.diagnosis import loads as weights
from gatjax.diagnosis import motion as motions
from gatjax.diagnosis.joint import (
    GRAVITY,
    NOTHING,
    OBSERVED,
    STEP,
    Assumed,
    Joint,
    Link,
    observed,
)
from gatjax.diagnosis.tolerances import USUAL, Tolerances
from gatjax.effects.gear import GIVE as TEETH
from gatjax.robot.model import servoed

TRANSPORT = 0.0012  # s, nominal way of a command to the servo
CREEP = 0.06  # rad/s, speed at which stiction has faded
UNLIMITED = 1e5  # N m: a limit of that size is none
HARD = 1e5  # N m/rad, of teeth of a motor without a limit
BORNE = 1e-3  # rad of error that a drive without a limit bears at least
GIVE = 3e-4  # rad, that dry friction yields before it slips
SLOW = frozenset({"clock_drift", "thermal_derating"})  # not to be seen in pieces
CAUGHT = 0.5  # s until a drawn joint has made up for a start that is as measured


def nominal_drive(model: mujoco.MjModel, tree: weights.Tree, index: int) -> dict:
    """Numbers of a drive and its joint as the model file gives them."""
    moves = tree.moves[:, index]
    limited = bool(model.actuator_forcelimited[index])
    limit = float(np.abs(model.actuator_forcerange[index]).min()) if limited else np.inf
    gravity = dict(zip(GRAVITY, map(float, model.opt.gravity), strict=True))
    servoed = bool(model.actuator_biasprm[index, 1] != 0.0)
    return gravity | ({} if servoed else observed(OBSERVED)) | {
        "kp": float(model.actuator_gainprm[index, 0]), "hold": float(servoed),
        "kv": float(0.0 - model.actuator_biasprm[index, 2]),
        "limit": min(limit, UNLIMITED),
        "damping": float(np.square(moves) @ model.dof_damping),
        "friction": float(np.abs(moves) @ model.dof_frictionloss),
        "armature": float(np.square(moves) @ model.dof_armature),
        "delay": TRANSPORT, "creep": CREEP, "give": GIVE,
        "rate": 1e3 if servoed else 1e9, "speed": 1e6, "scale": 1.0,
        "cooling": 20.0, "stiffness": min(limit / TEETH, HARD), "ratio": 0.2,
    }  # fmt: skip


def _asked(
    runs: list[JointRun], moved: list[motions.Motion], index: int,
    drive: dict[str, float],
) -> float:  # fmt: skip
    """A torque, N m, that no drive without a limit would have reached in some runs."""
    error = [run.stiff * (run.command - drive["hold"] * run.angle) for run in runs]
    most = drive["kp"] * max(float(np.abs(e[:, index]).max()) for e in error)
    if not drive["hold"]:
        fastest = max(float(np.abs(m.velocity[:, index]).max()) for m in moved)
        most = max(most + drive["kv"] * fastest, drive["kp"])  # one unit at least
    return 1.5 * max(most, drive["kp"] * BORNE)


def supply_load(
    model: mujoco.MjModel,
    tree: weights.Tree,
    moved: list[motions.Motion],
    loads: list[weights.Loads],
) -> list[np.ndarray]:
    """Sum of all servo torques along each motion [M], N m.

    A motor draws current in proportion to its torque, and all share one supply.
    """
    damping = np.square(tree.moves).T @ model.dof_damping
    friction = np.abs(tree.moves).T @ model.dof_frictionloss
    total = []
    for motion, load in zip(moved, loads, strict=True):
        torque = load.nominal.rest + load.nominal.inertia * motion.acceleration
        torque += damping * motion.velocity + friction * np.tanh(motion.velocity / 0.02)
        total.append(np.abs(torque).sum(-1))
    return total


def build(
    model: mujoco.MjModel,
    tree: weights.Tree,
    names: tuple[str, ...],
    runs: list[JointRun],
    moved: list[motions.Motion],
    loads: list[weights.Loads],
    allowed: Tolerances = USUAL,
    assumed: Sequence[Assumed] = (),
) -> list[Joint]:
    """Put the joints of a model on the simulations' grid, runs padded to one length.

    `assumed` says of each joint what is known besides; nothing if left out.
    """
    time = motions.grid_time(runs, STEP, -moved[0].time[0])
    lead = int(np.sum(time < -0.5 * STEP))
    rows = max(len(run.time) for run in runs)
    level = np.hypot(noise.of_joints(runs), [allowed.close(name) for name in names])
    supply = supply_load(model, tree, moved, loads)
    total = assumed[0].supply if assumed else None
    late = [starts.unsettled(run) & servoed(model) for run in runs]
    grids = _grids(runs, moved, loads, _share(supply, total), late)
    at = np.stack([_padded(run.time - run.time[0], rows) for run in runs])
    moving = np.stack([starts.underway(run) for run in runs])
    joints = []
    for index, name in enumerate(names):
        drive = nominal_drive(model, tree, index)
        limited = drive["limit"] < UNLIMITED
        if not limited:
            drive["limit"] = _asked(runs, moved, index, drive)
        more = assumed[index] if assumed else NOTHING
        if any(run.within for run in runs):
            more = more._replace(barred=more.barred | SLOW)
        drive |= more.law(drive["limit"])
        grid = grids(index, drive["armature"])
        if not drive["hold"]:
            speed = moving[None, :, index].astype(np.float32)
            before = np.minimum(grid.clock, 0.0) * speed
            path, reading = grid.path + before, grid.reading + before
            grid = grid._replace(path=path, reading=reading)
        seen = np.stack([_padded(run.angle[:, index], rows) for run in runs])
        valid = np.zeros(seen.shape, bool)
        begun = (moving[:, index] != 0.0) | np.stack(late)[:, index]
        for row, run, wrong in zip(valid, runs, begun, strict=True):
            counted = _free(model, run, index)
            if not drive["hold"]:
                counted &= ~starts.early(run, CAUGHT)
            elif run.within or wrong:
                counted &= ~starts.early(run)
            row[: len(run.time)] = counted
        body = tree.body[index]
        mass, centre = float(model.body_mass[body]), model.body_ipos[body].copy()
        link = Link(mass, centre, tree.axis[index])
        readings = at, seen, valid, float(level[index])
        numbers = name, index, drive, grid, lead, *readings, allowed, link
        joints.append(Joint(*numbers, limited, more))
    return joints


def _grids(
    runs: list[JointRun],
    moved: list[motions.Motion],
    loads: list[weights.Loads],
    supply: list[np.ndarray],
    late: list[np.ndarray],
) -> Callable[[int, float], laws.Grid]:
    """What lies on the simulations' grid, of a joint and the armature of its motor.

    Joints [J] that are `late` in a run begin where they were.
    """
    time = motions.grid_time(runs, STEP, -moved[0].time[0])
    ends = np.array([run.time[-1] - run.time[0] for run in runs])
    at, few = moved[0].time, moved[0].time[:: weights.COARSE]
    clock = np.broadcast_to(time[:, None], (len(time), len(runs)))

    def held(values: list[np.ndarray]) -> list[np.ndarray]:
        """What is in force from each stamp on, of all joints."""
        pairs = zip(runs, values, strict=True)
        return [motions.cells(run.time - run.time[0], v, time) for run, v in pairs]

    before = (time < -0.5 * STEP)[:, None]
    targets = [
        np.where(before & (run.within | rests), run.angle[0], told)
        for run, told, rests in zip(
            runs, held([run.command for run in runs]), late, strict=True
        )
    ]
    shares = held([run.stiff for run in runs])
    readings = [motions.spread(time, r.time - r.time[0], r.angle) for r in runs]
    added = weights.shapes(loads)

    def series(columns: list[np.ndarray], points: np.ndarray = at) -> Any:
        parts = [motions.spread(time, points, column) for column in columns]
        return np.stack(parts, 1).astype(np.float32)

    same = {  # of all joints
        "supply": series(supply),
        "clock": clock.astype(np.float32),
        "running": (clock <= ends).astype(np.float32),
    }

    def terms(index: int, name: str) -> Any:
        """What tolerances, bodies and gravity change of a field of `Load`."""
        kind = weights.Load._fields.index(name)
        columns = [
            np.concatenate(
                [a[kind][:, index], l.bodies[kind, :, index, index],
                 l.gravity[kind, :, index]], -1
            )
            for a, l in zip(added, loads, strict=True)
        ]  # fmt: skip
        return series(columns, few)

    def own(parts: list[np.ndarray], index: int) -> Any:
        return np.stack([each[:, index] for each in parts], 1).astype(np.float32)

    def grid(index: int, armature: float) -> laws.Grid:
        return laws.Grid(
            target=own(targets, index),
            stiffness=own(shares, index),
            path=series([m.position[:, index] for m in moved]),
            reading=own(readings, index),
            rest=series([l.nominal.rest[:, index] for l in loads]),
            pull=series([l.pull[:, index] for l in loads]),
            slope=series([l.nominal.slope[:, index] for l in loads]),
            inertia=series([l.nominal.inertia[:, index] - armature for l in loads]),
            rest_terms=terms(index, "rest"),
            slope_terms=terms(index, "slope"),
            inertia_terms=terms(index, "inertia"),
            **same,
        )

    return grid


def _share(supply: list[np.ndarray], total: float | None) -> list[np.ndarray]:
    """Load of the supply as a share of `total` N m, or of its largest; 1 at most."""
    if total is None:
        total = max(float(load.max()) for load in supply)
    return [np.minimum(load / max(total, 1e-9), 1.0) for load in supply]


def _free(model: mujoco.MjModel, run: JointRun, index: int) -> np.ndarray:
    """Readings [N] of a joint that are free of its stops and of gaps."""
    joint = model.actuator_trnid[index, 0]
    free = ~sampling.after_gaps(run.time, run.command)
    if model.jnt_limited[joint]:
        free &= ~stops.hindered(run, index, *model.jnt_range[joint])
    return free


def _padded(values: np.ndarray, rows: int) -> np.ndarray:
    return np.pad(values, (0, rows - len(values)), mode="edge")
