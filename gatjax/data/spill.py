"""Columns that may be larger than memory: long ones lie in a temporary file.

A log of gigabytes is then read, looked over and written a column or a block at a time.
"""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Callable

import numpy as np

LARGE = 1 << 18  # numbers of a column that are kept in memory
BLOCK = 1 << 20  # numbers that are computed at a time


class Column:
    """Numbers that come piece by piece."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
        self.parts: list[np.ndarray] = []
        self.kept = 0
        self.file: tempfile._TemporaryFileWrapper | None = None

    def add(self, part: np.ndarray) -> None:
        """Keep more of them [N]."""
        self.parts.append(np.asarray(part, np.float64))
        self.kept += len(part)
        if self.kept > LARGE:
            self._write()

    def whole(self) -> np.ndarray:
        """All of them [N]; of a long column a view of its file, for reading only."""
        if self.file is None:
            return np.concatenate([np.empty(0), *self.parts])
        self._write()
        return np.memmap(self.file, np.float64, "r")

    def _write(self) -> None:
        """Move what is kept to the file."""
        if self.file is None:
            self.file = tempfile.NamedTemporaryFile(prefix="gatjax-")
        for part in self.parts:
            self.file.write(part.tobytes())
        self.file.flush()
        self.parts, self.kept = [], 0


def mapped(
    change: Callable[[np.ndarray], np.ndarray], values: np.ndarray
) -> np.ndarray:
    """What a function makes of numbers [N], element by element and block by block."""
    if len(values) <= LARGE:
        return change(values)
    out = Column()
    for first in range(0, len(values), BLOCK):
        out.add(change(values[first : first + BLOCK]))
        release(values)
    return out.whole()


def release(*arrays: np.ndarray) -> None:
    """Free the memory of columns that lie in files; they are read again when used."""
    for array in arrays:
        base: object = array
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)
