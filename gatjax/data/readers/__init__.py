"""Logs as people have them: every format gives signals on their own clocks."""

from __future__ import annotations

from pathlib import Path

from gatjax.data.readers import arrays, bam, lerobot, ros, sage, tables, torch_file
from gatjax.data.readers.assemble import Assembled, assemble, joined
from gatjax.data.readers.source import Given, Source, Stream, Tell

__all__ = ["Assembled", "Given", "Source", "Stream", "assemble", "joined", "read"]

KNOWN = (".parquet", ".csv", ".mcap", ".npz", ".json", ".pt")


def read(path: Path, tell: Tell, given: Given | None = None) -> Source:
    """Read a log, its format told by its ending, or by what a folder holds.

    Args:
        path: file or folder.
        tell: is called with the share that is read, 1.0 at last.
        given: columns of a table that a map names; the others' stamps are their own.

    Raises:
        FileNotFoundError: there is no such file or folder.
        ValueError: one line: no known format, or what is broken and where.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    try:
        source = _parsed(path, tell, given or Given())
    except MemoryError:
        raise
    except Exception as error:  # of foreign bytes: a parser may trip over anything
        line = " ".join(str(error).split()) or "broken"
        if isinstance(error, ValueError) and line.startswith(str(path)):
            raise
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise ValueError(f"{path}: cannot be read: {kind}{line[:400]}") from error
    if not any(source.runs):
        raise ValueError(
            f"{path}: no signal beside its time; {'; '.join(source.notes)}"
        )
    tell(1.0)
    return source


def _parsed(path: Path, tell: Tell, given: Given) -> Source:
    """What the reader of a log's format makes of it."""
    ending = path.suffix.lower()
    if given.time and (path.is_dir() or ending in (".mcap", ".json")):
        raise ValueError(
            f"{path}: its samples are stamped already; leave 'from' of time out of "
            f"the map"
        )
    if given.run and (path.is_dir() or ending in (".mcap", ".json")):
        raise ValueError(
            f"{path}: its runs are known already; leave 'from' of trajectory out of "
            f"the map"
        )
    if path.is_dir():
        return _folder(path, tell)
    match ending:
        case ".parquet" | ".csv":
            return tables.read(path, tell, given)
        case ".mcap":
            return ros.read_mcap(path, tell)
        case ".npz":
            return arrays.read_npz(path, given)
        case ".json":
            return bam.read(path)
        case ".pt":
            return torch_file.read(path, given)
    raise ValueError(
        f"{path}: ending {path.suffix!r} is not known; known are {', '.join(KNOWN)}, "
        f"and folders of rosbag2, LeRobot and SAGE"
    )


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
