"""A folder that one process works in at a time."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep others from going on with a run or a search while the block runs.

    The lock is the kernel's: it leaves no file, and ends with the process, however that
    ends. Where a file system knows no locks, nobody is kept out.

    Raises:
        ValueError: one line: another process, or another block of this one, holds it.
    """
    place = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"{folder}: another gatjax is at work in it; let it end, or stop it"
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(place)
