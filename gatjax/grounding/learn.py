"""Learn a grounding by name, put it into a world, keep it in a folder."""

from __future__ import annotations

import functools
import importlib.util
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax.effects.effect import Effect, memoryless
from gatjax.files import as_json
from gatjax.grounding.dagger import DAGGER
from gatjax.grounding.envelope import ENVELOPE
from gatjax.grounding.garat import GARAT
from gatjax.grounding.gat import GAT
from gatjax.grounding.grounder import Experience, Grounder
from gatjax.grounding.guided import GUIDED
from gatjax.grounding.rgat import RGAT
from gatjax.grounding.sensing import SENSING
from gatjax.grounding.sgat import SGAT
from gatjax.robot.model import joint_names
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.runs import read_json, write_whole
from gatjax.sim.stored import check_rate
from gatjax.sim.world import World, add_command, add_sensor

Array = Any

SCHEMA = "gatjax.grounding/1"
NONE = Grounder(
    effect=lambda joints: memoryless(lambda params, signal: signal),
    learn=lambda experience: ((), {}),
    template=lambda joints: (),
)
METHODS = {
    "none": NONE,
    "envelope": ENVELOPE,
    "guided": GUIDED,
    "gat": GAT,
    "dagger": DAGGER,
    "sgat": SGAT,
    "sensing": SENSING,
    "rgat": RGAT,
    "garat": GARAT,
}
"""Ways of grounding by name."""
ALPHAS = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)


class Grounding(NamedTuple):
    """A learned command effect, in some methods with a sensor effect."""

    method: str
    params: Any
    facts: dict[str, Any]  # fit of its models, alpha, and rate_hz where it is known
    joints: tuple[str, ...] = WALKING_JOINTS  # that it was learned for


def check_method(method: str) -> None:
    """Raise if a method does not exist."""
    if method not in METHODS:
        raise ValueError(f"method {method!r} is unknown; choose from {list(METHODS)}")


def check_needs(method: str) -> None:
    """Raise if a method cannot be learned on this machine."""
    needed = METHODS[method].needs
    if needed is not None and importlib.util.find_spec(needed) is None:
        raise ValueError(
            f"method {method} learns by reinforcement and needs {needed}; "
            f"in gatjax's folder: .venv/bin/pip install -c constraints.txt -e '.[rl]'"
        )


def learn(method: str, experience: Experience) -> Grounding:
    """Learn a grounding by one of METHODS from runs under the same policy."""
    check_method(method)
    check_needs(method)
    return Grounding(method, *METHODS[method].learn(experience))


def grounded(world: World, grounding: Grounding) -> World:
    """Return the world with the grounding as its first command effect.

    It is learned from logs of what was commanded, ahead of what acts on commands there.

    Raises:
        ValueError: the grounding was learned at another control rate, or for joints
            that the world's robot lacks.
    """
    name = f"grounding {grounding.method}"
    check_rate(world, grounding.facts.get("rate_hz"), name)
    there = joint_names(world.model)
    lacking = [joint for joint in grounding.joints if joint not in there]
    if lacking:
        raise ValueError(
            f"{name} is for joints that {world.source} lacks: {', '.join(lacking)}; "
            f"choose a grounding of this robot"
        )
    joints = tuple(there.index(joint) for joint in grounding.joints)
    command, sensor = _effects(grounding.method, joints)
    world = add_command(world, "grounding", command, grounding.params)
    if sensor is None:
        return world
    return add_sensor(world, "grounding", sensor, grounding.params)


@functools.cache
def _effects(method: str, joints: tuple[int, ...]) -> tuple[Effect, Effect | None]:
    """Effects of a method on joints with these indices: one of a kind, compiled once.

    The second one is its effect on sensors, if it has one.
    """
    way, where = METHODS[method], np.array(joints)
    return way.effect(where), way.sensor and way.sensor(where)


def with_alpha(grounding: Grounding, alpha: float) -> Grounding:
    """Return the grounding with another share of the corrected action."""
    if grounding.method == "none":
        return grounding
    params = grounding.params._replace(alpha=np.float32(alpha))
    return grounding._replace(params=params, facts={**grounding.facts, "alpha": alpha})


def largest_stable_alpha(
    grounding: Grounding, falls: Callable[[Grounding], float]
) -> Grounding:
    """Choose alpha as the paper does: as high as the walk stays stable.

    A walk that falls at every alpha (one found by an earlier search may) gets the
    highest of those where it falls least.

    Args:
        grounding: any grounding; `none` comes back as it is.
        falls: share of walks that fall in the grounded simulator, 0 to 1.

    Returns:
        The grounding with that alpha; its fact `falls` is that share.

    Raises:
        ValueError: all walks fall at every alpha.
    """
    if grounding.method == "none":
        return grounding
    least, best = 1.0, None
    for alpha in ALPHAS:
        candidate = with_alpha(grounding, alpha)
        share = falls(candidate)
        if share < least:
            least, best = share, candidate
        if share == 0.0:
            break
    if best is None:
        raise ValueError(
            "the walk always falls in the simulator, even without grounding; check "
            "policy and model"
        )
    return best._replace(facts={**best.facts, "falls": least})


def write_grounding(folder: Path, grounding: Grounding) -> None:
    """Write grounder.json and weights.npz, each whole, and none if the disk is full."""
    folder.mkdir(parents=True, exist_ok=True)
    leaves = jax.tree_util.tree_flatten_with_path(grounding.params)[0]
    arrays = {jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}
    weights = io.BytesIO()
    np.savez(weights, allow_pickle=False, **arrays)
    text = {
        "schema": SCHEMA,
        "method": grounding.method,
        "joints": list(grounding.joints),
        **grounding.facts,
    }
    about = (json.dumps(text, indent=2, default=as_json) + "\n").encode()
    files = {"weights.npz": weights.getvalue(), "grounder.json": about}
    write_whole({folder / name: content for name, content in files.items()})


def read_grounding(folder: Path) -> Grounding:
    """Load what `write_grounding` wrote.

    Raises:
        ValueError: one line with what is missing or damaged.
    """
    try:
        text = read_json(folder / "grounder.json")
        weights = io.BytesIO((folder / "weights.npz").read_bytes())
        with np.load(weights, allow_pickle=False) as file:
            arrays = dict(file)
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"{folder} holds no complete grounding ({error}); run `gatjax ground` again"
        ) from error
    file, joints = f"{folder}/grounder.json", text.get("joints")
    if text.get("schema") != SCHEMA:
        raise ValueError(f"{file}: schema is {text.get('schema')!r}, need {SCHEMA!r}")
    if not isinstance(joints, list) or not all(isinstance(j, str) for j in joints):
        raise ValueError(f"{file}: joints is {joints!r}, need a list of names")
    method = str(text.get("method"))
    check_method(method)
    template = METHODS[method].template(len(joints))
    params = _filled(template, arrays, f"{folder}/weights.npz")
    facts = {k: v for k, v in text.items() if k not in ("schema", "method", "joints")}
    return Grounding(method, params, facts, tuple(joints))


def _filled(template: Any, arrays: dict[str, Array], name: str) -> Any:
    """Put arrays into a template, each in its place, shape and kind."""
    leaves, tree = jax.tree_util.tree_flatten_with_path(template)
    found = []
    for path, leaf in leaves:
        key, shape = jax.tree_util.keystr(path), np.shape(leaf)
        if key not in arrays:
            raise ValueError(f"{name} lacks {key}; run `gatjax ground` again")
        array = arrays[key]
        if array.shape != shape or array.dtype.kind != "f":
            raise ValueError(
                f"{name}: {key} is {array.dtype}{list(array.shape)}, need floats "
                f"{list(shape)}; run `gatjax ground` again"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{name}: {key} is not finite; run `gatjax ground` again")
        found.append(array)
    return jax.tree_util.tree_unflatten(tree, found)
