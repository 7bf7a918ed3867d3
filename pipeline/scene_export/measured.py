"""Optical constants that Mitsuba knows by name: indices of refraction, and those of metals."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.scene import set_variant
from pbrnet.scenes.arrays import as_triple
from pbrnet.scenes.color import Color

_AIR = 1.000277  # what Mitsuba takes to be outside
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _-]{0,40}")  # Mitsuba opens a file of that name


@cache
def metal(name: str) -> tuple[Color, Color] | None:
    """Return eta and k of a metal, RGB; None for a name that Mitsuba does not know."""
    found = _parameters({"type": "conductor", "material": name}, name)
    if found is None:
        return None
    eta, k = (np.ravel(np.array(found[f"{key}.value"], np.float64)) for key in ("eta", "k"))
    return as_triple(np.broadcast_to(eta, 3)), as_triple(np.broadcast_to(k, 3))


@cache
def ior_in_air(inside: float | str, outside: float | str) -> float | None:
    """Return the index of refraction, in air, of the ratio of two, numbers or names.

    None for names that Mitsuba does not know.
    """
    given = {"type": "dielectric", "int_ior": inside, "ext_ior": outside}
    found = _parameters(given, *(one for one in (inside, outside) if isinstance(one, str)))
    return None if found is None else _AIR * float(np.ravel(np.array(found["eta"]))[0])


def _parameters(given: dict[str, Any], *names: str) -> Any:
    if not all(map(_NAME.fullmatch, names)):
        return None
    set_variant("auto")
    try:
        return mi.traverse(mi.load_dict(given))
    except RuntimeError:
        return None
