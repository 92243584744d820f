"""Run folders: opened before any work, resumed after any stop."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
import subprocess
import time
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from gatjax.files import as_json, read_json, write_json

FOLDERS = ("recordings", "policies", "grounding", "checkpoints", "walks")
PACKAGES = (
    "gatjax", "jax", "mujoco", "mujoco-mjx", "dartpy", "evosax", "numba", "numpy",
)  # fmt: skip


class RunFolder(NamedTuple):
    """An open run; the folders of `FOLDERS` are in it."""

    path: Path
    config: dict[str, Any]  # config.json, as plain data


def open_run(
    root: str | Path, config: Any, name: str | None = None, device: str | None = None
) -> RunFolder:
    """Starts a run folder: config.json and environment.json before any work.

    Args:
        root: the folder of runs, made if it is not there.
        config: a dataclass instance with every setting of the run.
        name: of the folder; None makes one of the time and a digest of the config.
        device: what the run computes on, for environment.json.

    Raises:
        FileExistsError: the folder is there already.
        OSError: one line; no folder is left behind (the disk is full, say).
    """
    settings = _plain(config)
    name = name or f"{time.strftime('%Y%m%d-%H%M%S')}-{digest(settings)}"
    path = Path(root) / name
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise FileExistsError(
            f"{path}: exists already; resume it or choose another name"
        ) from None
    except OSError as error:
        raise OSError(f"{path}: cannot be made ({error.strerror})") from error
    try:
        write_json(path / "config.json", settings)
        seed = {"seed": settings["seed"]} if "seed" in settings else {}
        write_json(path / "environment.json", seed | _environment(device))
        _make_folders(path)
    except OSError:
        shutil.rmtree(path, ignore_errors=True)
        raise
    return RunFolder(path=path, config=settings)


def resume_run(
    path: str | Path, config: Any = None, free: Collection[str] = ()
) -> RunFolder:
    """Opens a run folder to go on with it.

    Args:
        path: the run folder.
        config: the settings asked for now, which must be those of the run; None takes
            those of the run.
        free: names of settings that may differ.

    Raises:
        FileNotFoundError: not a run folder; the line lists the runs beside it.
        ValueError: one line with the first setting that differs.
    """
    path = check_run(path)
    settings = read_json(path / "config.json")
    if config is not None:
        asked = _plain(config)
        check_same(settings, asked | {name: settings[name] for name in free}, path)
    _make_folders(path)
    return RunFolder(path=path, config=settings)


def check_run(path: str | Path) -> Path:
    """Refuses a folder that is not a run folder.

    Raises:
        FileNotFoundError: one line that lists the runs beside it.
    """
    path = Path(path)
    for name in ("config.json", "environment.json"):
        if not (path / name).is_file():
            raise FileNotFoundError(
                f"{path}: not a run folder, it has no {name}; {_listed(path.parent)}"
            )
    return path


def latest_run(root: str | Path) -> Path:
    """Finds the run that was started last.

    Raises:
        FileNotFoundError: there is no run in `root`.
    """
    runs = _runs(Path(root))
    if not runs:
        raise FileNotFoundError(f"{root}: no run here; start one with: gatjax run")
    environments = [read_json(run / "environment.json") for run in runs]
    started = [str(environment.get("started")) for environment in environments]
    return runs[started.index(max(started))]


def _plain(config: Any) -> dict[str, Any]:
    """A dataclass as the plain data that config.json gives back."""
    return json.loads(json.dumps(dataclasses.asdict(config), default=as_json))


def digest(settings: Mapping[str, Any]) -> str:
    """Eight characters that change with any setting of plain data."""
    text = json.dumps(settings, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _make_folders(path: Path) -> None:
    """Makes the subfolders of a run."""
    for folder in FOLDERS:
        (path / folder).mkdir(exist_ok=True)


def _environment(device: str | None) -> dict[str, Any]:
    """What the run ran with and on; reads installed metadata, imports nothing."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="microseconds"),
        "python": platform.python_version(),
        "packages": {package: _version(package) for package in PACKAGES},
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "device": device,
        "commit": _git("rev-parse", "HEAD"),
        "changed_since_commit": bool(_git("status", "--porcelain", "--", ".")),
    }


def _version(package: str) -> str | None:
    """Installed version of a package, None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git(*arguments: str) -> str | None:
    """What git says of gatjax's source; None where it is not a git checkout."""
    source = Path(__file__).parent
    try:
        for command in (("ls-files", "--error-unmatch", __file__), arguments):
            line = ["git", "-C", str(source), *command]
            answer = subprocess.run(line, capture_output=True, text=True, timeout=10)
            if answer.returncode:
                return None
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip()


def _runs(root: Path) -> list[Path]:
    """The run folders in a folder, by name."""
    return sorted(
        path.parent
        for path in root.glob("*/config.json")
        if (path.parent / "environment.json").is_file()
    )


def _listed(root: Path) -> str:
    """The runs in a folder, for a message."""
    names = [run.name for run in _runs(root)]
    return f"runs in {root}: {', '.join(names) if names else 'none'}"


def check_same(old: Any, new: Any, path: Path, field: str = "") -> None:
    """Refuses two configs that differ, with the first field that does."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*new, *(key for key in old if key not in new)]:
            name = f"{field}.{key}" if field else key
            check_same(old.get(key), new.get(key), path, name)
    elif old != new:
        raise ValueError(
            f"{path}: started with {field} = {old!r}, now it is {new!r}; resume with "
            f"the same settings or start a new run"
        )
