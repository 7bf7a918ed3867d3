"""Checks that materials and labels of a view agree with its geometry."""

from __future__ import annotations

import numpy as np

from pipeline.channels import BUMPED, SPECULAR
from pipeline.frames import Channels, Frame


def material_fault(materials: Frame, inputs: Channels) -> str | None:
    """Say what is wrong with a `materials` frame, or return None.

    Every surface has a material that the table names, and nothing else has; the values are shares
    and the bumped normals are of unit length.
    """
    channels, valid = materials.channels, inputs["valid"] > 0
    number, known = channels["material"], channels["material_known"] > 0
    names = materials.meta.get("material_names")
    if not isinstance(names, list) or number.max(initial=0) > len(names):
        return "a material without a name"
    if ((number > 0) != valid).any():
        return f"{int(((number > 0) != valid).sum())} pixels: surfaces and materials do not agree"
    for band in ("roughness", "metalness", *SPECULAR):
        values = channels[band]
        if values.max(initial=0) > 1:
            return f"{band}: up to {values.max():.4g}"
        if values[~known].any():
            return f"{band}: not 0 where it is unknown"
    lengths = np.sqrt(sum(channels[band][valid].astype(np.float32) ** 2 for band in BUMPED))
    crooked = int((np.abs(lengths - 1) > 0.01).sum())
    return f"{crooked} bumped normals are not of unit length" if crooked else None
