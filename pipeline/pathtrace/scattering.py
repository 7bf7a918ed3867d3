"""What a path carries and what a material answers at a vertex, and how samples are weighted.

Multiple importance sampling is written here once, for paths and for transport without paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class PathState:
    """State of a path for one of its two images."""

    radiance: mi.Color3f  # accumulated so far
    throughput: mi.Color3f
    pdf: mi.Float  # density of the last direction in this image's material; 1 at the camera
    delta: mi.Bool  # True if that direction came from a delta lobe or the camera


@dataclass
class Scattering:
    """One material at one vertex: towards an emitter sample, and a sampled direction of its own."""

    value: mi.Color3f  # BSDF times cosine towards the emitter sample
    pdf: mi.Float  # density of that direction by the material's own sampling
    sample: mi.BSDFSample3f
    weight: mi.Color3f  # BSDF times cosine over density of the sampled direction


def power_heuristic(one: mi.Float, other: mi.Float) -> mi.Float:
    """Return the MIS weight of a sample of density `one`: power heuristic with exponent 2.

    Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995.
    """
    one, other = dr.square(one), dr.square(other)
    weight = one / (one + other)
    return dr.select(dr.isfinite(weight), weight, 0)
