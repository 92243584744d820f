"""Recorded walks, packed small enough to travel inside the page."""

from __future__ import annotations

import base64
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.report.read import CHOSEN, THETA0, Rollout
from gatjax.report.tables import label_of

SHAPES = ("sphere", "capsule", "box")
FRAMES = 750  # most frames of one walk: 30 s at 25 frames a second
BYTES = 3_000_000  # most base64 text of all walks together
FOLLOW_S = 0.5  # the camera follows the mean position over this long


class Walk(NamedTuple):
    """One walk as walks/<name>.npz holds it, in the parts that are drawn."""

    name: str
    label: str
    time: np.ndarray  # [T] s
    position: np.ndarray  # [T, B, 3] m, world frame
    quaternion: np.ndarray  # [T, B, 4] w x y z
    body: np.ndarray  # [G] int, index into B
    shape: np.ndarray  # [G] text, one of SHAPES
    size: np.ndarray  # [G, 3] m, half sizes
    offset: np.ndarray  # [G, 3] m, body frame
    turn: np.ndarray  # [G, 4] w x y z, body frame
    colour: np.ndarray  # [G, 4] 0 to 1
    fell: bool = False  # its end is a fall


class Unseen(ValueError):
    """A walk of a robot without motion capture: there is nothing to draw."""


def read_walks(folder: Path, problems: list[str]) -> dict[str, Walk]:
    """Read every walk of a run by name; those that cannot be read become problems."""
    paths = sorted((folder / "walks").glob("*.npz"))
    if not paths:
        problems.append("walks/ is missing or empty: no animation")
    walks = {}
    for path in paths:
        try:
            walks[path.stem] = read_walk(path)
        except Unseen:
            continue
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            problems.append(f"walks/{path.name} cannot be shown: {error}")
    return walks


def told(walk: Walk, rollouts: Sequence[Rollout]) -> Walk:
    """A walk of a run, by the page's name of its method, and whether it fell.

    It is the first of the walks that judged theta0, or a winner.
    """
    method = walk.name.removesuffix("_best_robot").removesuffix("_robot")
    kind = "best" if method == THETA0 else CHOSEN
    rows = [r for r in rollouts if (r.method, r.candidate) == (method, kind)]
    last = max((r.iteration for r in rows), default=0)
    first = min((r for r in rows if r.iteration == last), key=_seed, default=None)
    words = walk.label.replace(f"best of {method} on", f"{label_of(method)} on")
    return walk._replace(label=words, fell=first is not None and first.fell)


def _seed(row: Rollout) -> int:
    return row.seed


def read_walk(path: Path) -> Walk:
    """Read one walk, up to its first frame that is not finite.

    Raises:
        Unseen: no finite frame.
        ValueError: a wrong shape, or an unknown body.
        KeyError: an array is missing.
    """
    with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
        shape = np.char.lower(file["geom_type"].astype(str))
        drawn = np.isin(shape, SHAPES)
        position = np.asarray(file["body_position"], dtype=float)
        quaternion = np.asarray(file["body_quaternion"], dtype=float)
        body = np.asarray(file["geom_body"], dtype=int)[drawn]
        time = np.asarray(file["time"], dtype=float)
        size, offset, turn, colour = (
            np.nan_to_num(np.asarray(file[key], dtype=float))[drawn]
            for key in ("geom_size", "geom_position", "geom_quaternion", "geom_rgba")
        )
        label = str(file["label"]) if "label" in file.files else path.stem
    if position.ndim != 3 or quaternion.shape != (*position.shape[:2], 4):
        raise ValueError("body_position and body_quaternion do not fit together")
    if len(time) != len(position) or not drawn.any():
        raise ValueError("no time for every frame, or nothing to draw")
    if body.min() < 0 or body.max() >= position.shape[1]:
        raise ValueError("geom_body names a body that is not there")
    finite = np.isfinite(position).all((1, 2)) & np.isfinite(quaternion).all((1, 2))
    length = len(time) if finite.all() else int(np.argmin(finite))
    if length == 0:
        raise Unseen("nobody saw where the robot was")
    used, body = np.unique(body, return_inverse=True)
    return Walk(
        path.stem,
        label,
        time[:length] - time[0],
        position[:length, used],
        quaternion[:length, used],
        body,
        shape[drawn],
        size,
        offset,
        turn,
        colour,
    )


def choose(walks: dict[str, Walk], winner: str | None) -> list[Walk]:
    """Order walks for the viewer: the first walk, the best walk, then the others."""
    first = ("theta0_robot",)
    best = (f"{winner}_best_robot",) if winner else ()
    best += tuple(name for name in walks if name.endswith("_best_robot"))
    best += tuple(name for name in walks if name not in first)
    front = [next((n for n in names if n in walks), None) for names in (first, best)]
    names = [name for name in front if name is not None]
    names += [name for name in walks if name not in names]
    return [walks[name] for name in names]


def pack_walks(walks: list[Walk]) -> list[dict[str, Any]]:
    """Pack walks in their order for the viewer, as many as fit into the page."""
    packed, total = [], 0
    for walk in walks:
        entry = pack(walk)
        size = len(entry["position"]) + len(entry["quaternion"])
        if total + size > BYTES and len(packed) >= 2:
            break
        total += size
        packed.append(entry)
    return packed


def pack(walk: Walk) -> dict[str, Any]:
    """Pack one walk: 16 bit whole numbers and their scale, 0.1 mm fine over 4 m."""
    kept = slice(None, None, -(-len(walk.time) // FRAMES))
    position, time = walk.position[kept], walk.time[kept]
    scale = max(float(np.abs(position).max()), 1e-3) / 32767
    length = np.linalg.norm(walk.quaternion, axis=-1, keepdims=True)
    quaternion = (walk.quaternion / np.maximum(length, 1e-9))[kept]
    geometry = zip(
        walk.body,
        walk.shape,
        walk.size,
        walk.offset,
        walk.turn,
        walk.colour,
        strict=True,
    )
    return {
        "name": walk.name,
        "label": walk.label,
        "fell": walk.fell,
        "time": np.round(time, 3).tolist(),
        "bodies": position.shape[1],
        "scale": scale,
        "position": _base64(position / scale),
        "quaternion": _base64(quaternion * 32767),
        "follow": _base64(follow(time, position) / scale),
        "geometry": [
            {
                "body": int(body),
                "shape": str(shape),
                "size": np.round(size, 5).tolist(),
                "offset": np.round(offset, 5).tolist(),
                "turn": np.round(turn, 5).tolist(),
                "colour": np.round(colour, 3).tolist(),
            }
            for body, shape, size, offset, turn, colour in geometry
        ],
    }


def follow(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Smoothed middle [T, 3] of the bodies that move, for the camera."""
    moving = np.ptp(position, axis=0).max(axis=-1) > 1e-4  # [B]
    middle = position[:, moving if moving.any() else slice(None)].mean(axis=1)
    if len(time) < 3:
        return middle
    half = max(1, round(0.5 * FOLLOW_S / float(np.median(np.diff(time)) or FOLLOW_S)))
    half = min(half, len(time))
    padded = np.pad(middle, ((half, half), (0, 0)), mode="edge")
    window = np.ones(2 * half + 1) / (2 * half + 1)
    smooth = [np.convolve(padded[:, axis], window, mode="valid") for axis in range(3)]
    return np.stack(smooth, axis=-1)


def _base64(values: np.ndarray) -> str:
    whole = np.clip(np.rint(values), -32767, 32767).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode("ascii")
