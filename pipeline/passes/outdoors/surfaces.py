"""Surfaces outdoors: what they reflect, and where their rays go."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pbrnet.pipeline.passes.inputs import facing_normals
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.render.scene_geometry import Hits
from pbrnet.scenes.arrays import Float64Array, Int32Array, Int64Array
from pbrnet.scenes.geometry.directions import unit

_OFFSET = 1e-5  # of the coordinates, or of 100 m: from a surface to the start of a ray
_CIRCLE = 4096  # azimuths that samples choose from
_PEAK = 10.0  # largest value of the specular lobe, times pi
_BASES = ((2, 3, 5, 7), (11, 13, 17, 19))  # of the Halton sequence, at each level of bounces


@dataclass(frozen=True)
class Surfaces:
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
    def seen(cls, scene: RenderScene, directions: Float64Array, eye: Float64Array) -> Surfaces:
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
    ) -> Surfaces:
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
    ) -> Surfaces:
        fractions = halton(len(directions), level)
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

    def take(self, rows: Int64Array) -> Surfaces:
        return Surfaces(*(each[rows] for each in vars(self).values()))

    def joined(self, other: Surfaces) -> Surfaces:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Surfaces(*(np.concatenate(pair) for pair in pairs))

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
        to_light = np.maximum(dots(self.normals, light), 1e-3)
        to_eye = np.maximum(np.abs(dots(self.normals, self.towards)), 1e-3)
        between = np.clip(dots(light, half), 0, 1)
        at_light, at_eye = _schlick(to_light), _schlick(to_eye)
        back = 2 * self.roughness * between**2
        lobe = (1 - at_light / 2) * (1 - at_eye / 2)
        lobe += back * (at_light + at_eye + at_light * at_eye * (back - 1))
        glossy = self.specular.max(axis=1, initial=0) > 0
        lobe = np.where(glossy, lobe, 1)
        alpha = np.maximum(self.roughness, 0.1) ** 2
        slope = dots(self.normals, half) ** 2 * (alpha**2 - 1) + 1
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


def halton(count: int, level: int) -> Float64Array:
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


@lru_cache(1)
def _circle() -> Float64Array:
    """Return points (_CIRCLE, 2) of the unit circle."""
    angles = (np.arange(_CIRCLE) + 0.5) * (2 * np.pi / _CIRCLE)
    # Rounded: the last bit of a sine differs between processors.
    return np.round(np.stack([np.cos(angles), np.sin(angles)], axis=1), 7)


def dots(one: Float64Array, other: Float64Array) -> Float64Array:
    return one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1] + one[:, 2] * other[:, 2]
