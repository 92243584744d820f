"""Checkpoints of any tree of arrays: orbax, one folder per step, checked before use.

`<folder>/<step>/` is written by orbax, which renames it into place when it is whole;
then `files.json` with the SHA-256 of every file is added. A step counts only once it
has that list, so a save that was stopped half-way never hides the step before it. The
list is checked before reading, because orbax 0.12 returns wrong numbers without a word
when a stored byte changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import pathlib
import shutil
import signal
import threading
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as orbax

FILES = "files.json"
"""Name of the list {path in the step's folder: SHA-256} that makes a step complete."""


def save(folder: str | os.PathLike[str], step: int, tree: Any) -> None:
    """Write one step and return when it is complete on disk.

    Args:
        folder: where the steps of one search lie; made if it is missing.
        step: number of the step, 0 or more, for example the generations that are done.
        tree: any pytree of arrays, numbers and jax random keys.

    Raises:
        ValueError: the step is there already, or it could not be written.
    """
    folder = pathlib.Path(folder).absolute()
    place = folder / str(step)
    if step < 0:
        raise ValueError(f"checkpoint step {step} is negative; count steps from 0")
    if (place / FILES).exists():
        raise ValueError(
            f"checkpoint step {step} is in {folder} already; resume after step "
            f"{latest(folder)}, or save into another folder"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(place, ignore_errors=True)  # the rest of a save that was stopped
        with _uninterrupted(), _without_tracebacks(), _checkpointer() as checkpointer:
            checkpointer.save(place, args=orbax.args.StandardSave(_leaves(tree)))
            listing = place / f"{FILES}.part"
            listing.write_text(json.dumps(_digests(place), indent=1), encoding="utf-8")
            _to_disk(place)
            listing.replace(place / FILES)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"checkpoint step {step} could not be written to {folder} "
            f"({_reason(error)}); make room or choose another folder, then resume: "
            f"complete steps are {_steps(folder)}"
        ) from error


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold stops back for the moment a save takes; orbax's threads do not take them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    told: list[int] = []
    stops = signal.SIGINT, signal.SIGTERM
    before = [
        signal.signal(stop, lambda number, _: told.append(number)) for stop in stops
    ]
    try:
        yield
    finally:
        for stop, handler in zip(stops, before, strict=True):
            signal.signal(stop, handler)
    for number in told[:1]:
        signal.raise_signal(number)


def latest(folder: str | os.PathLike[str]) -> int | None:
    """Return the highest complete step in a folder, None if there is none."""
    return max(_steps(pathlib.Path(folder)), default=None)


def restore(
    folder: str | os.PathLike[str], template: Any, step: int | None = None
) -> Any:
    """Read one step back, bit for bit.

    A damaged step is an error and is never skipped: whoever resumes decides whether the
    work since the step before it is lost.

    Args:
        folder: where the steps of one search lie.
        template: a tree of the same structure, shapes and dtypes, for example what
            `gatjax.search.start` returns; its numbers are not used.
        step: which step; the latest complete one if None.

    Returns:
        The tree; jax arrays and keys where the template has them, else numpy arrays.

    Raises:
        FileNotFoundError: there is no such complete step.
        ValueError: the step is damaged, or is of another search than the template.
    """
    folder = pathlib.Path(folder).absolute()
    found = _steps(folder)
    if step is None and not found:
        raise FileNotFoundError(
            f"no complete checkpoint in {folder}; start without resuming"
        )
    step = found[-1] if step is None else step
    if step not in found:
        raise FileNotFoundError(
            f"no complete checkpoint step {step} in {folder}; choose one of {found}"
        )
    place = folder / str(step)
    _check_files(place, found)
    _check_template(place, template)
    try:
        with _uninterrupted(), _without_tracebacks(), _checkpointer() as checkpointer:
            stored = checkpointer.restore(
                place, args=orbax.args.StandardRestore(_leaves(template))
            )
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(_damaged(place, found, _reason(error))) from error
    flat, structure = jax.tree_util.tree_flatten_with_path(template)
    return jax.tree.unflatten(
        structure, [_like(leaf, stored[_name(path)]) for path, leaf in flat]
    )


def _checkpointer() -> orbax.Checkpointer:
    return orbax.Checkpointer(orbax.StandardCheckpointHandler())


@contextlib.contextmanager
def _without_tracebacks() -> Iterator[None]:
    """Keep orbax's threads from printing the error that is raised anyway."""
    logger = logging.getLogger("absl")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _steps(folder: pathlib.Path) -> list[int]:
    """The complete steps of a folder, rising; empty if there is no such folder."""
    names = [file.parent.name for file in folder.glob(f"*/{FILES}")]
    return sorted(int(name) for name in names if name.isdecimal())


def _leaves(tree: Any) -> dict[str, np.ndarray]:
    """Every leaf as a numpy array under its path in the tree; keys as their words."""
    flat, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {
        _name(path): np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)
        for path, leaf in flat
    }


def _like(leaf: Any, stored: np.ndarray) -> Any:
    if _is_key(leaf):
        return jax.random.wrap_key_data(
            jnp.asarray(stored), impl=jax.random.key_impl(leaf)
        )
    return jnp.asarray(stored) if isinstance(leaf, jax.Array) else np.asarray(stored)


def _is_key(leaf: Any) -> bool:
    kind = getattr(leaf, "dtype", None)
    return kind is not None and jnp.issubdtype(kind, jax.dtypes.prng_key)


def _name(path: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".") or "value"


def _digests(place: pathlib.Path) -> dict[str, str]:
    files = sorted(file for file in place.rglob("*") if file.is_file())
    return {
        file.relative_to(place).as_posix(): _digest(file)
        for file in files
        if not file.name.startswith(FILES)
    }


def _to_disk(place: pathlib.Path) -> None:
    """Wait until every file of a step would outlive a power cut."""
    for file in place.rglob("*"):
        if file.is_file():
            with open(file, "rb") as written:
                os.fsync(written.fileno())


def _digest(file: pathlib.Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _check_files(place: pathlib.Path, found: list[int]) -> None:
    try:
        expected = dict(json.loads((place / FILES).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(_damaged(place, found, f"{FILES} is not readable")) from error
    actual = _digests(place)
    wrong = [name for name in expected if actual.get(name) != expected[name]]
    if wrong:
        raise ValueError(_damaged(place, found, f"{wrong[0]} is truncated or changed"))


def _check_template(place: pathlib.Path, template: Any) -> None:
    with _checkpointer() as checkpointer:
        stored = checkpointer.metadata(place).item_metadata
    wanted = {name: (a.shape, str(a.dtype)) for name, a in _leaves(template).items()}
    there = {name: (tuple(a.shape), str(a.dtype)) for name, a in dict(stored).items()}
    for name in sorted(wanted.keys() | there.keys()):
        if wanted.get(name) != there.get(name):
            raise ValueError(
                f"checkpoint {place} is of another search: {name} is "
                f"{there.get(name, 'missing')} there and {wanted.get(name, 'missing')} "
                f"here; resume with the settings of the run that wrote it"
            )


def _damaged(place: pathlib.Path, found: list[int], why: str) -> str:
    earlier = [step for step in found if step < int(place.name)]
    then = f"resume from step {earlier[-1]}" if earlier else "start again"
    return f"checkpoint {place} is damaged ({why}); delete that folder to {then}"


def _reason(error: BaseException) -> str:
    """What went wrong in one line, without the list of layers it went through."""
    first = (str(error).splitlines() or [type(error).__name__])[0]
    return first.rsplit('": ', 1)[-1]
