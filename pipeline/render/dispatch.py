"""Which instances the virtual calls of kernels reach.

A call on `mi.BSDFPtr` may meet any BSDF of Dr.Jit's registry, so each form of BSDF there becomes a
function of every kernel with such a call. Mitsuba also registers BSDFs that only others hold, as
a `twosided` holds a `normalmap` and this a `principled`. No kernel calls those: their code is part
of the outermost one's. Without them in the registry, kernels of a furnished home have a third of
the functions.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from pipeline.render.drjit_arrays import registry_id

# Dr.Jit keeps pointers to these names.
_DOMAIN = ctypes.c_char_p(b"BSDF")
_HELD = ctypes.c_char_p(b"BSDF held by another")


class _Registry(NamedTuple):
    """Functions of `drjit-core/jit.h`, which Dr.Jit's Python modules lack."""

    find: Any  # (variant, domain, id) -> pointer
    put: Any  # (variant, domain, pointer) -> id
    remove: Any  # (pointer)


def keep_from_calls(bsdf: Any) -> None:
    """Take a BSDF that only other BSDFs hold out of the reach of virtual calls.

    It moves to another domain of the registry, from which it is removed when it is freed. Does
    nothing in scalar variants, and where Dr.Jit's library does not export its registry: kernels
    are larger there.
    """
    registry = _registry()
    if registry is None or not dr.is_jit_v(mi.Float):
        return
    variant = _variant(str(mi.variant()))
    if registry.find(variant, _DOMAIN, registry_id(bsdf, mi.BSDFPtr)) == bsdf.ptr:
        registry.remove(bsdf.ptr)
        registry.put(variant, _HELD, bsdf.ptr)


def available() -> bool:
    """Test whether Dr.Jit's library exports its registry."""
    return _registry() is not None


@cache
def _variant(name: str) -> ctypes.c_char_p:
    return ctypes.c_char_p(name.encode())


@cache
def _registry() -> _Registry | None:
    folder = Path(dr.__file__).parent
    for file in ("libdrjit-core.so", "libdrjit-core.dylib"):
        try:
            library = ctypes.CDLL(str(folder / file))
            # Names as g++ and clang++ make them of those in the header.
            find = library["_Z16jit_registry_ptrPKcS0_j"]
            put = library["_Z16jit_registry_putPKcS0_Pv"]
            remove = library["_Z19jit_registry_removePKv"]
        except (OSError, AttributeError):
            continue
        find.restype, put.restype, remove.restype = ctypes.c_void_p, ctypes.c_uint32, None
        find.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint32]
        put.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_void_p]
        remove.argtypes = [ctypes.c_void_p]
        return _Registry(find, put, remove)
    return None
