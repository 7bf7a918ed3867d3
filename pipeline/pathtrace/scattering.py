"""Scattering at the vertices of paths: state of a path, a material's answer, MIS weights.

For paths and for transport without paths.
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


def mis_weight(pdf: mi.Float, other: mi.Float, delta: mi.Bool | None = None) -> mi.Float:
    """Return the MIS weight of a sample of density `pdf`: power heuristic with exponent 2.

    `other` is the density by which the other strategy gives the same direction. Samples of `delta`
    distributions weigh 1, because no other strategy gives them. Veach and Guibas, "Optimally
    Combining Sampling Techniques for Monte Carlo Rendering", 1995.
    """
    one, other = dr.square(pdf), dr.square(other)
    weight = one / (one + other)
    weight = dr.select(dr.isfinite(weight), weight, 0)
    return weight if delta is None else dr.select(delta, 1, weight)


def share(part: mi.Color3f, whole: mi.Color3f) -> mi.Color3f:
    """Return part / whole, at most 1; 0 where either is 0."""
    return dr.select((part > 0) & (whole > 0), dr.minimum(part / whole, 1), 0)


def diffuse_lobes() -> mi.BSDFContext:
    """Return the context in which BSDFs evaluate their diffuse lobes alone."""
    context = mi.BSDFContext()
    context.type_mask = mi.BSDFFlags.Diffuse
    return context
