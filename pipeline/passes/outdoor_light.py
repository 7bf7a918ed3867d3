"""Light that surfaces outdoors send to a camera through windows, without camera paths.

Surfaces have the reflectance and roughness of their materials, with textures and bumps. Each gets,
by rays of fixed sequences:

* sun, distant lights and the bright parts of an environment map: a shadow ray to one of a set of
  directions (`_Beams`);
* lamps: a shadow ray to a point on one of those that matter outdoors (`_Lamps`);
* sky: a cosine-distributed ray. Where it meets a surface, that surface sends the same direct light
  and that of a further ray; where this one meets a surface, the mean of what such surfaces send.

A ray that goes to the sky's bright parts, or to a lamp, counts once: by its shadow ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from pbrnet.pipeline.passes.groundtruth import rooms_box
from pbrnet.pipeline.passes.inputs import facing_normals
from pbrnet.pipeline.pathtrace.light_plan import is_outdoors
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.lights import Lights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.render.scene_geometry import Hits
from pbrnet.scenes.arrays import (
    AnyArray,
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
)
from pbrnet.scenes.color import luminance
from pbrnet.scenes.geometry.directions import fibonacci_sphere, unit

_OFFSET = 1e-5  # of the coordinates, or of 100 m: from a surface to the start of a ray
_BEAMS = 64  # directions of each distant light
_BRIGHT = 4.0  # times the mean: an environment map's radiance above it is sampled as beams
_PILOT = 128  # points at which lamps are compared
_PILOT_RAYS = 2048  # about as many shadow rays to all lamps
_FAINT = 0.005  # of all direct light: fainter lamps do not count
_CIRCLE = 4096  # azimuths that samples choose from
_SURVEY = 8192  # rays from all rooms together that look for the reflectance of shapes
_MOST_KEPT = 0.8  # of the light, from one bounce to the next
_PEAK = 10.0  # largest value of the specular lobe, times pi
_BASES = ((2, 3, 5, 7), (11, 13, 17, 19))  # of the Halton sequence, at each level of bounces


def outdoor_radiance(
    scene: RenderScene, eye: Float64Array, directions: Float64Array
) -> Float64Array:
    """Return the radiance (N, 3) that surfaces reflect back along rays from `eye` that meet them.

    Linear RGB, without what the surfaces emit. `directions` (N, 3) are unit. Equal arguments give
    equal bits.
    """
    count = len(directions)
    if not count:
        return np.zeros((0, 3))
    near = _Surfaces.seen(scene, directions, eye)
    lights = _OutdoorLights.of(scene, near, eye)
    away = near.bounces()
    found = raycast.oriented(scene.geometry, near.points, away)
    bounced = np.flatnonzero(found.shape >= 0)
    colors = _albedo_of_shapes(scene, near)[found.shape]
    far = _Surfaces.met(scene, found, away, colors).take(bounced)
    last = far.bounces()
    both = near.joined(far)
    rays = lights.rays_from(both)
    origins = np.concatenate([both.points[rays.rows], far.points])
    shape, free = raycast.nearest(scene.geometry, origins, np.concatenate([rays.directions, last]))
    direct = rays.reflected(free[: len(rays.rows)], both)
    again = shape[len(rays.rows) :] >= 0  # last rays that meet a surface
    sky = np.pi * lights.sky(np.concatenate([away, last]))
    sent = direct[count:] + far.reflected(last) * sky[count:] * ~again[:, None]
    outdoors = is_outdoors(far.points, rooms_box(scene.scene.rooms))
    for side in (outdoors, ~outdoors):
        if side.any():
            sent[side] = _with_bounces(sent[side], far.diffuse[side], again[side])
    arriving = sky[:count]
    arriving[bounced] = np.pi * sent
    return direct[:count] + near.reflected(away) * arriving


def _albedo_of_shapes(scene: RenderScene, near: _Surfaces) -> Float64Array:
    """Return the mean reflectance of each shape that a survey of the rooms meets, (shapes, 3).

    That of other shapes is the mean where `near` has them, else the mean of all `near`.
    """
    geometry = scene.geometry
    surveyed, counted = geometry.cached("surveyed reflectance", lambda: _survey(scene))
    seen, also = _means(near.shape, near.diffuse + near.specular, len(geometry.shapes))
    rest = np.where(also[:, None], seen, (near.diffuse + near.specular).mean(axis=0))
    return np.where(counted[:, None], surveyed, rest)


def _survey(scene: RenderScene) -> tuple[Float64Array, BoolArray]:
    """Return the mean reflectance of each shape by rays from the rooms' middles, and which met."""
    rooms = scene.scene.rooms
    directions = np.round(fibonacci_sphere(max(_SURVEY // max(len(rooms), 1), 64)), 7)
    eyes = [[*np.mean(room.floor, axis=0), (room.floor_z + room.ceiling_z) / 2] for room in rooms]
    origins = np.repeat(np.reshape(eyes, (-1, 3)), len(directions), axis=0)
    hits = raycast.surfaces(scene.geometry, origins, np.tile(directions, (len(rooms), 1)))
    met = hits.shape >= 0
    return _means(hits.shape[met], hits.reflectance[met], len(scene.geometry.shapes))


def _means(shape: Int32Array, values: AnyArray, count: int) -> tuple[Float64Array, BoolArray]:
    """Return the mean of the values (N, 3) of each shape, (count, 3), and which have any."""
    counts = np.bincount(shape, minlength=count)
    sums = [np.bincount(shape, values[:, band], count) for band in range(3)]
    return np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None], counts > 0


def _with_bounces(sent: Float64Array, albedo: Float64Array, enclosed: BoolArray) -> Float64Array:
    """Add further bounces among surfaces (N, 3) that send light, all on one side of the walls.

    What the last rays of `enclosed` (N,) surfaces meet sends the mean: a geometric series.
    """
    ratio = min(float((albedo.mean(axis=1) * enclosed).mean()), _MOST_KEPT)
    return sent + albedo * enclosed[:, None] * (sent.mean(axis=0) / (1 - ratio))


@dataclass(frozen=True)
class _Surfaces:
    """Points (N, 3) with unit normals to the side of the light that counts, and materials.

    `diffuse` (N, 3) is the reflectance of the diffuse lobe, `specular` (N, 3) that of the other at
    normal incidence, `roughness` (N,) the root of its alpha, `towards` (N, 3) the viewer.
    `fractions` (N, 4) are numbers in [0, 1) of each, from sequences; `shape` (N,) are the shapes.
    """

    points: Float64Array
    normals: Float64Array
    diffuse: Float64Array
    specular: Float64Array
    roughness: Float64Array
    towards: Float64Array
    fractions: Float64Array
    shape: Int32Array

    @classmethod
    def seen(cls, scene: RenderScene, directions: Float64Array, eye: Float64Array) -> _Surfaces:
        """Return the surfaces that rays (N, 3) from the eye meet, each of which meets one."""
        geometry, table = scene.geometry, scene.table
        hits, textures = raycast.textured_surfaces(geometry, table.slots, eye, directions)
        values, bumped = table.values(geometry, hits, eye, directions, textures)
        shading = np.where(bumped[:, None], values.normal, hits.shading_normal)
        hits = replace(hits, shading_normal=shading)
        diffuse = hits.reflectance * (1 - values.metalness * values.known)[:, None]
        specular = values.specular * values.known[:, None]
        return cls._of(scene, hits, directions, diffuse, specular, values.roughness, 0)

    @classmethod
    def met(
        cls, scene: RenderScene, hits: Hits, directions: Float64Array, albedo: Float64Array
    ) -> _Surfaces:
        """Return the surfaces, diffuse ones, that rays (N, 3) from other surfaces meet."""
        rough = np.ones(len(albedo))
        return cls._of(scene, hits, directions, albedo, np.zeros_like(albedo), rough, 1)

    @classmethod
    def _of(
        cls,
        scene: RenderScene,
        hits: Hits,
        directions: Float64Array,
        diffuse: Float64Array,
        specular: Float64Array,
        roughness: Float64Array,
        level: int,
    ) -> _Surfaces:
        fractions = _fractions(len(directions), level)
        normals = facing_normals(hits, directions)
        # Where light passes through, as in leaves, some samples take that of the other side.
        behind = fractions[:, 3] < np.append(scene.geometry.transmitted, 0)[hits.shape]
        normals = np.where(behind[:, None], -normals, normals)
        points = hits.position.astype(np.float64)
        reach = np.maximum(np.abs(points).max(axis=1, keepdims=True, initial=0), 100)
        return cls(
            points + _OFFSET * reach * normals,
            normals,
            diffuse,
            np.where(behind[:, None], 0, specular),
            roughness,
            -directions,
            fractions,
            hits.shape,
        )

    def take(self, rows: Int64Array) -> _Surfaces:
        return _Surfaces(*(each[rows] for each in vars(self).values()))

    def joined(self, other: _Surfaces) -> _Surfaces:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Surfaces(*(np.concatenate(pair) for pair in pairs))

    def bounces(self) -> Float64Array:
        """Return a cosine-distributed direction (N, 3) from each surface."""
        z = 1 - 2 * self.fractions[:, :1]
        circle = _circle()[(self.fractions[:, 1] * _CIRCLE).astype(np.int64)]
        sphere = np.concatenate([np.sqrt(1 - z * z) * circle, z], axis=1)
        return unit(self.normals * (1 + 1e-6) + sphere)

    def reflected(self, light: Float64Array) -> Float64Array:
        """Return the BRDF (N, 3), in 1/sr, for light that comes from directions (N, 3).

        Diffuse and specular lobes of Burley (2012), without its colour shifts; GGX is at most
        `_PEAK` / pi, since no fixed few rays sample a mirror.
        """
        half = unit(self.towards + light)
        to_light = np.maximum(_dot(self.normals, light), 1e-3)
        to_eye = np.maximum(np.abs(_dot(self.normals, self.towards)), 1e-3)
        between = np.clip(_dot(light, half), 0, 1)
        at_light, at_eye = _schlick(to_light), _schlick(to_eye)
        back = 2 * self.roughness * between**2
        lobe = (1 - at_light / 2) * (1 - at_eye / 2)
        lobe += back * (at_light + at_eye + at_light * at_eye * (back - 1))
        glossy = self.specular.max(axis=1, initial=0) > 0
        lobe = np.where(glossy, lobe, 1)
        alpha = np.maximum(self.roughness, 0.1) ** 2
        slope = _dot(self.normals, half) ** 2 * (alpha**2 - 1) + 1
        peak = alpha**2 / slope**2 / (4 * to_light * to_eye)
        peak *= _masked(to_light, alpha) * _masked(to_eye, alpha)
        fresnel = self.specular + (1 - self.specular) * _schlick(between)[:, None]
        gloss = np.minimum(peak, _PEAK)[:, None] * np.where(glossy[:, None], fresnel, 0)
        return (self.diffuse * lobe[:, None] + gloss) / np.pi


def _schlick(cosine: Float64Array) -> Float64Array:
    """Return (1 - cosine)^5 of (N,)."""
    rest = 1 - np.minimum(cosine, 1)
    return rest * rest * rest * rest * rest


def _masked(cosine: Float64Array, alpha: Float64Array) -> Float64Array:
    """Return Smith's masking term of GGX, (N,)."""
    squared = cosine * cosine
    return 2 * cosine / (cosine + np.sqrt(alpha**2 + (1 - alpha**2) * squared))


@dataclass(frozen=True)
class _ShadowRays:
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

    def reflected(self, free: Float32Array, surfaces: _Surfaces) -> Float64Array:
        """Return the radiance (N, 3) that the surfaces reflect of it."""
        light = self.arriving(free) * surfaces.take(self.rows).reflected(self.directions)
        count = len(surfaces.points)
        sums = [np.bincount(self.rows, light[:, band], count) for band in range(3)]
        return np.stack(sums, axis=1)


@dataclass(frozen=True)
class _OutdoorLights:
    """The scene's lights, as they shine on surfaces outdoors."""

    environment: Any | None
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
        return cls(lights.environment, strong, _lamps_of(scene, surfaces, daylight), limit)

    def rays_from(self, surfaces: _Surfaces) -> _ShadowRays:
        """Return the rays by which beams and lamps shine on the surfaces."""
        parts = [each.rays_from(surfaces) for each in (*self.beams, self.lamps) if each is not None]
        empty = _ShadowRays(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
        columns = zip(*(vars(part).values() for part in (empty, *parts)), strict=True)
        return _ShadowRays(*(np.concatenate(column) for column in columns))

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

    def rays_from(self, surfaces: _Surfaces) -> _ShadowRays:
        choice = (surfaces.fractions[:, 2] * len(self.directions)).astype(np.int64)
        towards = self.directions[choice]
        light = self.strengths[choice] * np.maximum(_dot(surfaces.normals, towards), 0)[:, None]
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

    def rays_from(self, surfaces: _Surfaces) -> _ShadowRays:
        """Return rays to one point of one lamp for each surface."""
        edges = np.cumsum(self.probabilities)
        lamp = np.searchsorted(edges, surfaces.fractions[:, 2], side="right")
        lamp = np.minimum(lamp, len(edges) - 1)
        rays = _lamp_rays(self.lamps, lamp, surfaces, surfaces.fractions[:, :2])
        return replace(rays, light=rays.light / self.probabilities[lamp[rays.rows], None])


def _lamps_of(scene: RenderScene, surfaces: _Surfaces, daylight: float) -> _Lamps | None:
    """Return the lamps, if they bring more than a faint part of the surfaces' light."""
    near = np.flatnonzero(~scene.lights.distant)
    if not len(near):
        return None
    lamps = tuple(scene.lights.lamps[index] for index in near)
    points = max(8, min(_PILOT, _PILOT_RAYS // len(lamps)))
    rows = np.linspace(0, len(surfaces.points) - 1, points).astype(np.int64)
    some = surfaces.take(np.tile(rows, len(lamps)))
    lamp = np.repeat(np.arange(len(lamps)), points)
    rays = _lamp_rays(lamps, lamp, some, np.tile(_square(points), (len(lamps), 1)))

    def strength(free: Float32Array) -> Float64Array:
        light = np.bincount(lamp[rays.rows], luminance(rays.arriving(free)), len(lamps))
        return np.asarray(light / points)

    if strength(np.full(len(rays.rows), np.inf, np.float32)).sum() <= _FAINT * daylight:
        return None
    origins = some.points[rays.rows]
    found = strength(raycast.nearest(scene.geometry, origins, rays.directions)[1])
    if not found.any():
        return None
    # One that the pilot found dark may light a few surfaces.
    chance = found + 0.05 * found.sum() / len(lamps)
    return _Lamps(lamps, chance / chance.sum())


def _lamp_rays(
    lamps: tuple[Any, ...], choice: Int64Array, surfaces: _Surfaces, samples: Float64Array
) -> _ShadowRays:
    """Return rays from each surface to the point that its sample (2,) chooses on its lamp."""
    directions, distance, weight, _ = raycast.sample_emitters(
        lamps, choice, surfaces.points, samples
    )
    light = weight * np.maximum(_dot(surfaces.normals, directions), 0)[:, None]
    return _lit(directions, distance.astype(np.float64), light)


def _lit(directions: Float64Array, distances: Float64Array, light: Float64Array) -> _ShadowRays:
    """Return the rays with light, one from each surface."""
    rows = np.flatnonzero(luminance(light) > 0)
    return _ShadowRays(rows, directions[rows], distances[rows], light[rows])


def _fractions(count: int, level: int) -> Float64Array:
    """Return points (count, 4) of the Halton sequence; of other dimensions at each level."""
    columns = []
    for base in _BASES[level]:
        rest, value, scale = np.arange(1, count + 1), np.zeros(count), 1.0
        while rest.any():
            rest, digit = np.divmod(rest, base)
            scale /= base
            value += digit * scale
        columns.append(value)
    return np.stack(columns, axis=1)


def _square(count: int) -> Float64Array:
    """Return points (count, 2) evenly in the unit square."""
    return _fractions(count, 0)[:, :2]


@lru_cache(1)
def _circle() -> Float64Array:
    """Return points (_CIRCLE, 2) of the unit circle."""
    angles = (np.arange(_CIRCLE) + 0.5) * (2 * np.pi / _CIRCLE)
    # Rounded: the last bit of a sine differs between processors.
    return np.round(np.stack([np.cos(angles), np.sin(angles)], axis=1), 7)


def _dot(one: Float64Array, other: Float64Array) -> Float64Array:
    return one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1] + one[:, 2] * other[:, 2]
