"""Rectangular portals and guiding targets: geometry, and sampling of directions through them.

In NumPy for the pilot of a view, and in Dr.Jit for kernels, with discrete choices. All figures in
kernels are opaque to the compiler, so that all views of a scene share one kernel; their classes are
dataclasses because Dr.Jit finds the arrays of a frozen kernel in fields. World coordinates, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.render.drjit_arrays import column
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


@dataclass(init=False, eq=False)
class RectangleSampler:
    """Points on up to `slots` rectangles, uniform by area, and densities of directions to them."""

    numbers: mi.Float  # 9 per rectangle: corner, two edges
    rectangles: list[_Rectangle]  # one per slot; the last ones may be empty
    probabilities: list[mi.Float]  # of each slot in the whole view

    def __init__(
        self,
        rectangles: Rectangles,
        strengths: Float64Array,
        probabilities: Float64Array,
        slots: int,
    ) -> None:
        count = len(rectangles.area)
        strengths, probabilities = padded(strengths, slots), padded(probabilities, slots)
        corners = np.concatenate([rectangles.corner, *rectangles.edges], axis=1)
        self.numbers = column(mi.Float, padded(corners, slots).ravel())
        self.probabilities = opaque_floats(probabilities)
        self.rectangles = [_Rectangle(rectangles, strengths, row) for row in range(count)]
        # Distinct objects: a frozen kernel records which of its inputs are identical.
        self.rectangles += [_Rectangle(None, strengths, 0) for _ in range(slots - count)]

    def weights(
        self, position: mi.Point3f, normal: mi.Normal3f, one_sided: bool = False
    ) -> list[mi.Float]:
        """Return the approximate irradiance by each rectangle at a vertex.

        It counts light on the side of `normal` alone if `one_sided`, otherwise on both sides.
        """
        weights = []
        for rectangle in self.rectangles:
            cosine = dr.dot(rectangle.direction(position), normal)
            cosine = dr.maximum(cosine, 0) if one_sided else dr.abs(cosine)
            weights.append(rectangle.strength * rectangle.geometry_factor(position, cosine))
        return weights

    def point(self, slot: mi.UInt32, sample: mi.Point2f) -> mi.Vector3f:
        """Return the point of a rectangle at `sample` in [0, 1)^2."""
        numbers = [dr.gather(mi.Float, self.numbers, 9 * slot + i) for i in range(9)]
        corner, first, second = (mi.Vector3f(*numbers[3 * k : 3 * k + 3]) for k in range(3))
        return corner + sample.x * first + sample.y * second

    def density(
        self, origin: mi.Point3f, direction: mi.Vector3f, probabilities: list[mi.Float]
    ) -> mi.Float:
        """Return the density by solid angle of a direction from `origin`.

        The sum over the rectangles that it passes, each weighted by its probability.
        """
        density = mi.Float(0)
        for rectangle, probability in zip(self.rectangles, probabilities, strict=True):
            density += probability * rectangle.density(origin, direction)
        return density

    def passed(self, origin: mi.Point3f, direction: mi.Vector3f) -> mi.Bool:
        """Test whether a direction from `origin` passes one of the rectangles."""
        passed = mi.Bool(False)
        for rectangle in self.rectangles:
            passed |= rectangle.met(origin, direction)[0]
        return passed


@dataclass(init=False, eq=False)
class _Rectangle:
    """One rectangle; an empty one cannot be hit and has strength 0."""

    centre: mi.Vector3f
    normal: mi.Vector3f  # in the direction of paths
    across: mi.Vector3f  # an edge divided by half its squared length
    along: mi.Vector3f  # the other edge, likewise
    places: list[mi.Float]  # of the centre along normal, `across` and `along`
    per_area: mi.Float  # 1 / area, 1/m^2
    spread: mi.Float  # metres
    strength: mi.Float

    def __init__(self, rectangles: Rectangles | None, strengths: Float64Array, row: int) -> None:
        if rectangles is None:
            up, far = np.array([0.0, 0.0, 1.0]), np.full(3, 1e9)
            vectors, figures = (far, up, np.zeros(3), np.zeros(3)), (1.0, 1.0, 0.0)
        else:
            first, second = (edge[row] for edge in rectangles.edges)
            vectors = (
                rectangles.centre[row],
                rectangles.normal[row],
                2 * first / (first @ first),
                2 * second / (second @ second),
            )
            figures = (1 / rectangles.area[row], rectangles.spread[row], strengths[row])
        self.centre, self.normal, self.across, self.along = (
            mi.Vector3f(*opaque_floats(vector)) for vector in vectors
        )
        places = [vectors[0] @ vector for vector in vectors[1:]]
        self.places = opaque_floats([places[0], 1e30, 1e30] if rectangles is None else places)
        self.per_area, self.spread, self.strength = opaque_floats(figures)

    def direction(self, position: mi.Point3f) -> mi.Vector3f:
        """Return the direction from a vertex to the centre."""
        offset = self.centre - position
        return offset * dr.rsqrt(dr.squared_norm(offset) + 1e-12)

    def geometry_factor(self, position: mi.Point3f, cosine: mi.Float) -> mi.Float:
        """Return the geometry factor at a vertex with this cosine, times the cosine here."""
        own_cosine = dr.maximum(dr.dot(self.direction(position), self.normal), 0)
        squared = dr.squared_norm(self.centre - position)
        return own_cosine * geometry_factor(cosine, squared, self.spread)

    def density(self, origin: mi.Point3f, direction: mi.Vector3f) -> mi.Float:
        """Return the density by solid angle of a direction from `origin`; 0 beside it."""
        inside, distance, per_cosine = self.met(origin, direction)
        return dr.select(inside, dr.square(distance) * (per_cosine * self.per_area), 0)

    def met(self, origin: mi.Point3f, direction: mi.Vector3f) -> tuple[mi.Bool, mi.Float, mi.Float]:
        """Return which rays meet the rectangle, the distance, and 1 / cosine to its normal."""
        # Products with `origin` alone are the same for all directions from it.
        per_cosine = 1 / dr.dot(direction, self.normal)
        distance = (self.places[0] - dr.dot(origin, self.normal)) * per_cosine
        across = dr.dot(origin, self.across) - self.places[1]
        along = dr.dot(origin, self.along) - self.places[2]
        inside = (per_cosine > 0) & (per_cosine < 1e6) & (distance > 1e-4)
        inside &= dr.abs(dr.fma(distance, dr.dot(direction, self.across), across)) <= 1
        inside &= dr.abs(dr.fma(distance, dr.dot(direction, self.along), along)) <= 1
        return inside, distance, per_cosine


def choose(probabilities: list[mi.Float], random: mi.Float) -> tuple[mi.UInt32, mi.Float]:
    """Choose an index with a random number in [0, 1); also return that number, stretched anew."""
    index, start, size = mi.UInt32(0), mi.Float(0), probabilities[0]
    end = mi.Float(probabilities[0])
    for number, probability in enumerate(probabilities[1:], start=1):
        here = (random >= end) & (probability > 0)
        index = dr.select(here, number, index)
        start = dr.select(here, end, start)
        size = dr.select(here, probability, size)
        end = end + probability
    return index, dr.select(size > 0, (random - start) / size, 0)


def below_one(number: mi.Float) -> mi.Float:
    """Clamp a stretched random number to [0, 1): rounded up to 1, some samplers return NaN."""
    return dr.clip(number, 0, dr.one_minus_epsilon(mi.Float))


def opaque_floats(values: npt.ArrayLike) -> list[mi.Float]:
    """Return a one-entry `mi.Float` per value: kernels read these faster than gathered arrays."""
    return [dr.opaque(mi.Float, float(value)) for value in np.ravel(values)]


def padded(rows: Float64Array, count: int) -> Float64Array:
    """Append zero rows up to `count`."""
    return np.concatenate([rows, np.zeros((count - len(rows), *rows.shape[1:]))])
