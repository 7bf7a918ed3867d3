"""Instances that virtual calls of kernels may meet.

A call on `mi.BSDFPtr` may meet every BSDF in Dr.Jit's registry: each is traced for each call, and
each form of BSDF becomes a function of the kernel. Mitsuba also registers BSDFs that only others
hold, as a `twosided` holds a `normalmap` and this a `principled`. Calls never meet those; their
code is part of the outermost one's. The same goes for emitters that are not in the scene.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.render.drjit_arrays import registry_id

# Dr.Jit keeps pointers to these names.
_HIDDEN = ctypes.c_char_p(b"not called")


class _Registry(NamedTuple):
    """Functions of `drjit-core/jit.h`, which Dr.Jit's Python modules lack."""

    bound: Any  # (variant, domain) -> highest id
    find: Any  # (variant, domain, id) -> pointer
    put: Any  # (variant, domain, pointer) -> id
    remove: Any  # (pointer)


def keep_from_calls(instance: Any) -> None:
    """Take a BSDF or an emitter out of the reach of virtual calls.

    It moves to another domain of the registry, from which it is removed when it is freed. Its
    methods can still be called on the object itself. Does nothing in scalar variants, and where
    Dr.Jit's library does not export its registry: kernels are larger there.
    """
    registry = _registry() if dr.is_jit_v(mi.Float) else None
    if registry is None:
        return
    pointer = mi.BSDFPtr if isinstance(instance, mi.BSDF) else mi.EmitterPtr
    variant, domain = _name(str(mi.variant())), _name(str(pointer.Domain))
    number = registry_id(instance, pointer)  # in its domain, maybe the other one already
    if number > registry.bound(variant, domain):
        return
    if registry.find(variant, domain, number) == instance.ptr:
        registry.remove(instance.ptr)
        registry.put(variant, _HIDDEN, instance.ptr)


def level_ids() -> None:
    """Give the ids of BSDFs, emitters and shapes bounds that most scenes share.

    Kernels hold one table for all their calls, as long as the highest ids, and places in it are
    compiled in. An instance beyond a scene's own sets the bound: with as many materials as a
    large home has, or twice as many, and so on. It stays, and no call meets it. The ids before it
    are taken by nothing for a moment, then free again.
    """
    registry = _registry() if dr.is_jit_v(mi.Float) else None
    if registry is None:
        return
    variant = _name(str(mi.variant()))
    for pointer, (least, make) in _BOUNDS.items():
        domain = _name(pointer)
        bound = registry.bound(variant, domain)
        wanted = least
        while wanted < bound:
            wanted *= 2
        if wanted == bound:
            continue
        taken: list[tuple[int, int]] = []  # address and id
        while not taken or taken[-1][1] < wanted - 1:
            place = len(taken) + 1  # no address of an object
            taken.append((place, registry.put(variant, domain, place)))
        _LAST.append(make())
        for place, _ in taken:
            registry.remove(place)


def available() -> bool:
    """Test whether Dr.Jit's library exports its registry."""
    return _registry() is not None


# Least bound of ids, and what makes the last instance, by domain.
_BOUNDS: dict[str, tuple[int, Callable[[], Any]]] = {
    "BSDF": (2048, lambda: mi.load_dict({"type": "diffuse"})),
    "Emitter": (64, lambda: mi.load_dict({"type": "constant"})),
    "Shape": (2048, lambda: mi.Mesh("last", 3, 1)),
}
_LAST: list[Any] = []  # the last instances, kept


@cache
def _name(name: str) -> ctypes.c_char_p:
    return ctypes.c_char_p(name.encode())


@cache
def _registry() -> _Registry | None:
    folder = Path(dr.__file__).parent
    for file in ("libdrjit-core.so", "libdrjit-core.dylib"):
        try:
            library = ctypes.CDLL(str(folder / file))
            # Names as g++ and clang++ make them of those in the header.
            bound = library["_Z21jit_registry_id_boundPKcS0_"]
            find = library["_Z16jit_registry_ptrPKcS0_j"]
            put = library["_Z16jit_registry_putPKcS0_Pv"]
            remove = library["_Z19jit_registry_removePKv"]
        except (OSError, AttributeError):
            continue
        bound.restype = put.restype = ctypes.c_uint32
        find.restype, remove.restype = ctypes.c_void_p, None
        bound.argtypes = [ctypes.c_char_p, ctypes.c_char_p]
        find.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint32]
        put.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_void_p]
        remove.argtypes = [ctypes.c_void_p]
        return _Registry(bound, find, put, remove)
    return None
