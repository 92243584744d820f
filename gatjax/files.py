"""Files, each of which is written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO


def write_json(path: Path, tree: Mapping[str, Any]) -> None:
    """Writes a json file, whole or not at all.

    Raises:
        OSError: one line; nothing was changed.
    """
    write_whole({path: (json.dumps(tree, indent=2, default=as_json) + "\n").encode()})


def write_whole(files: Mapping[Path, bytes | Callable[[BinaryIO], None]]) -> None:
    """Writes files beside their places and, once all are whole, renames them.

    A full disk changes nothing. Places are taken one after the other, in order: a kill
    in between, or a folder in the place of one, leaves new files beside old ones.

    Args:
        files: by path, their content, or what writes it into an open file.

    Raises:
        OSError: one line; nothing was changed, or which of them are new.
    """
    halves = {path.with_name(f".{path.name}.{os.getpid()}"): path for path in files}
    target, new = next(iter(files)), []  # of names
    try:
        for half, target in halves.items():
            with open(half, "wb") as file:
                content = files[target]
                if callable(content):
                    content(file)
                else:
                    file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for half, target in halves.items():
            os.replace(half, target)
            new.append(str(target))
    except OSError as error:
        done = f"{', '.join(new)} is new already" if new else "nothing was changed"
        raise OSError(
            f"{target}: cannot be written ({error.strerror}); {done}, "
            f"free some space or choose another folder"
        ) from error
    finally:
        for half in halves:
            half.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Makes the folder that --out means.

    Raises:
        ValueError: one line: a file is there, or nothing can be written.
    """
    check_folder(path)
    path.mkdir(parents=True, exist_ok=True)
    if not os.access(path, os.W_OK):
        raise ValueError(f"{path}: no permission to write there; choose another folder")


def check_folder(path: Path) -> None:
    """Refuses a file where --out means a folder, there or not yet.

    Raises:
        ValueError: one line: a file is there.
    """
    if path.exists() and not path.is_dir():
        raise ValueError(f"{path}: is a file, --out needs a folder here")


def as_json(value: Any) -> Any:
    """What json does not know: paths, numpy numbers and arrays."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r} is a {type(value).__name__}, which json can not hold")


def read_json(path: Path) -> dict[str, Any]:
    """A json file that holds an object."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from error
    if not isinstance(tree, dict):
        raise ValueError(f"{path}: expected {{key: value}}")
    return tree
