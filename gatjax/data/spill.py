"""Columns that may be larger than memory: long ones lie in a temporary file.

A log of gigabytes is then read, looked over and written a column or a block at a time.
"""

from __future__ import annotations

import mmap
import tempfile
import weakref
from array import array
from collections.abc import Callable
from typing import BinaryIO

import numpy as np

LARGE = 1 << 18  # numbers of a column that are kept in memory
BLOCK = 1 << 20  # numbers that are computed at a time


class Column:
    """Numbers that come piece by piece."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
        self.kept = array("d")
        self.file: BinaryIO | None = None

    def add(self, part: np.ndarray) -> None:
        """Keep more of them [N]."""
        self.kept.frombytes(np.asarray(part, np.float64).tobytes())
        self._spared()

    def append(self, number: float) -> None:
        """Keep one more."""
        self.kept.append(number)
        self._spared()

    def whole(self) -> np.ndarray:
        """All of them [N]; of a long column a view of its file, for reading only."""
        if self.file is None:
            return np.array(self.kept, np.float64)
        self._write(self.file)
        return np.memmap(self.file, np.float64, "r")

    def _spared(self) -> None:
        """Move what is kept to the file if it is too much."""
        if len(self.kept) > LARGE:
            if self.file is None:
                self.file = tempfile.TemporaryFile()
                weakref.finalize(self, self.file.close)  # what is mapped of it stays
            self._write(self.file)

    def _write(self, file: BinaryIO) -> None:
        """Move what is kept to the file."""
        file.write(self.kept.tobytes())
        file.flush()
        del self.kept[:]


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
    for each in arrays:
        base: object = each
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)
