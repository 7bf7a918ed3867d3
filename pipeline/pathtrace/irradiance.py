"""Monte Carlo estimates of irradiance at surface points: emitters, portals and the sun.

The estimates depend on geometry and emitters alone, not on materials. Radiance is Rec. 709
luminance. Points and normals are (Q, 3), world metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.portals import (
    Rectangles,
    perpendicular,
    rectangle_densities,
    sample_rectangles,
)
from pbrnet.pipeline.render.drjit_arrays import column, to_numpy, vector
from pbrnet.pipeline.render.raycast.meshes import ray_intersect, triangles_of
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.color import luminance

RAY_OFFSET = 1e-3  # metres: distance of ray origins from surfaces
_SUN_RAYS = 64  # through each portal
_MAX_SUN_RADIUS, _SUN_STEP = 10.0, 0.005  # degrees: range and resolution of the search
_SUN_CONTRAST = 3.0  # least ratio of radiance inside and outside the edge of the sun's disc
_SUN_MARGIN = 1.03  # factor on the radius: samples at the rounded edge must not miss the disc
_INFINITE_SPREAD = 1e6  # metres: spread of emitters whose irradiance does not vary with position
_MIN_SPREAD = 0.02  # metres


@dataclass(frozen=True)
class SunDisc:
    """Disc of the sun: the direction to its centre (3,) and the cosine of its angular radius."""

    direction: Float64Array
    cosine: float

    @property
    def density(self) -> float:
        """Density by solid angle of directions uniform over the disc."""
        return 1 / (2 * np.pi * (1 - self.cosine))


@dataclass(frozen=True)
class Environment:
    """Environment emitter of a scene.

    `row` is its index among the emitters, `sun` its sun disc, if any. `smooth` says that, apart
    from the sun, its radiance varies so little that uniform sampling of a portal suffices.
    """

    row: int
    sun: SunDisc | None
    smooth: bool


@dataclass(frozen=True)
class EmitterExtents:
    """Mean of each emitter's points (N, 3) and their rms distance from it (N,), metres."""

    centre: Float64Array
    spread: Float64Array


def rms(values: Float64Array) -> Float64Array:
    """Return the root mean square over the first axis."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def first_hits(
    scene: mi.Scene, origins: Float64Array, directions: Float64Array
) -> tuple[Float64Array, Float64Array, BoolArray]:
    """Trace rays; return points (Q, 3), normals facing the ray (Q, 3), and hit flags (Q,).

    For rays that hit nothing, the point is the origin and the normal is the reversed direction.
    """
    ray = mi.Ray3f(vector(mi.Point3f, origins), vector(mi.Vector3f, directions))
    si = ray_intersect(scene, triangles_of(scene), ray, mi.Bool(False), mi.Bool(True))
    normal, hit = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n), si.is_valid()
    values = dr.select(hit, si.p, ray.o), dr.select(hit, normal, -ray.d), hit
    points, normals, met = to_numpy(*values)
    # Rows that are not contiguous, as sums over them are rounded in another order otherwise
    points, normals = (np.asfortranarray(each.astype(np.float64)) for each in (points, normals))
    return points, normals, met


def environment_of(scene: mi.Scene) -> Environment | None:
    """Return the environment of a Mitsuba scene, None if it has none."""
    emitter = scene.environment()
    if emitter is None:
        return None
    row = next(row for row, one in enumerate(scene.emitters()) if one.is_environment())
    params = mi.traverse(emitter)
    keys = {key for key, _ in params.items()}
    if "sun_direction" not in keys:
        return Environment(row, None, not any(key.endswith("data") for key in keys))
    local = np.array(params["sun_direction"], dtype=np.float64).ravel()
    turned = np.array(params["to_world"].matrix, dtype=np.float64).reshape(4, 4)[:3, :3] @ local
    for direction in (turned, local):
        sun = _find_sun_disc(emitter, direction / np.linalg.norm(direction))
        if sun is not None:
            return Environment(row, sun, True)
    return Environment(row, None, float(params["sun_scale"]) == 0)


def in_sun_disc(sun: SunDisc | None, directions: Float64Array) -> BoolArray:
    """Test which directions (..., 3) lie in the sun's disc, (...,)."""
    if sun is None:
        return np.zeros(directions.shape[:-1], dtype=bool)
    return np.asarray(directions @ sun.direction > sun.cosine)


def environment_luminance(
    scene: mi.Scene, points: Float64Array, directions: Float64Array
) -> Float64Array:
    """Return the environment's luminance along directions (Q, 3) from points, 0 if occluded."""
    miss = dr.zeros(mi.SurfaceInteraction3f, len(points))
    miss.wi = vector(mi.Vector3f, -directions)
    light = scene.environment().eval(miss)
    occluded = scene.ray_test(mi.Ray3f(vector(mi.Point3f, points), -miss.wi))
    visible = np.array(dr.select(occluded, 0, light)).T.astype(np.float64)
    return np.asarray(luminance(visible), dtype=np.float64)


def emitter_irradiance(
    scene: mi.Scene,
    points: Float64Array,
    normals: Float64Array,
    portals: Rectangles,
    environment: Environment | None,
    random: np.random.Generator,
) -> tuple[Float64Array, EmitterExtents]:
    """Estimate each emitter's irradiance at each point, (N, Q), with one sample.

    The environment's row holds only the share that sampling of portals and the sun leaves to it:
    for a smooth environment the directions outside them, for others the weight of its own
    sampling by the balance heuristic (Veach and Guibas 1995). Also returns the emitters' extents.
    """
    emitters = mi.EmitterPtr(list(scene.emitters()))
    count = len(emitters)
    index = column(mi.UInt32, np.repeat(np.arange(count), len(points)))
    si = dr.zeros(mi.SurfaceInteraction3f, count * len(points))
    si.p = vector(mi.Point3f, np.tile(points, (count, 1)))
    si.n = vector(mi.Normal3f, np.tile(normals, (count, 1)))
    samples = vector(mi.Point2f, random.random((count * len(points), 2)))
    ds, light = dr.gather(mi.EmitterPtr, emitters, index).sample_direction(si, samples)
    occluded = scene.ray_test(si.spawn_ray_to(ds.p), ds.pdf != 0)
    light = dr.select(occluded | (ds.pdf == 0), 0, light * dr.maximum(dr.dot(ds.d, si.n), 0))
    density, directions = np.array(ds.pdf, dtype=np.float64), np.array(ds.d).T
    irradiance = luminance(np.array(light).T.astype(np.float64)).reshape(count, -1)
    if environment is not None:
        own = slice(environment.row * len(points), (environment.row + 1) * len(points))
        outwards = directions[own].astype(np.float64)
        others = rectangle_densities(portals, points, outwards).sum(axis=1)
        if environment.smooth:
            irradiance[environment.row] *= (others == 0) & ~in_sun_disc(environment.sun, outwards)
        else:
            irradiance[environment.row] *= density[own] / np.maximum(density[own] + others, 1e-30)
    emitter_points = np.array(ds.p).T.astype(np.float64).reshape(count, -1, 3)
    return np.nan_to_num(irradiance), _extents(scene, emitter_points)


def portal_irradiance(
    scene: mi.Scene,
    points: Float64Array,
    normals: Float64Array,
    portals: Rectangles,
    environment: Environment | None,
    random: np.random.Generator,
) -> Float64Array:
    """Estimate the sky's irradiance through each portal at each point, (K, Q), with one sample."""
    count = len(portals.area)
    if not count or environment is None:
        return np.zeros((count, len(points)))
    directions, weight = sample_rectangles(portals, points, normals, random)
    weight = weight * ~in_sun_disc(environment.sun, directions)
    light = environment_luminance(scene, np.tile(points, (count, 1)), directions.reshape(-1, 3))
    return np.asarray(np.nan_to_num(light.reshape(count, -1) * weight))


def sun_irradiance(
    scene: mi.Scene,
    points: Float64Array,
    normals: Float64Array,
    sun: SunDisc | None,
    random: np.random.Generator,
) -> Float64Array:
    """Estimate the sun's irradiance at each point, (1, Q), with one sample."""
    if sun is None:
        return np.zeros((1, len(points)))
    samples = vector(mi.Point2f, random.random((len(points), 2)))
    local = mi.warp.square_to_uniform_cone(samples, sun.cosine)
    frame = mi.Frame3f(mi.Vector3f(*sun.direction.tolist()))
    directions = np.array(frame.to_world(local)).T.astype(np.float64)
    cosine = np.maximum((directions * normals).sum(axis=-1), 0)
    return (environment_luminance(scene, points, directions) * cosine / sun.density)[None]


def sunlit_surfaces(
    scene: mi.Scene,
    portals: Rectangles,
    sun: SunDisc | None,
    rays: int,
    random: np.random.Generator,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Trace the sun's rays through portals, this many through each.

    Returns hit points (R, 3), normals (R, 3) and the flux (R,) of each ray, 0 where something hides
    the sun.
    """
    count = len(portals.area)
    if sun is None or not count:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    samples = random.random((count, rays, 2, 1))
    first, second = (edge[:, None] for edge in portals.edges)
    points = portals.corner[:, None] + samples[:, :, 0] * first + samples[:, :, 1] * second
    points = points.reshape(-1, 3)
    inwards = np.tile(-sun.direction, (len(points), 1))
    hits, facing, hit = first_hits(scene, points, inwards)
    radiance = environment_luminance(scene, hits + RAY_OFFSET * facing, -inwards)
    through = np.maximum(portals.normal @ sun.direction, 0) * portals.area / rays
    flux = np.nan_to_num(radiance) / sun.density * np.repeat(through, rays)
    return hits, facing, np.where(hit, flux, 0)


def sun_strength(
    scene: mi.Scene, portals: Rectangles, sun: SunDisc | None, random: np.random.Generator
) -> float:
    """Estimate the root mean square of the sun's irradiance where it shines through portals.

    On a surface that faces it; 0 if its rays pass no portal or all of them are hidden.
    """
    _, _, flux = sunlit_surfaces(scene, portals, sun, _SUN_RAYS, random)
    if sun is None or not flux.any():
        return 0.0
    areas = np.repeat(np.maximum(portals.normal @ sun.direction, 0) * portals.area, _SUN_RAYS)
    irradiance = np.divide(flux * _SUN_RAYS, areas, out=np.zeros_like(flux), where=areas > 0)
    return float(np.sqrt((irradiance**2 * areas).sum() / areas.sum()))


def _find_sun_disc(emitter: mi.Emitter, direction: Float64Array) -> SunDisc | None:
    """Return the sun around `direction`, with its radius measured in the sky's radiance.

    None if the radiance has no edge there: the sun is not in this direction.
    """
    sideways = perpendicular(direction)
    angles = np.radians(np.arange(0, _MAX_SUN_RADIUS, _SUN_STEP))
    directions = np.cos(angles)[:, None] * direction + np.sin(angles)[:, None] * sideways
    miss = dr.zeros(mi.SurfaceInteraction3f, len(angles))
    miss.wi = vector(mi.Vector3f, -directions)
    light = luminance(np.array(emitter.eval(miss)).T.astype(np.float64))
    edge = int(np.argmax(light[:-1] / np.maximum(light[1:], 1e-30)))
    if light[edge] <= _SUN_CONTRAST * light[edge + 1]:
        return None
    # A little wider than the disc: at the rounded edge samples then meet sky, not sun.
    return SunDisc(direction, float(np.cos(_SUN_MARGIN * angles[edge + 1])))


def _extents(scene: mi.Scene, points: Float64Array) -> EmitterExtents:
    """Return extents from sampled points (N, Q, 3); infinitely distant emitters have no centre."""
    infinite = [mi.has_flag(one.flags(), mi.EmitterFlags.Infinite) for one in scene.emitters()]
    finite = np.where(np.isfinite(points), points, 0)
    centre = np.where(np.array(infinite)[:, None], 0, finite.mean(axis=1))
    spread = np.sqrt(((finite - centre[:, None]) ** 2).sum(axis=-1).mean(axis=1))
    return EmitterExtents(
        centre, np.where(infinite, _INFINITE_SPREAD, np.maximum(spread, _MIN_SPREAD))
    )
