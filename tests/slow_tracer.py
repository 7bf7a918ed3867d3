"""A path tracer to be read beside the fast one: it samples no lights and ends no path by chance.

A path starts at the camera, adds what shines at each thing it meets, and goes on in a direction
drawn by that thing's material. Rays are rows of arrays; lengths are metres, light is radiance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pipeline.views import View
from tests.joint_fixtures import bsdf, rgb
from tests.render_fixtures import ball, diffuse, glow, quad

Array = npt.NDArray[np.float64]
Triple = tuple[float, float, float]
GLASS = 1.5046 / 1.000277  # Mitsuba's: borosilicate crown in air
FAR, NEAR = 1e9, 1e-6


@dataclass(frozen=True)
class Material:
    """`colour` is what diffuse things and mirrors reflect, and what glass lets through."""

    kind: str  # "diffuse", "mirror" or "glass"
    colour: Triple
    light: Triple = (0, 0, 0)

    def twin(self, grey: float) -> Material:
        """What shading sees: grey things, colourless glass, the same light."""
        return replace(self, colour=(1, 1, 1) if self.kind == "glass" else (grey,) * 3)

    def xml(self) -> str:
        colour = ",".join(map(str, self.colour))
        if self.kind == "mirror":
            return bsdf("conductor", rgb("specular_reflectance", colour))
        if self.kind == "glass":
            return bsdf("dielectric", rgb("specular_transmittance", colour))
        shining = glow(",".join(map(str, self.light))) if any(self.light) else ""
        return shining or diffuse(colour)


class Thing(Protocol):
    """A surface of one material."""

    material: Material

    def distances(self, origins: Array, directions: Array) -> Array: ...
    def normals(self, points: Array) -> Array: ...
    def xml(self, name: str) -> str: ...


@dataclass(frozen=True)
class Rectangle:
    """Its front is where `towards`, a unit vector, points; `half` is along its right and up."""

    centre: Triple
    towards: Triple
    half: tuple[float, float]
    material: Material
    up: Triple = (0, 0, 1)

    def distances(self, origins: Array, directions: Array) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((np.array(self.centre) - origins) @ self.towards) / (directions @ self.towards)
            away = origins + along[:, None] * directions - self.centre
            right = np.cross(self.up, self.towards)
            inside = (abs(away @ right) <= self.half[0]) & (abs(away @ self.up) <= self.half[1])
            return np.where(inside & (along > NEAR), along, FAR)

    def normals(self, points: Array) -> Array:
        return np.broadcast_to(np.array(self.towards, dtype=float), points.shape)

    def xml(self, name: str) -> str:
        return quad(name, self.centre, self.towards, self.half, self.material.xml(), self.up)


@dataclass(frozen=True)
class Ball:
    centre: Triple
    radius: float
    material: Material

    def distances(self, origins: Array, directions: Array) -> Array:
        away = origins - self.centre
        half = np.sum(away * directions, axis=-1)
        root = np.sqrt(np.maximum(half**2 - np.sum(away**2, axis=-1) + self.radius**2, 0))
        near, far = -half - root, -half + root
        found = np.where(near > NEAR, near, far)
        return np.where((root > 0) & (found > NEAR), found, FAR)

    def normals(self, points: Array) -> Array:
        return (points - self.centre) / self.radius

    def xml(self, name: str) -> str:
        return ball(name, self.centre, self.radius, self.material.xml())


def picture(
    things: list[Thing], view: View, max_depth: int, spp: int, rng: np.random.Generator
) -> Array:
    """The image (H, W, 3) of `spp` paths a pixel that meet up to `max_depth` things each."""
    directions = _camera_rays(view, spp, rng)
    origins = np.broadcast_to(view.pose[:3, 3], directions.shape).copy()
    throughput, light = np.ones_like(directions), np.zeros_like(directions)
    for _ in range(max_depth):
        distances = np.stack([thing.distances(origins, directions) for thing in things])
        met = np.where(distances.min(axis=0) < FAR, distances.argmin(axis=0), -1)
        throughput[met < 0] = 0  # out into the dark
        points = origins + distances.min(axis=0)[:, None] * directions
        for number, thing in enumerate(things):
            here = met == number
            normals = thing.normals(points[here])
            front = np.sum(normals * directions[here], axis=-1) < 0
            light[here] += throughput[here] * front[:, None] * thing.material.light
            after, weight = _scatter(thing.material, directions[here], normals, rng)
            origins[here], directions[here] = points[here] + NEAR * after, after
            throughput[here] *= weight
    return light.reshape(view.height, view.width, spp, 3).mean(axis=2)


def _camera_rays(view: View, spp: int, rng: np.random.Generator) -> Array:
    """Unit directions through random places of each pixel, (H * W * spp, 3)."""
    rows, columns = np.indices((view.height, view.width, spp))[:2]
    places = np.stack([columns + rng.random(rows.shape), rows + rng.random(rows.shape)], axis=-1)
    pixels = np.concatenate([places.reshape(-1, 2), np.ones((rows.size, 1))], axis=-1)
    return _unit(pixels @ np.linalg.inv(view.K).T @ view.pose[:3, :3].T)


def _scatter(
    material: Material, incoming: Array, normals: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Where a path goes on, and what remains of its light, (N, 3) each."""
    cosine = np.sum(incoming * normals, axis=-1, keepdims=True)  # negative where it comes in
    colour = np.broadcast_to(np.array(material.colour, dtype=float), incoming.shape)
    mirrored = incoming - 2 * cosine * normals
    if material.kind == "mirror":
        return mirrored, colour
    if material.kind == "diffuse":
        # A point of the unit sphere on top of the normal: by the cosine (Lambert).
        towards_us = np.where(cosine < 0, normals, -normals)
        return _unit(towards_us + _unit(rng.normal(size=incoming.shape))), colour
    # Fresnel's equations and Snell's law. Radiance gains eta² on its way in and loses it on its
    # way out; no light stands in the glass, so that is left out.
    eta = np.where(cosine < 0, GLASS, 1 / GLASS)
    first = abs(cosine)
    below = 1 - (1 - first**2) / eta**2  # the refracted ray's cosine, squared
    second = np.sqrt(np.maximum(below, 0))
    across = (first - eta * second) / (first + eta * second)
    plane = (eta * first - second) / (eta * first + second)
    reflected = np.where(below > 0, (across**2 + plane**2) / 2, 1.0)
    bent = incoming / eta + np.where(cosine < 0, 1, -1) * (first / eta - second) * normals
    back = rng.random(reflected.shape) < reflected
    return np.where(back, mirrored, bent), np.where(back, 1.0, colour)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
