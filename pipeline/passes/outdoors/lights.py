"""Lights as they shine on surfaces outdoors: beams of distant ones, lamps, and the sky."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pbrnet.pipeline.passes.outdoors.surfaces import Surfaces, dots, halton
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.lights import Lights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.scenes.arrays import Float32Array, Float64Array, Int64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.geometry.directions import fibonacci_sphere

_BEAMS = 64  # directions of each distant light
_BRIGHT = 4.0  # times the mean: an environment map's radiance above it is sampled as beams
_PILOT = 128  # points at which lamps are compared
_PILOT_RAYS = 2048  # about as many shadow rays to all lamps
_FAINT = 0.005  # of all direct light: fainter lamps do not count


@dataclass(frozen=True)
class ShadowRays:
    """Rays from surfaces `rows` (R,) to lights at `distances` (R,), along `directions` (R, 3).

    `light` (R, 3) is the irradiance at a surface whose ray is free.
    """

    rows: Int64Array
    directions: Float64Array
    distances: Float64Array
    light: Float64Array

    def arriving(self, free: Float32Array) -> Float64Array:
        """Return the irradiance (R, 3) by the rays, which are free for so many metres (R,)."""
        near = np.where(np.isinf(self.distances), np.finfo(np.float32).max, self.distances)
        arrives = free >= near - np.maximum(2e-4 * near, 2e-4)
        return self.light * arrives[:, None]

    def reflected(self, free: Float32Array, surfaces: Surfaces) -> Float64Array:
        """Return the radiance (N, 3) that the surfaces reflect of it."""
        light = self.arriving(free) * surfaces.take(self.rows).reflected(self.directions)
        count = len(surfaces.points)
        sums = [np.bincount(self.rows, light[:, band], count) for band in range(3)]
        return np.stack(sums, axis=1)


@dataclass(frozen=True)
class OutdoorLights:
    """The scene's lights, as they shine on surfaces outdoors."""

    environment: Any | None
    beams: tuple[_Beams, ...]
    lamps: _Lamps | None
    limit: float  # luminance of the environment above which beams hold the rest

    @classmethod
    def of(cls, scene: RenderScene, groups: Sequence[Surfaces], eye: Float64Array) -> OutdoorLights:
        """Return the lights for groups of surfaces, the first of which the camera sees."""
        lights = scene.lights
        beams = [_beams_of_lamp(lights, int(lamp), eye) for lamp in np.flatnonzero(lights.distant)]
        limit, mean = np.inf, 0.0
        if lights.environment is not None:
            mean, limit, bright = _environment(lights, eye)
            beams += bright
        strong = tuple(beam for beam in beams if beam.total > 0)
        daylight = np.pi * mean + sum(beam.total for beam in strong)
        return cls(lights.environment, strong, _lamps_of(scene, groups, daylight), limit)

    def rays_from(self, surfaces: Surfaces) -> ShadowRays:
        """Return the rays by which beams and lamps shine on the surfaces."""
        parts = [each.rays_from(surfaces) for each in (*self.beams, self.lamps) if each is not None]
        empty = ShadowRays(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
        columns = zip(*(vars(part).values() for part in (empty, *parts)), strict=True)
        return ShadowRays(*(np.concatenate(column) for column in columns))

    def sky(self, directions: Float64Array) -> Float64Array:
        """Return the environment's radiance (N, 3), without what beams hold."""
        if self.environment is None or not len(directions):
            return np.zeros_like(directions)
        seen = raycast.environment_radiance(self.environment, directions)
        share = np.minimum(1, self.limit / np.maximum(luminance(seen), 1e-30))
        return seen * share[:, None]


@dataclass(frozen=True)
class _Beams:
    """Directions (D, 3) to a distant light; `strengths` (D, 3): the irradiance by all from each."""

    directions: Float64Array
    strengths: Float64Array

    @property
    def total(self) -> float:
        """Mean luminance of the irradiance on a surface that faces the light."""
        return float(luminance(self.strengths).mean()) if len(self.strengths) else 0.0

    def rays_from(self, surfaces: Surfaces) -> ShadowRays:
        choice = (surfaces.fractions[:, 2] * len(self.directions)).astype(np.int64)
        towards = self.directions[choice]
        light = self.strengths[choice] * np.maximum(dots(surfaces.normals, towards), 0)[:, None]
        return _lit(towards, np.full(len(towards), np.inf), light)


def _beams_of_lamp(lights: Lights, lamp: int, eye: Float64Array) -> _Beams:
    samples = _square(_BEAMS)
    directions, _, weight, _ = raycast.sample_emitters(
        lights.lamps, np.full(_BEAMS, lamp), eye, samples
    )
    return _Beams(directions, weight)


def _environment(lights: Lights, eye: Float64Array) -> tuple[float, float, list[_Beams]]:
    """Return mean luminance of the environment, the limit of its even part, and beams above it."""
    seen = raycast.environment_radiance(lights.environment, fibonacci_sphere(512))
    mean = float(luminance(seen).mean())
    if not np.isfinite(lights.texel_angle):
        return mean, np.inf, []
    count = 8 * _BEAMS
    directions, _, weight, _ = raycast.sample_emitters(
        (lights.environment,), np.zeros(count, dtype=np.int64), eye, _square(count)
    )
    mean = float(luminance(weight).mean()) / (4 * np.pi)
    limit = _BRIGHT * mean
    seen = luminance(raycast.environment_radiance(lights.environment, directions))
    excess = weight * (1 - np.minimum(1, limit / np.maximum(seen, 1e-30)))[:, None]
    bright = luminance(excess) > 0
    beams = _Beams(directions[bright], excess[bright] * bright.mean())
    return mean, limit, [beams] if bright.any() else []


@dataclass(frozen=True)
class _Lamps:
    """Lamps that shine on the surfaces, and the probability of each (M,)."""

    lamps: tuple[Any, ...]
    probabilities: Float64Array

    def rays_from(self, surfaces: Surfaces) -> ShadowRays:
        """Return rays to one point of one lamp for each surface."""
        edges = np.cumsum(self.probabilities)
        lamp = np.searchsorted(edges, surfaces.fractions[:, 2], side="right")
        lamp = np.minimum(lamp, len(edges) - 1)
        rays = _lamp_rays(self.lamps, lamp, surfaces, surfaces.fractions[:, :2])
        return replace(rays, light=rays.light / self.probabilities[lamp[rays.rows], None])


def _lamps_of(scene: RenderScene, groups: Sequence[Surfaces], daylight: float) -> _Lamps | None:
    """Return the lamps, if they bring more than a faint part of the light of the first group.

    Their probabilities follow their shares of the light of each group, so that lamps of a room have
    samples on its walls, which shine on the ground outside where the lamps themselves may not.
    """
    near = np.flatnonzero(~scene.lights.distant)
    if not len(near):
        return None
    lamps = tuple(scene.lights.lamps[index] for index in near)
    points = max(8, min(_PILOT, _PILOT_RAYS // len(lamps)))
    lamp = np.repeat(np.arange(len(lamps)), points)
    samples = np.tile(_square(points), (len(lamps), 1))
    # One that the pilot found dark may light a few surfaces.
    chance = np.full(len(lamps), 0.05 / len(lamps))
    for number, surfaces in enumerate(groups):
        rows = np.linspace(0, len(surfaces.points) - 1, points).astype(np.int64)
        some = surfaces.take(np.tile(rows, len(lamps)))
        rays = _lamp_rays(lamps, lamp, some, samples)
        if number == 0 and luminance(rays.light).sum() / points <= _FAINT * daylight:
            return None
        free = raycast.nearest(scene.geometry, some.points[rays.rows], rays.directions)[1]
        found = np.bincount(lamp[rays.rows], luminance(rays.arriving(free)), len(lamps))
        chance += found / max(float(found.sum()), 1e-30)
    return _Lamps(lamps, chance / chance.sum())


def _lamp_rays(
    lamps: tuple[Any, ...], choice: Int64Array, surfaces: Surfaces, samples: Float64Array
) -> ShadowRays:
    """Return rays from each surface to the point that its sample (2,) chooses on its lamp."""
    directions, distance, weight, _ = raycast.sample_emitters(
        lamps, choice, surfaces.points, samples
    )
    light = weight * np.maximum(dots(surfaces.normals, directions), 0)[:, None]
    return _lit(directions, distance.astype(np.float64), light)


def _lit(directions: Float64Array, distances: Float64Array, light: Float64Array) -> ShadowRays:
    """Return the rays with light, one from each surface."""
    rows = np.flatnonzero(luminance(light) > 0)
    return ShadowRays(rows, directions[rows], distances[rows], light[rows])


def _square(count: int) -> Float64Array:
    """Return points (count, 2) evenly in the unit square."""
    return halton(count, 0)[:, :2]
