"""The .pt files of PACE: dicts of tensors, read without PyTorch and without its pickle.

A .pt file is a zip archive with a pickle of the structure and the raw numbers of each
tensor beside it. Here only tensors, dicts, lists, numbers and texts are built; a pickle
that asks for anything else is refused before anything of it is called.
"""

from __future__ import annotations

import io
import math
import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.readers.arrays import of_arrays
from gatjax.data.readers.source import Given, Source

MOST = 1 << 28  # numbers of a tensor
KINDS = {
    "FloatStorage": np.float32, "DoubleStorage": np.float64, "HalfStorage": np.float16,
    "LongStorage": np.int64, "IntStorage": np.int32, "ShortStorage": np.int16,
    "CharStorage": np.int8, "ByteStorage": np.uint8, "BoolStorage": np.bool_,
}  # fmt: skip


def read(path: Path, given: Given) -> Source:
    """Read a dict of tensors.

    Raises:
        ValueError: one line: another file, or a pickle that asks for code.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            name = next(n for n in archive.namelist() if n.endswith("/data.pkl"))
            found = _Tensors(archive, name).load()
    except (zipfile.BadZipFile, StopIteration) as error:
        raise ValueError(f"{path}: not a .pt file of PyTorch 1.6 or later") from error
    except (pickle.UnpicklingError, LookupError, EOFError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error
    if not isinstance(found, dict):
        raise ValueError(
            f"{path}: holds a {type(found).__name__}, not a dict of tensors"
        )
    arrays = {str(k): np.asarray(v) for k, v in found.items() if _plain(v)}
    return of_arrays(path, "PACE .pt", arrays, given)


class _Tensors(pickle.Unpickler):
    """Builds tensors as arrays, and nothing that is not one."""

    def __init__(self, archive: zipfile.ZipFile, name: str) -> None:
        super().__init__(io.BytesIO(archive.read(name)))
        self.archive, self.folder = archive, name.removesuffix("data.pkl")

    def find_class(self, module: str, name: str) -> Any:
        """Allow what rebuilds tensors; our own functions stand for it."""
        if module == "torch._utils" and name == "_rebuild_tensor_v2":
            return _rebuilt
        if module == "torch" and name in KINDS:
            return KINDS[name]
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        raise pickle.UnpicklingError(
            f"asks for {module}.{name}: that may be code, so the file is refused; save "
            f"a dict of tensors"
        )

    def persistent_load(self, pid: Any) -> np.ndarray:
        """The numbers of a storage."""
        _, kind, key, *_ = pid
        raw = self.archive.read(f"{self.folder}data/{key}")
        if len(raw) % np.dtype(kind).itemsize:
            raise pickle.UnpicklingError("the numbers of a tensor are cut off")
        return np.frombuffer(raw, kind)


def _rebuilt(
    storage: np.ndarray, offset: int, shape: tuple, stride: tuple, *_: Any
) -> np.ndarray:
    """A tensor as an array of its own."""
    if storage.ndim != 1 or min(offset, *shape, *stride) < 0:
        raise pickle.UnpicklingError("a tensor begins before its numbers")
    last = offset + sum((n - 1) * s for n, s in zip(shape, stride, strict=True))
    if min(shape, default=1) > 0 and not 0 <= last < len(storage):
        raise pickle.UnpicklingError("a tensor reaches beyond its numbers")
    if math.prod(shape) > MOST:
        raise pickle.UnpicklingError(f"a tensor claims {math.prod(shape)} numbers")
    steps = tuple(s * storage.itemsize for s in stride)
    view = np.lib.stride_tricks.as_strided(storage[offset:], shape, steps)
    return np.array(view)


def _plain(value: Any) -> bool:
    """Whether a value is an array or a list of numbers or names."""
    return isinstance(value, np.ndarray | list | tuple)
