"""Logs as people have them: every format gives signals on their own clocks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gatjax.data.readers import arrays, bam, lerobot, ros, sage, tables, torch_file
from gatjax.data.readers.assemble import Assembled, assemble, joined
from gatjax.data.readers.source import Source, Stream, Tell

__all__ = ["Assembled", "Source", "Stream", "assemble", "joined", "read"]

FORMATS: dict[str, Callable[[Path], Source]] = {
    ".npz": arrays.read_npz,
    ".json": bam.read,
    ".pt": torch_file.read,
}
LARGE: dict[str, Callable[[Path, Tell], Source]] = {
    ".parquet": tables.read,
    ".csv": tables.read,
    ".mcap": ros.read_mcap,
}
"""Formats of logs that take a while."""


def read(path: Path, tell: Tell) -> Source:
    """Read a log, its format told by its ending, or by what a folder holds.

    Args:
        path: file or folder.
        tell: is called with the share that is read, 1.0 at last.

    Raises:
        FileNotFoundError: there is no such file or folder.
        ValueError: one line: no known format, or what is broken and where.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    if path.is_dir():
        source = _folder(path, tell)
    elif path.suffix in FORMATS:
        source = FORMATS[path.suffix](path)
    elif path.suffix in LARGE:
        source = LARGE[path.suffix](path, tell)
    else:
        raise ValueError(
            f"{path}: ending {path.suffix!r} is not known; known are "
            f"{', '.join([*LARGE, *FORMATS])}, and folders of rosbag2, LeRobot and SAGE"
        )
    tell(1.0)
    return source


def _folder(path: Path, tell: Tell) -> Source:
    """Read a log that is a folder."""
    if sage.is_sage(path):
        return sage.read(path)
    if lerobot.is_lerobot(path):
        return lerobot.read(path)
    if (path / "metadata.yaml").is_file():
        return ros.read_bag(path, tell)
    raise ValueError(
        f"{path}: a folder of no known log; known are rosbag2 (metadata.yaml), "
        f"LeRobot (meta/info.json) and SAGE (control.csv)"
    )
