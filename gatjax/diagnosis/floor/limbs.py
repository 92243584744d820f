"""Limbs of a standing robot that touch nothing: they show what is wrong with them.

What such a limb carries is known from its measured motion, as that of a robot in the
air is (`gatjax.diagnosis.loads`), on a base that moves as simulated.
"""

from __future__ import annotations

import mujoco

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis.floor.played import LIFT, SETTLE
from gatjax.diagnosis.floor.weights import Trace
from gatjax.diagnosis.loads import Load, Loads, Tree, weigh
from gatjax.diagnosis.motion import Motion
from gatjax.sim.limbs import put_down

STEP = 0.002  # s, at most


def free(tree: Tree, runs: list[JointRun]) -> frozenset[int]:
    """Joints beyond which nothing touches anything while the nominal robot moves.

    None if all of them are: then they have to tell of the ground, too.

    Args:
        tree: of the model, its base floating.
        runs: the commands.
    """
    model, held = tree.model, set()
    for run in runs:
        for body in _touched(model, run):
            while body:
                held.add(body)
                body = int(model.body_parentid[body])
    turned = [set(model.dof_bodyid[dofs != 0.0].tolist()) for dofs in tree.moves.T]
    found = frozenset(k for k, own in enumerate(turned) if held.isdisjoint(own))
    return found if len(found) < len(turned) else frozenset()


def _touched(model: mujoco.MjModel, run: JointRun) -> set[int]:
    """Bodies that touch another one, or the ground, in a run."""
    model = mujoco.MjModel.__copy__(model)
    model.opt.timestep = min(model.opt.timestep, STEP)
    data, found = mujoco.MjData(model), set()
    data.qpos[:] = put_down(model, run.command[0])
    data.qpos[2] += LIFT
    data.ctrl[:] = run.command[0]
    until = SETTLE + run.time - run.time[0]
    for stamp, command in zip(until, run.command, strict=True):
        while data.time < stamp:
            mujoco.mj_step(model, data)
            found.update(model.geom_bodyid[data.contact.geom].ravel().tolist())
        data.ctrl[:] = command
    return found


def along_limbs(
    tree: Tree, own: list[int], limbs: Motion, trace: Trace, loads: Loads
) -> tuple[Motion, Loads]:
    """A trace some of whose joints move as measured, and the loads of both.

    Args:
        tree: of the model.
        own: joints that move as measured, of free limbs.
        limbs: the measured motion, at the points of the trace.
        trace: of the robot.
        loads: along the trace, and what the feet were pushed by; those of the limbs
            are replaced.
    """
    series = {}
    for name in ("position", "velocity", "acceleration"):
        series[name] = getattr(trace.motion, name).copy()
        series[name][:, own] = getattr(limbs, name)[:, own]
    motion = trace.motion._replace(**series)
    over = weigh(tree, motion, [tree.model])
    shaken = loads.nominal.rest - trace.load.rest
    over.nominal.rest[:, own] += shaken[:, own]
    nominal = [each.copy() for each in loads.nominal]
    for mine, other in zip(nominal, over.nominal, strict=True):
        mine[:, own] = other[:, own]
    loads.pull[:, own] = over.pull[:, own]
    loads.bodies[:, :, own] = over.bodies[:, :, own]
    loads.gravity[:, :, own] = over.gravity[:, :, own]
    return motion, loads._replace(nominal=Load(*nominal))
