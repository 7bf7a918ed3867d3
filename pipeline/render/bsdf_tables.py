"""Tables of partners of BSDFs: their neutral twins, their diffuse lobes, their reflectances."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column, registry_id, shape_table
from pbrnet.pipeline.render.scene_geometry import SceneGeometry
from pbrnet.scenes.arrays import AnyArray


def partner_table(pairs: list[tuple[mi.BSDF, mi.BSDF]]) -> mi.BSDFPtr:
    """Return a table with each BSDF's partner at its registry id; `pairs` are (BSDF, partner)."""
    own, partners = (_indices([pair[which] for pair in pairs]) for which in (0, 1))
    table = np.zeros(own.max() + 1, dtype=np.uint32)
    table[own] = partners
    return dr.reinterpret_array(mi.BSDFPtr, column(mi.UInt32, table))


def reflectance_table(geometry: SceneGeometry) -> mi.BSDFPtr:
    """Return the reflectance twin of each shape's BSDF, by registry id of the shape."""
    twins = geometry.reflectances
    numbers = (0 if twin is None else registry_id(twin, mi.BSDFPtr) for twin in twins)
    return dr.reinterpret_array(mi.BSDFPtr, shape_table(geometry.shapes, numbers))


def partner(table: mi.BSDFPtr, bsdfs: mi.BSDFPtr, active: mi.Bool) -> mi.BSDFPtr:
    """Return the partners of BSDFs."""
    return dr.gather(mi.BSDFPtr, table, dr.reinterpret_array(mi.UInt32, bsdfs), active)


def _indices(bsdfs: list[mi.BSDF]) -> AnyArray:
    """Return the registry ids of BSDFs, (N,)."""
    return np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs)))
