"""Geometry of rectangular light portals and guiding targets: sampling, densities, geometry factor.

Pure NumPy, apart from `geometry_factor`, which takes Dr.Jit arrays too. World coordinates, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.contract import Portal

Floats = float | Float64Array | Any  # `mi.Float` in kernels

_GRAZING = 0.1  # least cosine at the receiver: emitters have extent and rise above its horizon
_MIN_AREA = 1e-4  # square metres: smaller openings are left to the environment's own sampling


@dataclass(frozen=True)
class Rectangles:
    """K rectangles: a corner (K, 3), two edges (K, 3) and a unit normal (K, 3).

    A path that goes through a rectangle leaves along its normal: outdoors through a portal, into
    the lit surface at a guiding target.
    """

    corner: Float64Array
    edges: tuple[Float64Array, Float64Array]
    normal: Float64Array

    @property
    def area(self) -> Float64Array:
        """Areas in square metres, (K,)."""
        lengths = [np.linalg.norm(edge, axis=1) for edge in self.edges]
        return np.asarray(lengths[0] * lengths[1])

    @property
    def centre(self) -> Float64Array:
        """Centres, (K, 3)."""
        return np.asarray(self.corner + 0.5 * (self.edges[0] + self.edges[1]))

    @property
    def spread(self) -> Float64Array:
        """Root mean square distances of the points from the centre in metres, (K,)."""
        return np.asarray(np.sqrt(sum((edge**2).sum(axis=1) for edge in self.edges) / 12))

    def take(self, indices: Int64Array) -> Rectangles:
        """Return the rectangles with these indices."""
        first, second = self.edges
        return Rectangles(
            self.corner[indices], (first[indices], second[indices]), self.normal[indices]
        )

    def joined(self, other: Rectangles) -> Rectangles:
        """Return these rectangles followed by those of `other`."""
        first, second = (
            np.concatenate([a, b]) for a, b in zip(self.edges, other.edges, strict=True)
        )
        return Rectangles(
            np.concatenate([self.corner, other.corner]),
            (first, second),
            np.concatenate([self.normal, other.normal]),
        )


def portal_rectangles(portals: tuple[Portal, ...]) -> Rectangles:
    """Return the rectangle around each portal's polygon, in its plane; tiny portals are omitted."""
    corners, firsts, seconds, normals = [], [], [], []
    for portal in portals:
        polygon, normal = np.array(portal.polygon), np.array(portal.normal, dtype=np.float64)
        normal = normal / np.linalg.norm(normal)
        sideways = perpendicular(normal)
        upwards = np.cross(sideways, normal)
        across, along = (polygon - polygon[0]) @ sideways, (polygon - polygon[0]) @ upwards
        first, second = np.ptp(across) * sideways, np.ptp(along) * upwards
        if np.linalg.norm(first) * np.linalg.norm(second) < _MIN_AREA:
            continue
        corners.append(polygon[0] + across.min() * sideways + along.min() * upwards)
        firsts.append(first)
        seconds.append(second)
        normals.append(normal)
    stacked = [np.array(rows).reshape(-1, 3) for rows in (corners, firsts, seconds, normals)]
    return Rectangles(stacked[0], (stacked[1], stacked[2]), stacked[3])


def perpendicular(direction: Float64Array) -> Float64Array:
    """Return a unit vector perpendicular to `direction` (3,), horizontal unless it is vertical."""
    up = np.array([0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [0.0, 1.0, 0.0])
    sideways = cross(direction, up)
    return np.asarray(sideways / np.linalg.norm(sideways))


def cross(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the cross product of two vectors (3,), in a tenth of the time of `np.cross`."""
    (a, b, c), (d, e, f) = first, second
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])


def sample_rectangles(
    rectangles: Rectangles, points: Float64Array, normals: Float64Array, random: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Sample one direction from each point (Q, 3) through each rectangle, uniformly by area.

    Returns directions (K, Q, 3) and weights (K, Q): the cosine at the surface over the density by
    solid angle, so that radiance times weight estimates irradiance.
    """
    samples = random.random((len(rectangles.area), len(points), 2, 1))
    first, second = (edge[:, None] for edge in rectangles.edges)
    directions = (
        rectangles.corner[:, None] + samples[:, :, 0] * first + samples[:, :, 1] * second - points
    )
    metres = np.maximum(np.linalg.norm(directions, axis=-1, keepdims=True), 1e-3)
    directions = directions / metres
    exit_cosine = np.maximum((directions * rectangles.normal[:, None]).sum(axis=-1), 0)
    cosine = np.maximum((directions * normals).sum(axis=-1), 0)
    return directions, rectangles.area[:, None] * exit_cosine * cosine / metres[..., 0] ** 2


def rectangle_densities(
    rectangles: Rectangles, points: Float64Array, directions: Float64Array
) -> Float64Array:
    """Return the density by solid angle of each direction (Q, 3) through each rectangle, (Q, K).

    It belongs to uniform sampling by area, as in `sample_rectangles`; 0 beside the rectangle.
    """
    exit_cosine = directions @ rectangles.normal.T
    ahead = ((rectangles.corner[None] - points[:, None]) * rectangles.normal[None]).sum(axis=-1)
    inside = (exit_cosine > 1e-6) & (ahead > 0)
    metres = np.where(inside, ahead / np.where(inside, exit_cosine, 1), 0)
    offset = points[:, None] + metres[..., None] * directions[:, None] - rectangles.corner[None]
    for edge in rectangles.edges:
        part = (offset * edge[None]).sum(axis=-1) / (edge**2).sum(axis=-1)
        inside &= (part >= 0) & (part <= 1)
    return np.where(inside, metres**2 / (rectangles.area * np.where(inside, exit_cosine, 1)), 0)


def geometry_factor(cosine: Floats, squared_distance: Floats, spread: Floats) -> Any:
    """Return the irradiance, in 1/m^2, that an emitter of strength 1 causes at a surface.

    The product of the cosine at the surface, bounded from below because emitters have extent, and
    of the inverse square of the distance, bounded by the emitter's `spread` (metres). Accepts
    NumPy and Dr.Jit arrays.
    """
    return (_GRAZING + (1 - _GRAZING) * cosine) / (squared_distance + spread * spread)
