"""What bodies add to the forces at joints, against MuJoCo's inverse dynamics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gatjax.diagnosis.regressor import Swing, inertials, shifts

ROBOT = """
<mujoco>
  {flag}
  <worldbody>
    <body name="base" pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.06 0.04" pos="0.02 0 0.01" mass="2"/>
      <body name="arm" pos="0.1 0.02 0" euler="20 0 40" gravcomp="0.3">
        <joint axis="0.2 1 0.3" pos="0 0.01 0.02"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0.05 0.1" mass="0.7"/>
        <body name="hand" pos="0.2 0.05 0.1" quat="0.9 0.1 0.4 0.1">
          <joint type="ball"/>
          <geom type="ellipsoid" size="0.05 0.03 0.02" pos="0.03 0 0.01" mass="0.3"/>
          <body name="finger" pos="0.06 0 0">
            <joint type="slide" axis="1 0.5 0"/>
            <geom type="box" size="0.02 0.01 0.01" pos="0 0.01 0" mass="0.1"/>
          </body>
        </body>
      </body>
    </body>
    <body name="other" pos="1 0 0">
      <joint axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.5"/>
    </body>
  </worldbody>
</mujoco>
"""
WEIGHTLESS = '<option><flag gravity="disable"/></option>'


def robot(flag: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ROBOT.format(flag=flag))


def motion(model: mujoco.MjModel, count: int) -> list[np.ndarray]:
    draw = np.random.default_rng(1)
    qpos = np.tile(model.qpos0, (count, 1))
    for row in qpos:
        mujoco.mj_integratePos(model, row, draw.normal(size=model.nv), 1.0)
    return [qpos, *3.0 * draw.normal(size=(2, count, model.nv))]


def taken(model: mujoco.MjModel, at: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Forces [N, nv] that bodies take, and inertias [N, nv, nv], by MuJoCo."""
    data, forces, inertias = mujoco.MjData(model), [], []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*at, strict=True):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        force, inertia = np.empty(model.nv), np.empty((model.nv, model.nv))
        mujoco.mj_rne(model, data, 1, force)
        mujoco.mj_fullM(model, data, inertia)
        forces.append(force - data.qfrc_gravcomp)
        inertias.append(inertia)
    return np.stack(forces), np.stack(inertias)


@pytest.mark.parametrize("flag", ["", WEIGHTLESS])
def test_forces_and_inertias_of_bodies_are_those_of_mujoco(flag: str) -> None:
    """Those of all bodies added up, each joint by itself and moved together."""
    model = robot(flag)
    at = motion(model, 6)
    swing, numbers = Swing(model, *at), inertials(model)
    moves = np.random.default_rng(2).normal(size=(model.nv, 3))
    forces, inertias = taken(model, at)
    felt = sum(swing.forces(body) @ numbers[body] for body in range(model.nbody))
    np.testing.assert_allclose(felt, forces, atol=1e-9)
    felt = sum(swing.masses(body, moves) @ numbers[body] for body in range(model.nbody))
    expected = np.einsum("dj,nde,ej->nj", moves, inertias, moves)
    np.testing.assert_allclose(felt, expected, atol=1e-9)


@pytest.mark.parametrize("flag", ["", WEIGHTLESS])
def test_force_of_gravity_is_that_of_mujoco(flag: str) -> None:
    model = robot(flag)
    at = motion(model, 4)
    before, _ = taken(model, at)
    found = Swing(model, *at).gravity()
    assert np.abs(found).max() == 0.0 if flag else np.abs(found).max() > 1.0
    for axis in range(3):
        other = robot(flag)
        other.opt.gravity[axis] += 2.0
        after, _ = taken(other, at)
        np.testing.assert_allclose(found[..., axis], (after - before) / 2.0, atol=1e-9)


def test_terms_are_how_the_numbers_of_a_body_grow() -> None:
    """Mass, centre of mass, and spin about an axis, which no principal one is."""
    model = robot()
    axis, body = np.array([0.6, 0.0, 0.8]), model.body("hand").id
    told, numbers = shifts(model, body, axis), inertials(model)

    def grown(field: str, place: int | tuple[int, int], size: float) -> np.ndarray:
        other = robot()
        getattr(other, field)[place] += size
        return (inertials(other) - numbers)[body] / size

    np.testing.assert_allclose(told[0], grown("body_mass", body, 1.0), atol=1e-12)
    for k in range(3):
        expected = grown("body_ipos", (body, k), 1e-6)
        np.testing.assert_allclose(told[1 + k], expected, atol=1e-6)
    spin = told[4, 4:].reshape(3, 3)
    assert not told[4, :4].any()
    np.testing.assert_allclose(spin @ axis, axis)
    assert np.trace(spin) == pytest.approx(1.0)
