"""LeRobot datasets, version 2 or 3, in a local folder: states and actions of episodes.

meta/info.json names the features; data/**/*.parquet holds the rows of many episodes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from gatjax.data.readers.source import Run, Source, numbered, table
from gatjax.files import read_json

ACTION, STATE = "action", "observation.state"
NEEDED = ("timestamp", "episode_index", ACTION, STATE)


def is_lerobot(path: Path) -> bool:
    """Whether a folder holds such a dataset."""
    return (path / "meta" / "info.json").is_file()


def read(path: Path) -> Source:
    """Read all episodes.

    Raises:
        ValueError: one line: a feature or the data are not there.
    """
    info = read_json(path / "meta" / "info.json")
    features = info.get("features", {})
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise ValueError(f"{path}: no data/**/*.parquet; download the dataset's data")
    parts = [_table(file) for file in files]
    episode = np.concatenate([part["episode_index"] for part in parts])
    names = {
        key: _names(features, key, parts[0][key].shape[1]) for key in (ACTION, STATE)
    }
    whole = {key: np.concatenate([part[key] for part in parts]) for key in NEEDED}
    runs: list[Run] = []
    for number in np.unique(episode):
        rows = episode == number
        time = whole["timestamp"][rows]
        runs.append(
            table("action.", names[ACTION], time, whole[ACTION][rows])
            | table("state.", names[STATE], time, whole[STATE][rows])
        )
    draft: dict[str, dict[str, Any]] = {}
    shared = [name for name in names[STATE] if name in names[ACTION]]
    sent_as, seen_as = (shared, shared) if shared else (names[ACTION], names[STATE])
    for sent, seen in zip(sent_as, seen_as, strict=False):
        joint = seen.removesuffix(".pos")
        draft[f"command.{joint}"] = {"from": f"action.{sent}", "unit": "deg"}
        draft[f"position.{joint}"] = {"from": f"state.{seen}", "unit": "deg"}
    notes = [] if shared else [
        f"{path}: no action is called like a state; they are taken in their order"
    ]  # fmt: skip
    notes += [
        f"{path}: LeRobot does not say its units; the draft takes degrees, correct it "
        f"if the arm was calibrated to -100 ... 100 or to radians"
    ]
    metadata = {"robot": str(info.get("robot_type") or "lerobot"), "base": "fixed"}
    kind = f"LeRobot {info.get('codebase_version', '')}".strip()
    return Source(str(path), kind, runs, draft, metadata, notes)


def _table(file: Path) -> dict[str, np.ndarray]:
    """The needed columns of a file."""
    try:
        columns = parquet.read_table(file, columns=list(NEEDED))
    except (pa.ArrowException, OSError) as error:
        line = str(error).splitlines()[0]
        raise ValueError(f"{file}: {line}") from error
    found = {}
    for name in NEEDED:
        values = columns.column(name).to_pylist()
        found[name] = np.array(values, np.float64)
    for name in (ACTION, STATE):
        if found[name].ndim != 2:
            raise ValueError(f"{file}: column {name!r} holds no vectors of one length")
    return found


def _names(features: dict[str, Any], key: str, count: int) -> list[str]:
    """Names of the numbers of a feature; the file may keep them in a dict."""
    names = features.get(key, {}).get("names")
    if isinstance(names, dict):
        names = next((each for each in names.values() if isinstance(each, list)), None)
    if not isinstance(names, list) or len(names) != count:
        return numbered(count)
    return [str(name) for name in names]
