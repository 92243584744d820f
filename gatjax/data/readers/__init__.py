"""Logs as people have them: every format gives signals on their own clocks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gatjax.data.readers import arrays, bam, lerobot, ros, sage, tables, torch_file
from gatjax.data.readers.assemble import Assembled, assemble
from gatjax.data.readers.source import Source

__all__ = ["FORMATS", "Assembled", "Source", "assemble", "read"]

FORMATS: dict[str, Callable[[Path], Source]] = {
    ".parquet": tables.read,
    ".csv": tables.read,
    ".npz": arrays.read_npz,
    ".json": bam.read,
    ".pt": torch_file.read,
    ".mcap": ros.read_mcap,
}


def read(path: Path) -> Source:
    """Read a log, its format told by its ending, or by what a folder holds.

    Raises:
        FileNotFoundError: there is no such file or folder.
        ValueError: one line: no known format, or what is broken and where.
    """
    if path.is_dir():
        if sage.is_sage(path):
            return sage.read(path)
        if lerobot.is_lerobot(path):
            return lerobot.read(path)
        if (path / "metadata.yaml").is_file():
            return ros.read_bag(path)
        raise ValueError(
            f"{path}: a folder of no known log; known are rosbag2 (metadata.yaml), "
            f"LeRobot (meta/info.json) and SAGE (control.csv)"
        )
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    if path.suffix not in FORMATS:
        raise ValueError(
            f"{path}: ending {path.suffix!r} is not known; known are "
            f"{', '.join(FORMATS)}, and folders of rosbag2, LeRobot and SAGE"
        )
    return FORMATS[path.suffix](path)
