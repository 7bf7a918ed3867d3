"""Sampling of directions through rectangles in Dr.Jit kernels, and discrete choices.

Rectangles are portals of the environment or guiding targets. All of their figures are opaque to the
compiler, so that all views of a scene share one kernel. The classes are dataclasses because Dr.Jit
finds the arrays of a frozen kernel in fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.pathtrace.portals import Rectangles, geometry_factor
from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.scenes.arrays import Float64Array


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


@dataclass(init=False, eq=False)
class _Rectangle:
    """One rectangle; an empty one cannot be hit and has strength 0."""

    centre: mi.Vector3f
    normal: mi.Vector3f  # in the direction of paths
    across: mi.Vector3f  # an edge divided by half its squared length
    along: mi.Vector3f  # the other edge, likewise
    area: mi.Float  # square metres
    spread: mi.Float  # metres
    strength: mi.Float

    def __init__(self, rectangles: Rectangles | None, strengths: Float64Array, row: int) -> None:
        if rectangles is None:
            up, far = np.array([0.0, 0.0, 1.0]), np.full(3, 1e9)
            vectors, figures = (far, up, far, far), (1.0, 1.0, 0.0)
        else:
            first, second = (edge[row] for edge in rectangles.edges)
            vectors = (
                rectangles.centre[row],
                rectangles.normal[row],
                2 * first / (first @ first),
                2 * second / (second @ second),
            )
            figures = (rectangles.area[row], rectangles.spread[row], strengths[row])
        self.centre, self.normal, self.across, self.along = (
            mi.Vector3f(*opaque_floats(vector)) for vector in vectors
        )
        self.area, self.spread, self.strength = opaque_floats(figures)

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
        own_cosine = dr.dot(direction, self.normal)
        offset = self.centre - origin
        distance = dr.dot(offset, self.normal) / own_cosine
        position = distance * direction - offset  # of the intersection, from the centre
        inside = (own_cosine > 1e-6) & (distance > 1e-4)
        inside &= dr.abs(dr.dot(position, self.across)) <= 1
        inside &= dr.abs(dr.dot(position, self.along)) <= 1
        return dr.select(inside, dr.square(distance) / (self.area * own_cosine), 0)


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
