"""HDF5 files from outside, opened by the optional library h5py."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import regular_file
from pbrnet.scenes.installation import optional

MAX_BYTES = 2**36  # of a file; arrays are read in parts
MAX_VALUES = 2**28  # of an array that is read at once
_DAMAGE = (KeyError, OSError, RuntimeError, TypeError, ValueError, MemoryError)


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """Open a file for reading; errors of the library within become `InputError`."""
    h5py = optional("h5py", "export")
    regular_file(path, MAX_BYTES)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except _DAMAGE as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: damaged, or not HDF5 of this layout ({reason})") from None


def member(file: Any, name: str, shape: Sequence[int | None], kinds: str = "fiu") -> Any:
    """Return the array `name` of an open file, unread.

    `shape`: its sides, None for any; `kinds`: NumPy's letters of its type. Raises ValueError for
    another array, and for one whose values lie in other files.
    """
    found = file[name]
    sides = getattr(found, "shape", None)
    if not sides or len(sides) != len(shape) or found.dtype.kind not in kinds:
        raise ValueError(f"no array {name!r} of {len(shape)} axes")
    if any(want is not None and want != have for want, have in zip(shape, sides, strict=True)):
        raise ValueError(f"the array {name!r} has the shape {sides}")
    if found.external or found.is_virtual:
        raise ValueError(f"the values of {name!r} lie in other files")
    return found


def whole(file: Any, name: str, shape: Sequence[int | None], kinds: str = "fiu") -> AnyArray:
    """Read the array `name`; raises ValueError as `member` does, and for a very large one."""
    found = member(file, name, shape, kinds)
    if found.size > MAX_VALUES:
        raise ValueError(f"the array {name!r} has {found.size:,} values")
    return np.asarray(found[()])
