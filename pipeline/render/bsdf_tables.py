"""Tables from each BSDF to a partner of it: its neutral twin, its diffuse lobe, its reflectance."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column


def partner_table(pairs: list[tuple[Any, Any]]) -> Any:
    """Return a `mi.BSDFPtr` array with each BSDF's partner at its registry id.

    `pairs` are (BSDF, partner).
    """
    own, partners = (_indices([pair[which] for pair in pairs]) for which in (0, 1))
    table = np.zeros(own.max() + 1, dtype=np.uint32)
    table[own] = partners
    return dr.reinterpret_array(mi.BSDFPtr, column(mi.UInt32, table))


def partner(table: Any, bsdfs: Any, active: Any) -> Any:
    """Return the partners of BSDFs, `mi.BSDFPtr`."""
    return dr.gather(mi.BSDFPtr, table, dr.reinterpret_array(mi.UInt32, bsdfs), active)


def _indices(bsdfs: list[Any]) -> Any:
    """Return the registry ids of BSDFs, (N,)."""
    return np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs)))
