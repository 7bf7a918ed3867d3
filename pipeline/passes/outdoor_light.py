"""Light that surfaces outdoors send to a camera through windows, without camera paths.

Surfaces count as diffuse, with their reflectance and its textures. Each gets, by rays of fixed
sequences:

* sun, distant lights and the bright parts of an environment map: a shadow ray to one of a set of
  directions (`_Beams`);
* lamps: a shadow ray to a point on one of those that matter outdoors (`_Lamps`);
* sky: a cosine-distributed ray. Where it meets a surface, that surface sends the same direct light
  and that of a further ray; where this one meets a surface, the mean of what such surfaces send.

A ray that goes to the sky's bright parts, or to a lamp, counts once: by its shadow ray.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pbrnet.pipeline.passes.inputs import facing_normals
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.lights import Lights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.render.scene_geometry import Hits
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.geometry.directions import fibonacci_sphere, unit

_OFFSET = 1e-3  # metres from a surface to the start of a ray; more where coordinates are large
_BEAMS = 64  # directions of each distant light
_BRIGHT = 4.0  # times the mean: an environment map's radiance above it is sampled as beams
_PILOT = 48  # points at which lamps are compared
_PILOT_SAMPLES = 4  # shadow rays of each lamp at each of them
_FAINT = 0.005  # of all direct light: fainter lamps do not count
_SPHERE = 4096  # directions that samples choose from
# Generators of the additive sequences: powers of the root of g^5 = g + 1 (Roberts 2018).
_STEPS = tuple(1.1673039782614187 ** -(power + 1) for power in range(4))


def outdoor_radiance(
    scene: RenderScene, hits: Hits, directions: Float64Array, eye: Float64Array
) -> Float64Array:
    """Return the radiance (N, 3) that surfaces reflect back along rays (N, 3) that meet them.

    Linear RGB, without what the surfaces emit. `eye` (3,) is near the openings. Equal arguments
    give equal bits.
    """
    if not len(directions):
        return np.zeros((0, 3))
    near = _Surfaces.of(scene, hits, directions, 0)
    lights = _OutdoorLights.of(scene, near, eye)
    found, away, bounced = lights.gather(near)
    far = _Surfaces.of(scene, found, away, 1).take(bounced)
    if not len(far.points):
        return near.sent(lights.direct(near) + lights.open_sky(away, found))
    further, last, again = lights.gather(far)
    direct = lights.direct(far) + lights.open_sky(last, further)
    sent = far.sent(direct)
    # Surfaces that the last rays meet send the mean of these: a geometric series of bounces.
    series = 1 - float((far.reflectance.mean(axis=1) * again).mean())
    rest = np.pi * again[:, None] * sent.mean(axis=0) / max(series, 0.2)
    light = lights.direct(near) + lights.open_sky(away, found)
    light[bounced] += np.pi * (sent + far.sent(rest))
    return near.sent(light)


@dataclass(frozen=True)
class _Surfaces:
    """Points (N, 3) with unit normals that face the light that counts, and reflectance (N, 3).

    `numbers` (N,) number the samples; `level` is the bounce, whose sequences differ.
    """

    points: Float64Array
    normals: Float64Array
    reflectance: Float64Array
    numbers: Int64Array
    level: int

    @classmethod
    def of(
        cls, scene: RenderScene, hits: Hits, directions: Float64Array, level: int
    ) -> _Surfaces:
        numbers = np.arange(len(directions))
        normals = facing_normals(hits, directions)
        transmitted = np.append(scene.geometry.transmitted, 0)[hits.shape]
        # Where light passes through, as in leaves, some samples take the light of the other side.
        behind = _fractions(numbers, 3, level) < transmitted
        normals = np.where(behind[:, None], -normals, normals)
        points = hits.position.astype(np.float64)
        far = np.maximum(np.abs(points).max(axis=1, keepdims=True, initial=0), 1)
        return cls(
            points + _OFFSET * np.maximum(0.01 * far, 1) * normals,
            normals,
            hits.reflectance.astype(np.float64),
            numbers,
            level,
        )

    def take(self, chosen: BoolArray) -> _Surfaces:
        return _Surfaces(
            self.points[chosen],
            self.normals[chosen],
            self.reflectance[chosen],
            self.numbers[chosen],
            self.level,
        )

    def sent(self, irradiance: Float64Array) -> Float64Array:
        """Return the radiance (N, 3) that leaves by diffuse reflection."""
        return self.reflectance / np.pi * irradiance

    def fractions(self, dimension: int) -> Float64Array:
        return _fractions(self.numbers, dimension, self.level)


@dataclass(frozen=True)
class _OutdoorLights:
    """The scene's lights, as they shine on surfaces outdoors."""

    scene: RenderScene
    beams: tuple[_Beams, ...]
    lamps: _Lamps | None
    limit: float  # luminance of the environment above which beams hold the rest

    @classmethod
    def of(cls, scene: RenderScene, surfaces: _Surfaces, eye: Float64Array) -> _OutdoorLights:
        lights = scene.lights
        beams = [_beams_of_lamp(lights, int(lamp), eye) for lamp in np.flatnonzero(lights.distant)]
        limit, mean = np.inf, 0.0
        if lights.environment is not None:
            mean, limit, bright = _environment(lights, eye)
            beams += bright
        strong = tuple(beam for beam in beams if beam.total > 0)
        daylight = np.pi * mean + sum(beam.total for beam in strong)
        lamps = _lamps_of(scene, surfaces, daylight)
        return cls(scene, strong, lamps, limit)

    def direct(self, surfaces: _Surfaces) -> Float64Array:
        """Return the irradiance (N, 3) by beams and lamps, with shadows."""
        light = np.zeros_like(surfaces.points)
        for beams in self.beams:
            choice = (surfaces.fractions(0) * len(beams.directions)).astype(np.int64)
            towards, strength = beams.directions[choice], beams.strengths[choice]
            cosine = _dot(surfaces.normals, towards)
            lit = np.flatnonzero(cosine > 0)
            shape, _ = raycast.nearest(self.scene.geometry, surfaces.points[lit], towards[lit])
            lit = lit[shape < 0]
            light[lit] += strength[lit] * cosine[lit, None]
        if self.lamps is not None:
            light += self.lamps.irradiance(self.scene, surfaces)
        return light

    def gather(self, surfaces: _Surfaces) -> tuple[Hits, Float64Array, BoolArray]:
        """Trace a cosine-distributed ray from each surface; flag those that meet another."""
        choice = (surfaces.fractions(1) * _SPHERE).astype(np.int64)
        away = unit(surfaces.normals * (1 + 1e-6) + _sphere()[choice])
        hits = raycast.surfaces(self.scene.geometry, surfaces.points, away)
        return hits, away, hits.shape >= 0

    def open_sky(self, directions: Float64Array, hits: Hits) -> Float64Array:
        """Return pi x the environment's radiance (N, 3) along the rays that meet no surface."""
        light, environment = np.zeros_like(directions), self.scene.lights.environment
        free = hits.shape < 0
        if environment is not None and free.any():
            seen = raycast.environment_radiance(environment, directions[free])
            share = np.minimum(1, self.limit / np.maximum(luminance(seen), 1e-30))
            light[free] = np.pi * seen * share[:, None]
        return light


@dataclass(frozen=True)
class _Beams:
    """Directions (D, 3) to a distant light, each with the irradiance (D, 3) if all light came so."""

    directions: Float64Array
    strengths: Float64Array

    @property
    def total(self) -> float:
        """Mean luminance of the irradiance on a surface that faces the light."""
        return float(luminance(self.strengths).mean()) if len(self.strengths) else 0.0


def _beams_of_lamp(lights: Lights, lamp: int, eye: Float64Array) -> _Beams:
    samples = _points(_BEAMS)
    directions, _, weight, _ = raycast.sample_emitters(
        lights.lamps, np.full(_BEAMS, lamp), eye, samples
    )
    return _Beams(directions, weight)


def _environment(lights: Lights, eye: Float64Array) -> tuple[float, float, list[_Beams]]:
    """Return mean luminance of the environment, the limit of its even part, and beams above it."""
    sphere = _sphere()[:: _SPHERE // 512]
    mean = float(luminance(raycast.environment_radiance(lights.environment, sphere)).mean())
    if not np.isfinite(lights.texel_angle):
        return mean, np.inf, []
    count = 8 * _BEAMS
    directions, _, weight, _ = raycast.sample_emitters(
        (lights.environment,), np.zeros(count, dtype=np.int64), eye, _points(count)
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

    lamps: tuple[object, ...]
    probabilities: Float64Array

    def irradiance(self, scene: RenderScene, surfaces: _Surfaces) -> Float64Array:
        """Return the irradiance (N, 3) by one point of one lamp for each surface."""
        edges = np.cumsum(self.probabilities)
        choice = surfaces.fractions(2)
        lamp = np.minimum(np.searchsorted(edges, choice, side="right"), len(edges) - 1)
        samples = np.stack([surfaces.fractions(0), surfaces.fractions(1)], axis=1)
        light = _lamp_light(scene, self.lamps, lamp, surfaces.points, surfaces.normals, samples)
        return light / self.probabilities[lamp, None]


def _lamps_of(scene: RenderScene, surfaces: _Surfaces, daylight: float) -> _Lamps | None:
    """Return the lamps with more than a faint part of the light, by some of the surfaces."""
    near = np.flatnonzero(~scene.lights.distant)
    if not len(near):
        return None
    lamps = tuple(scene.lights.lamps[index] for index in near)
    rows = np.linspace(0, len(surfaces.points) - 1, min(_PILOT, len(surfaces.points)))
    rows = np.repeat(rows.astype(np.int64), _PILOT_SAMPLES)
    lamp = np.repeat(np.arange(len(lamps)), len(rows))
    points, normals = (np.tile(each[rows], (len(lamps), 1)) for each in (surfaces.points, surfaces.normals))
    samples = np.tile(_points(len(rows)), (len(lamps), 1))

    def means(shadows: bool) -> Float64Array:
        light = _lamp_light(scene, lamps, lamp, points, normals, samples, shadows)
        return luminance(light).reshape(len(lamps), -1).mean(axis=1)

    if means(shadows=False).sum() < _FAINT * daylight:
        return None
    strength = means(shadows=True)
    # Every lamp keeps a chance: one that the pilot found dark may light a few surfaces.
    chance = strength + 0.05 * strength.sum() / len(lamps)
    if not strength.any():
        return None
    return _Lamps(lamps, chance / chance.sum())


def _lamp_light(
    scene: RenderScene,
    lamps: tuple[object, ...],
    choice: Int64Array,
    points: Float64Array,
    normals: Float64Array,
    samples: Float64Array,
    shadows: bool = True,
) -> Float64Array:
    """Return the irradiance (N, 3) by the chosen point of the chosen lamp."""
    directions, distance, weight, _ = raycast.sample_emitters(lamps, choice, points, samples)
    light = weight * np.maximum(_dot(normals, directions), 0)[:, None]
    lit = np.flatnonzero(luminance(light) > 0)
    if shadows and len(lit):
        free = raycast.unoccluded(scene.geometry, points[lit], directions[lit], distance[lit])
        light[lit[~free]] = 0
    return light


def _fractions(numbers: Int64Array, dimension: int, level: int) -> Float64Array:
    """Return numbers in [0, 1) of an additive sequence."""
    return (0.5 + 0.37 * level + (numbers + 1) * _STEPS[dimension]) % 1


def _points(count: int) -> Float64Array:
    """Return points (count, 2) evenly in the unit square."""
    numbers = np.arange(count)
    return np.stack([_fractions(numbers, 0, 0), (numbers + 0.5) / count], axis=1)


@lru_cache(1)
def _sphere() -> Float64Array:
    # Rounded: the last bit of a sine differs between processors.
    return np.round(fibonacci_sphere(_SPHERE), 7)


def _dot(one: Float64Array, other: Float64Array) -> Float64Array:
    return one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1] + one[:, 2] * other[:, 2]
