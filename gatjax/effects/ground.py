"""Effects on contacts as changes of model fields: friction, softness, worn soles."""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.effects.body import matrix, now

Array = Any
Fields = dict[str, Array]
SPHERE = 2  # mujoco.mjtGeom.mjGEOM_SPHERE
SLIDING = {"geom": 1, "pair": 2}  # numbers that are of sliding, in `friction` of each


def touching(model: Any) -> np.ndarray:
    """Return geoms of a MuJoCo model that can touch something, [...] ids."""
    named = np.union1d(model.pair_geom1, model.pair_geom2).astype(int)
    return np.union1d(_colliding(model), named)


def _colliding(model: Any) -> np.ndarray:
    """Geoms that touch others without a pair that names them."""
    return np.flatnonzero(model.geom_contype | model.geom_conaffinity)


def contacts(model: Any) -> dict[str, np.ndarray]:
    """Rows of a model's fields that contacts go by: geoms, and pairs that it names."""
    pairs = {"pair": np.arange(model.npair)} if model.npair else {}
    return {"geom": _colliding(model), **pairs}


def friction(model: Any, fields: Fields, mu: Array) -> Fields:
    """Set the sliding friction of every geom that can touch to `mu`; NaN is neutral.

    MuJoCo takes the larger of two geoms, or that of the geom with priority; pairs that
    a model names have their own.
    """
    for kind, own in contacts(model).items():
        field = now(model, fields, f"{kind}_friction")
        if not np.isnan(mu):
            field[own, : SLIDING[kind]] = mu
        fields = fields | {f"{kind}_friction": field}
    return fields


def compliance(model: Any, fields: Fields, time_constant: Array) -> Fields:
    """Set the time constant of contacts, s; NaN is neutral. MuJoCo's `solref`."""
    for kind, own in contacts(model).items():
        field = now(model, fields, f"{kind}_solref")
        if not np.isnan(time_constant):
            field[own, 1] = np.where(field[own, 0] > 0.0, field[own, 1], 1.0)
            field[own, 0] = time_constant
        fields = fields | {f"{kind}_solref": field}
    return fields


def wear(model: Any, fields: Fields, params: dict[str, Array]) -> Fields:
    """Wear off part of soles; params: {wear, x, y} [bodies], m and a direction.

    Contact geoms of the body that lie on the side of the direction (x, y) of their
    middle, in the body's frame, move up by `wear`. A body with one flat box as sole is
    tilted instead, so that its edge on that side goes up by `wear`; one that stands on
    a ball has no sides, and it moves up. 0 is neutral.
    """
    place = now(model, fields, "geom_pos")
    attitude = now(model, fields, "geom_quat")
    contact = touching(model)
    for foot in np.flatnonzero(params["wear"]):
        geoms = contact[model.geom_bodyid[contact] == foot]
        if len(geoms) == 0:
            raise ValueError(
                f"sole_geometry: {model.body(int(foot)).name!r} has no contact geom"
            )
        lost = params["wear"][foot]
        side = np.array([params["x"][foot], params["y"][foot]])
        if not side.any():
            raise ValueError("sole_geometry: x and y are both 0; they say which side")
        side = side / np.linalg.norm(side)
        if len(geoms) > 1:
            out = place[geoms, :2] @ side
            place[geoms[out > 0.5 * (out.min() + out.max())], 2] += lost
            continue
        (sole,) = geoms
        if ball(model, int(sole)):
            place[sole, 2] += lost
            continue
        along = np.array([*side, 0.0]) @ matrix(attitude[sole])  # in the box's frame
        reach = np.abs(along) @ model.geom_aabb[sole, 3:6]
        angle = lost / (2.0 * reach)
        turn = np.array([1.0, 0.5 * angle * side[1], -0.5 * angle * side[0], 0.0])
        attitude[sole] = _product(turn / np.linalg.norm(turn), attitude[sole])
        place[sole, 2] += 0.5 * lost
    return fields | {"geom_pos": place, "geom_quat": attitude}


def ball(model: Any, geom: int) -> bool:
    """Whether a geom is a sphere."""
    return bool(model.geom_type[geom] == SPHERE)


def _product(left: Array, right: Array) -> np.ndarray:
    """Product of two quaternions w x y z."""
    w = left[0] * right[0] - left[1:] @ right[1:]
    v = left[0] * right[1:] + right[0] * left[1:] + np.cross(left[1:], right[1:])
    return np.concatenate([[w], v])
