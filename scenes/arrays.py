"""Array types by dtype, for annotations, and the library that an array belongs to."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt

AnyArray = npt.NDArray[Any]
FloatingArray = npt.NDArray[np.floating]
Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Int16Array = npt.NDArray[np.int16]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
UInt8Array = npt.NDArray[np.uint8]
ArrayOrTensor = Any  # a NumPy array; while a network is exported, a torch tensor


def as_triple(values: Float64Array) -> tuple[float, float, float]:
    """An array (3,), such as a point or a colour, as Python floats."""
    return (float(values[0]), float(values[1]), float(values[2]))


def array_namespace(array: ArrayOrTensor) -> Any:
    """Return the module that computes with this array: `numpy`, or `torch` for a tensor.

    Functions that use only what both modules share work on both, so that torch's exporter traces
    the code that otherwise runs on arrays. Nothing is imported: a tensor's module is loaded.
    """
    return sys.modules[type(array).__module__.partition(".")[0]]
