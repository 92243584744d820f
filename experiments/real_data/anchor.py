"""The anchor: `mujoco.sysid` fits what MJCF says of a joint, all joints at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from gatjax.data.trajectories import JointRun
from gatjax.robot import model as robot_model

STEP = 0.002  # s
ITERATIONS = 20
BOUNDS = {  # as wide as a small servo can be: kg m^2, N m, N m/rad, N m s/rad
    "armature": (1e-4, 0.3),
    "frictionloss": (0.0, 1.5),
    "stiffness": (0.0, 5.0),
    "damping": (0.0, 5.0),
}


def check() -> None:
    """Refuse to begin without what `mujoco.sysid` needs."""
    if not hasattr(sysid, "optimize"):
        raise SystemExit(
            "mujoco.sysid lacks its own requirements; install them with "
            "pip install -c constraints.txt 'mujoco[sysid]'"
        )


def fitted(source: Path, runs: list[JointRun], out: Path) -> Path:
    """Write the model whose open-loop roll-outs of runs are nearest, and name it.

    Args:
        source: model file with one position servo at each joint.
        runs: of these joints, in the order of its actuators.
        out: the model that is written.
    """
    if out.is_file():
        return out
    spec = mujoco.MjSpec.from_file(str(source))
    spec.option.timestep = STEP
    names = robot_model.joint_names(spec.compile())
    for name in names:
        spec.add_sensor(
            name=f"{name}_angle", type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name,
        )  # fmt: skip
    model = spec.compile()
    parts = [_sequence(model, run) for run in runs]
    measured = sysid.ModelSequences(
        "robot", spec, [f"run_{k}" for k in range(len(runs))], *zip(*parts, strict=True)
    )
    numbers = _numbers(spec, names)
    best, _ = sysid.optimize(
        numbers, sysid.build_residual_fn(models_sequences=[measured]),
        max_iters=ITERATIONS, verbose=False,
    )  # fmt: skip
    sysid.apply_param_modifiers_spec(best, spec)
    spec.compile()
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(spec.to_xml())
    return out


def _sequence(model: mujoco.MjModel, run: JointRun) -> tuple[Any, Any, Any]:
    """First state, commands as they were held, and angles of a run."""
    stamps = run.time - run.time[0]
    even = np.arange(0.0, stamps[-1], STEP)
    held = np.searchsorted(stamps, even + 0.25 * STEP, side="right") - 1
    state = sysid.create_initial_state(model, run.command[0], np.zeros(model.nv))
    seen = np.stack([np.interp(even, stamps, column) for column in run.angle.T], 1)
    return (
        state, sysid.TimeSeries(even, run.command[held]),
        sysid.TimeSeries.from_names(even, seen, model),
    )  # fmt: skip


def _numbers(spec: Any, names: tuple[str, ...]) -> Any:
    """One parameter for each number of a joint, from what the model says."""
    numbers = sysid.ParameterDict()
    for name in names:
        for field, (low, high) in BOUNDS.items():

            def put(
                changed: Any, parameter: Any, name: str = name, field: str = field
            ) -> None:
                joint = changed.joint(name)
                linear = np.array(getattr(joint, field), float)  # first of a polynomial
                linear[(0,) * linear.ndim] = parameter.value[0]
                setattr(joint, field, linear if linear.ndim else float(linear))

            inside = 0.01 * (high - low)  # a start on a bound would stay there
            now = float(np.ravel(getattr(spec.joint(name), field))[0])
            start = float(np.clip(now, low + inside, high - inside))
            numbers.add(sysid.Parameter(f"{name} {field}", start, low, high,
                                        modifier=put))  # fmt: skip
    return numbers
