"""Radiosity among surfels around a view.

Surfels are what the view's surfaces see: camera rays of a coarse grid go on in cosine-distributed
directions three times, and all places that they meet become surfels. So they lie where the pixels
gather light, behind the camera, behind furniture, in the next room and outdoors as well. Each
surfel gets direct light by emitter samples and traces a few rays. What they meet is looked up in
cells of surfels, which makes visibility exact and the exchange of light a sparse product; it is
repeated for every bounce (Jacobi iteration). Surfaces reflect in all directions alike, with the
albedo of all their lobes towards the ray that found them. Cloth that transmits light is lit from
both sides: rays start on either.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import to_numpy
from pbrnet.pipeline.transport.cells import Cells, max_surfels
from pbrnet.pipeline.transport.gather import (
    World,
    diffuse_albedo,
    gather,
    reflect,
    reflected,
    rough_albedo,
    sampler_of,
)
from pbrnet.pipeline.transport.rays import facing_normal, first_surface, surface_point
from pbrnet.scenes.arrays import AnyArray, Float32Array, Int64Array

RAYS = 8  # from each surfel
BOUNCES = 8
_DARK = 1e-3  # albedo that is not scaled
_BRANCHES = 4  # paths that go on from each camera ray
_VERTICES = 3  # surfels along each such path


@dataclass(frozen=True)
class Surfels:
    """M surface points with what their rays meet (M * RAYS); light is that of white surfaces."""

    points: Float32Array  # (M, 3)
    normals: Float32Array  # (M, 3)
    measure: Float32Array  # (M,): how much of what the view sees each stands for; 0: no surface
    albedo: Float32Array  # (M, 3): by all lobes, towards the ray that found the surfel
    rough_albedo: Float32Array  # (M, 3): as `met_light` has it
    direct: Float32Array  # (M, 3)
    met_points: Float32Array  # (M * RAYS, 3)
    met_normals: Float32Array  # (M * RAYS, 3)
    weights: Float32Array  # (M * RAYS,): of the rays, 0 if nothing is met
    met_light: Float32Array  # (M * RAYS, 3): direct light, weighted, times what is met's albedo
    lost: int = 0  # surfels with light or albedo that is not finite, which counts as 0


@dataclass(frozen=True)
class Rays:
    """Rays and what they find: samples of what cells reflect."""

    cells: Int64Array  # (N,): the cell that each meets
    weights: Float32Array  # (N,): how much each counts, 0 if nothing is met
    light: Float32Array  # (N, 3): direct light that what is met reflects, times the weight

    @classmethod
    def of(cls, entry: AnyArray, share: Float32Array, once: Float32Array, cells: Cells) -> Rays:
        """Return the rays of pixels; see `pbrnet.pipeline.transport.pixels.LightSamples`."""
        return cls(np.minimum(entry, len(cells.keys)).astype(np.int64), share, once)


def cells_of(surfels: Surfels, centre: AnyArray) -> Cells:
    """Return the cells of the surfels in a grid around `centre` (3,)."""
    valid = surfels.measure > 0
    return Cells.of(surfels.points[valid], surfels.normals[valid], surfels.measure[valid], centre)


def solve(
    surfels: Surfels, cells: Cells, pixels: Rays, bounces: int = BOUNCES
) -> tuple[Float32Array, Float32Array]:
    """Return the light on each cell of the surfels, and what each reflects, linear RGB.

    Both are (C + 1, 3); the last row is for what lies in no cell. `pixels` are the rays by which
    pixels gather light. `bounces` is how often light is reflected before; direct light counts as
    well. The mean of a cell's reflected light, not of its reflectance and its light apart, keeps
    energy where bright surfaces are brightly lit: a lamp's bowl before a wall.

    Cells reflect direct light as the rays that meet them find it: for pixels by their own rays
    alone, so that in the mean over the image it is what these find; for surfels by all rays. Large
    cells do not reflect direct light: what is far from all surfels, such as a house in the sun, is
    not lit as they are. There it is sampled on the very surface that a ray meets.
    """
    count = len(surfels.points)
    valid = surfels.measure > 0
    found = cells.find(surfels.met_points, surfels.met_normals)
    weights, albedo = surfels.weights[:, None], surfels.albedo[valid]
    direct = cells.means(albedo * surfels.direct[valid])
    measure = np.repeat(surfels.measure, RAYS)
    rays = Rays(found, measure * surfels.weights, measure[:, None] * surfels.met_light)
    rough = cells.means(surfels.rough_albedo[valid])
    scale = np.where(rough > _DARK, cells.means(albedo) / np.maximum(rough, _DARK), 1)
    seen = _pooled(direct, scale, cells, pixels)
    met = _pooled(direct, scale, cells, pixels, rays)
    arriving = np.where(cells.is_fine[found, None], met[found] * weights, surfels.met_light)
    once = arriving.reshape(count, -1, 3).mean(axis=1, dtype=np.float32)
    indirect = once if bounces else np.zeros_like(once)
    for _ in range(bounces - 1):
        arriving = cells.means(albedo * indirect[valid])[found] * weights
        indirect = once + arriving.reshape(count, -1, 3).mean(axis=1, dtype=np.float32)
    light = (surfels.direct + indirect)[valid]
    both = cells.means(np.concatenate([light, albedo * indirect[valid]], axis=1))
    return both[:, :3], both[:, 3:] + seen


def _pooled(direct: Float32Array, scale: Float32Array, cells: Cells, *rays: Rays) -> Float32Array:
    """Return what cells reflect of direct light, (C + 1, 3): the mean over the rays that meet them.

    `direct` are means over each cell's surfels, which count where no ray comes, `scale` is their
    albedo over the rough one of the rays. Large cells are 0.
    """
    hit = np.concatenate([each.cells for each in rays])
    found = np.concatenate([each.light for each in rays])
    weights = np.bincount(hit, np.concatenate([each.weights for each in rays]), len(direct))
    light = np.stack([np.bincount(hit, band, len(direct)) for band in found.T], axis=1)
    met = weights > 0
    pooled = direct.copy()
    pooled[met] = light[met] * scale[met] / weights[met, None]
    pooled[~cells.is_fine] = 0
    return pooled


def surfels_of(arrays: tuple[dr.ArrayBase, ...]) -> Surfels:
    """Return the surfels that `light_surfels` made, in NumPy arrays."""
    points, normals, measure, rough, albedo, direct, *met = to_numpy(*arrays)

    values = (albedo, direct, met[-1])
    sound = np.logical_and.reduce([np.isfinite(each).all(axis=-1) for each in values])
    lost = int((~sound.reshape(-1, RAYS)).any(axis=1).sum())

    def mean(light: Float32Array) -> Float32Array:
        rows = np.nan_to_num(light).reshape(len(points), RAYS, 3)
        return rows.mean(axis=1, dtype=np.float32)

    # Where a ray meets nothing, position and normal are not defined.
    met_points, met_normals, weights, met_light = map(np.nan_to_num, met)
    return Surfels(
        points,
        normals,
        measure,
        mean(albedo),
        np.nan_to_num(rough),
        mean(direct),
        met_points,
        met_normals,
        weights,
        met_light,
        lost,
    )


def grid_size(surfels: int, width: int, height: int) -> tuple[int, int]:
    """Return columns and rows of the camera rays that give about this number of surfels."""
    rays = max(1, min(surfels, max_surfels()) // (_VERTICES * _BRANCHES))
    columns = max(1, round((rays * width / height) ** 0.5))
    return columns, max(1, rays // columns)


def trace_surfels(
    world: World, camera: tuple[mi.Float, mi.Float], size: tuple[int, int], seed: mi.UInt32
) -> tuple[mi.Point3f, mi.Vector3f, mi.Float]:
    """Return origins and directions of the rays that meet surfels, and the surfels' measure.

    `camera` is the eye, `mi.Float` (3,), and the matrix from pixels of the grid, which is of
    `size` (columns, rows), to directions, `mi.Float` (9,).
    """
    columns, rows = size
    lanes = columns * rows * _BRANCHES
    sampler = sampler_of(_BRANCHES, columns * rows, seed)
    cell = dr.arange(mi.UInt32, lanes) // _BRANCHES
    offset = sampler.next_2d()
    ray = camera_ray(
        camera, mi.Float(cell % columns) + offset.x, mi.Float(cell // columns) + offset.y
    )
    si, _ = first_surface(world.scene, world.tables, ray, mi.Bool(True))
    origins, directions, measures = [], [], []
    measure = dr.select(si.is_valid(), mi.Float(1), 0)
    for bounce in range(_VERTICES):
        normal = world.tables.lit_side(sampler, si, facing_normal(si, ray.d), measure > 0)
        point = surface_point(si.p, normal)
        random, square = sampler.next_1d(), sampler.next_2d()
        direction = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(square))
        guidance = world.lights.guidance(point, measure > 0) if bounce == 0 else None
        if guidance is not None:
            guided, random = guidance.split(random)
            direction = dr.select(guided, guidance.direction(random, square), direction)
            cosine = dr.maximum(dr.dot(direction, normal), 0) * dr.inv_pi
            pdf = guidance.mixed_density(cosine, direction)
            measure *= dr.select(pdf > 0, cosine / pdf, 0)
        ray = point.spawn_ray(direction)
        si, _ = first_surface(world.scene, world.tables, ray, measure > 0)
        measure = dr.select(si.is_valid(), measure, 0)
        origins.append(dr.select(measure > 0, mi.Point3f(ray.o), 0))
        directions.append(dr.select(measure > 0, mi.Vector3f(ray.d), mi.Vector3f(0, 0, 1)))
        measures.append(measure)
    origin = mi.Point3f(*(dr.concat([one[axis] for one in origins]) for axis in range(3)))
    direction = mi.Vector3f(*(dr.concat([one[axis] for one in directions]) for axis in range(3)))
    return origin, direction, dr.concat(measures)


def surfels_in_view(
    world: World, camera: tuple[mi.Float, mi.Float], size: tuple[int, int], seed: mi.UInt32
) -> tuple[dr.ArrayBase, ...]:
    """Return the arrays of the `Surfels` of a view; see `trace_surfels` and `light_surfels`."""
    rays = trace_surfels(world, camera, size, seed)
    dr.eval(rays)
    return light_surfels(world, rays, seed + 1)


def light_surfels(
    world: World, rays: tuple[mi.Point3f, mi.Vector3f, mi.Float], seed: mi.UInt32
) -> tuple[dr.ArrayBase, ...]:
    """Return the arrays of `Surfels` that rays meet, as Dr.Jit arrays.

    `rays` are as `trace_surfels` returns them. `albedo` and `direct` have a row for each of a
    surfel's `RAYS` rays.
    """
    origin, direction, measure = rays
    count = dr.width(measure)
    index = dr.arange(mi.UInt32, count * RAYS) // RAYS
    sampler = sampler_of(RAYS, count, seed)
    # One ray finds each surfel, all of its rays start there.
    found, _ = first_surface(world.scene, world.tables, mi.Ray3f(origin, direction), measure > 0)
    dr.eval(found)
    si = dr.gather(mi.SurfaceInteraction3f, found, index)
    active = (dr.gather(mi.Float, measure, index) > 0) & si.is_valid()
    normal = facing_normal(si, dr.gather(mi.Vector3f, direction, index))
    side = world.tables.lit_side(sampler, si, normal, active)
    found = gather(world, sampler, si.p, side, active)
    _, gloss = reflect(world, sampler, si, active)
    hit = active & found.si.is_valid() & (found.weight > 0)
    first = dr.arange(mi.UInt32, count) * RAYS
    place = dr.select(active, mi.Point3f(si.p), 0)
    towards = dr.select(active, normal, mi.Vector3f(0, 0, 1))
    met = dr.select(active, mi.Float(1), 0)
    rough = rough_albedo(world.tables, si, active)
    arrays = (
        diffuse_albedo(world, si, found.cosine, active) + gloss,
        dr.select(active, found.direct, 0),
        dr.select(hit, mi.Point3f(found.si.p), 0),
        dr.select(hit, facing_normal(found.si, found.direction), mi.Vector3f(0, 0, 1)),
        dr.select(hit, found.weight, 0),
        reflected(world, sampler, found, hit),
    )
    dr.eval(arrays, place, towards, met, rough)
    return (
        dr.gather(mi.Point3f, place, first),
        dr.gather(mi.Vector3f, towards, first),
        measure * dr.gather(mi.Float, met, first),
        dr.gather(mi.Color3f, rough, first),
        *arrays,
    )


def camera_ray(camera: tuple[mi.Float, mi.Float], x: mi.Float, y: mi.Float) -> mi.Ray3f:
    """Return the camera rays through image positions; `camera` as in `trace_surfels`."""
    eye, matrix = camera

    def entry(values: mi.Float, place: int) -> mi.Float:
        return dr.gather(mi.Float, values, mi.UInt32(place))

    direction = mi.Vector3f(
        *(
            entry(matrix, 3 * row) * x + entry(matrix, 3 * row + 1) * y + entry(matrix, 3 * row + 2)
            for row in range(3)
        )
    )
    origin = mi.Point3f(*(entry(eye, axis) for axis in range(3)))
    return mi.Ray3f(origin, dr.normalize(direction))
