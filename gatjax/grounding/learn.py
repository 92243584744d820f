"""Learn a grounding by name, put it into a world, keep it in a folder."""

from __future__ import annotations

import io
import itertools
import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.effects.effect import Effect, memoryless
from gatjax.grounding.envelope import Envelope, envelope_effect
from gatjax.grounding.gat import (
    Gat,
    Guided,
    gat_effect,
    guided_effect,
    learn_forward,
    learn_inverse,
)
from gatjax.grounding.network import HIDDEN, Network
from gatjax.grounding.transitions import HISTORY
from gatjax.records import JOINTS
from gatjax.robot.model import joint_names
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.runs import read_json, write_whole
from gatjax.runs.files import as_json
from gatjax.sim.world import World, add_command, check_rate

Array = Any

SCHEMA = "gatjax.grounding/1"
METHODS = ("none", "envelope", "guided", "gat")
ALPHAS = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)


class Grounding(NamedTuple):
    """A learned command effect."""

    method: str
    params: Any
    facts: dict[str, Any]  # fit of its models, alpha, and rate_hz where it is known
    joints: tuple[str, ...] = WALKING_JOINTS  # that it was learned for


def effect_of(method: str, joints: Array = WALKING) -> Effect:
    """Return the command effect of a method on the joints with these indices."""
    check_method(method)
    return {
        "none": memoryless(lambda params, signal: signal),
        "envelope": envelope_effect(),
        "guided": guided_effect(joints),
        "gat": gat_effect(joints),
    }[method]


def check_method(method: str) -> None:
    """Raise if a method does not exist."""
    if method not in METHODS:
        raise ValueError(f"method {method!r} is unknown; choose from {list(METHODS)}")


def learn(
    method: str,
    robot: Sequence[JointRun],
    simulator: Sequence[JointRun],
    step_error: Callable[[], Array],
    seed: int,
) -> Grounding:
    """Learn a grounding from recordings of robot and simulator under the same policy.

    Args:
        method: one of METHODS.
        robot: runs of the robot, angles [T, 13] of WALKING_JOINTS.
        simulator: runs of the simulator.
        step_error: returns [13] rad, RMS one-step error of the simulator on the
            robot's runs; called only if the method needs it.
        seed: of initial weights and splits.
    """
    check_method(method)
    if method == "none":
        return Grounding(method, (), {})
    if method == "envelope":
        deviation = np.zeros(len(JOINTS), np.float32)
        deviation[WALKING] = step_error()
        degrees = np.rad2deg(deviation[WALKING]).tolist()
        facts = {"deviation_deg": dict(zip(WALKING_JOINTS, degrees, strict=True))}
        return Grounding(method, Envelope(np.float32(1.0), deviation), facts)
    forward, forward_fit = learn_forward(robot, seed)
    facts = {"forward": forward_fit._asdict()}
    if method == "guided":
        return Grounding(method, Guided(np.float32(1.0), forward), facts)
    inverse, inverse_fit = learn_inverse(simulator, seed + 1)
    facts["inverse"] = inverse_fit._asdict()
    return Grounding(method, Gat(np.float32(1.0), forward, inverse), facts)


def grounded(world: World, grounding: Grounding) -> World:
    """Return the world with the grounding as its last command effect.

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
    joints = np.array([there.index(joint) for joint in grounding.joints])
    effect = effect_of(grounding.method, joints)
    return add_command(world, "grounding", effect, grounding.params)


def with_alpha(grounding: Grounding, alpha: float) -> Grounding:
    """Return the grounding with another share of the corrected action."""
    if grounding.method == "none":
        return grounding
    params = grounding.params._replace(alpha=np.float32(alpha))
    return grounding._replace(params=params, facts={**grounding.facts, "alpha": alpha})


def largest_stable_alpha(
    grounding: Grounding, falls: Callable[[Grounding], int]
) -> Grounding:
    """Choose alpha as the paper does: as high as the walk stays stable.

    Args:
        grounding: any grounding; `none` comes back as it is.
        falls: counts the falls of the walk in the grounded simulator.
    """
    if grounding.method == "none":
        return grounding
    for alpha in ALPHAS:
        candidate = with_alpha(grounding, alpha)
        if falls(candidate) == 0:
            return candidate
    raise ValueError(
        "the walk falls in the simulator even without grounding; check policy and model"
    )


def _template(method: str, joints: int = len(WALKING_JOINTS)) -> Any:
    """Parameters of a method for so many joints that are all zero, in their shapes."""
    if method == "none":
        return ()
    alpha = np.float32(0.0)
    if method == "envelope":
        return Envelope(alpha, np.zeros(len(JOINTS)))
    inputs, outputs = (2 + 2 * HISTORY) * joints, 2 * joints
    sizes = (inputs, *HIDDEN, outputs)
    network = Network(
        np.zeros(inputs), np.zeros(inputs), np.zeros(outputs), np.zeros(outputs),
        np.zeros((inputs, outputs)),
        tuple(np.zeros(pair) for pair in itertools.pairwise(sizes)),
        tuple(np.zeros(size) for size in sizes[1:]),
    )  # fmt: skip
    return Gat(alpha, network, network) if method == "gat" else Guided(alpha, network)


def write_grounding(folder: Path, grounding: Grounding) -> None:
    """Write grounder.json and weights.npz, both whole or none."""
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
    template = _template(method, len(joints))
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
