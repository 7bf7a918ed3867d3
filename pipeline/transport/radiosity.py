"""Radiosity among surfels around a view.

Surfels are what the view's surfaces see: camera rays of a coarse grid go on in cosine-distributed
directions twice, and both places that they meet become surfels. So they lie where the pixels gather
light, behind the camera, behind furniture, in the next room and outdoors as well. Each surfel gets
direct light by emitter samples and traces a few rays. What they meet is looked up in cells of
surfels, which makes visibility exact and the exchange of light a sparse product; it is repeated for
every bounce (Jacobi iteration). All surfaces count as diffuse, with their base colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pipeline.pathtrace.light_sampling import PlannedLights
from pipeline.render.drjit_arrays import to_numpy
from pipeline.transport.cells import Cells, max_surfels
from pipeline.transport.gather import gather, sampler_of
from pipeline.transport.rays import ShapeTables, facing_normal, first_surface, surface_point
from scenes.arrays import AnyArray, Float32Array

RAYS = 8  # from each surfel
BOUNCES = 8
_BRANCHES = 4  # paths that go on from each camera ray


@dataclass(frozen=True)
class Surfels:
    """M surface points with what their rays meet (M * RAYS); light is that of white surfaces."""

    points: Float32Array  # (M, 3)
    normals: Float32Array  # (M, 3)
    measure: Float32Array  # (M,): how much of what the view sees each stands for; 0: no surface
    direct: Float32Array  # (M, 3)
    met_points: Float32Array  # (M * RAYS, 3)
    met_normals: Float32Array  # (M * RAYS, 3)
    weights: Float32Array  # (M * RAYS, 3): reflectance times the ray's weight, 0 if nothing is met


def solve(surfels: Surfels, centre: AnyArray, bounces: int = BOUNCES) -> tuple[Cells, Float32Array]:
    """Return the cells of the surfels, and the light that falls on each (C + 1, 3).

    The last row is the mean of all. Direct light counts as well; `bounces` is how often light is
    reflected before.
    """
    count = len(surfels.points)
    valid = surfels.measure > 0
    cells = Cells.of(surfels.points[valid], surfels.normals[valid], surfels.measure[valid], centre)
    found = cells.find(surfels.met_points, surfels.met_normals)
    light = cells.means(surfels.direct[valid])
    for _ in range(bounces):
        arriving = light[found] * surfels.weights
        reflected = arriving.reshape(count, -1, 3).mean(axis=1, dtype=np.float32)
        light = cells.means((surfels.direct + reflected)[valid])
    return cells, light


def surfels_of(arrays: tuple[Any, ...]) -> Surfels:
    """Return the surfels that `trace_surfels` made, in NumPy arrays."""
    points, normals, measure, direct, met_points, met_normals, weights = to_numpy(*arrays)
    direct = np.nan_to_num(direct.reshape(len(points), RAYS, 3)).mean(axis=1, dtype=np.float32)
    # Where a ray meets nothing, position and normal are not defined.
    met_points, met_normals = (np.nan_to_num(each) for each in (met_points, met_normals))
    return Surfels(points, normals, measure, direct, met_points, met_normals, weights)


def grid_size(surfels: int, width: int, height: int) -> tuple[int, int]:
    """Return columns and rows of the camera rays that give about this number of surfels."""
    rays = max(1, min(surfels, max_surfels()) // (2 * _BRANCHES))
    columns = max(1, round((rays * width / height) ** 0.5))
    return columns, max(1, rays // columns)


def trace_surfels(
    scene: Any,
    tables: ShapeTables,
    lights: PlannedLights,
    camera: tuple[Any, Any],
    size: tuple[int, int],
    seed: Any,
) -> tuple[Any, ...]:
    """Return the arrays of `Surfels` as Dr.Jit arrays; `direct` has a row for each ray.

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
    si, _ = first_surface(scene, tables, ray, mi.Bool(True))
    places, normals, measures = [], [], []
    measure = dr.select(si.is_valid(), mi.Float(1), 0)
    for bounce in range(2):
        normal = facing_normal(si, ray.d)
        point = surface_point(si.p, normal)
        random, square = sampler.next_1d(), sampler.next_2d()
        direction = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(square))
        guidance = lights.guidance(point, measure > 0) if bounce == 0 else None
        if guidance is not None:
            guided, random = guidance.split(random)
            direction = dr.select(guided, guidance.direction(random, square), direction)
            cosine = dr.maximum(dr.dot(direction, normal), 0) * dr.inv_pi
            pdf = guidance.mixed_density(cosine, direction)
            measure *= dr.select(pdf > 0, cosine / pdf, 0)
        ray = point.spawn_ray(direction)
        si, _ = first_surface(scene, tables, ray, measure > 0)
        measure = dr.select(si.is_valid(), measure, 0)
        active = measure > 0
        places.append(dr.select(active, mi.Point3f(si.p), 0))
        normals.append(dr.select(active, facing_normal(si, ray.d), mi.Vector3f(0, 0, 1)))
        measures.append(measure)
    point = mi.Point3f(*(dr.concat([one[axis] for one in places]) for axis in range(3)))
    normal = mi.Vector3f(*(dr.concat([one[axis] for one in normals]) for axis in range(3)))
    measure = dr.concat(measures)
    dr.eval(point, normal, measure)

    return light_surfels(scene, tables, lights, point, normal, measure, seed + 1)


def light_surfels(
    scene: Any,
    tables: ShapeTables,
    lights: PlannedLights,
    point: Any,
    normal: Any,
    measure: Any,
    seed: Any,
) -> tuple[Any, ...]:
    """Return the arrays of `Surfels` at these places, as `trace_surfels` does."""
    count = dr.width(point)
    index = dr.arange(mi.UInt32, count * RAYS) // RAYS
    position = dr.gather(mi.Point3f, point, index)
    towards = dr.gather(mi.Vector3f, normal, index)
    active = dr.gather(mi.Float, measure, index) > 0
    found = gather(scene, tables, lights, sampler_of(RAYS, count, seed), position, towards, active)
    hit = active & found.si.is_valid() & (found.weight > 0)
    reflectance = tables.reflectance_at(found.si, hit)
    return (
        point,
        normal,
        measure,
        found.direct,
        dr.select(hit, mi.Point3f(found.si.p), 0),
        dr.select(hit, facing_normal(found.si, found.direction), mi.Vector3f(0, 0, 1)),
        dr.select(hit, reflectance * found.weight, 0),
    )


def camera_ray(camera: tuple[Any, Any], x: Any, y: Any) -> Any:
    """Return the camera rays through image positions; `camera` as in `trace_surfels`."""
    eye, matrix = camera

    def entry(values: Any, place: int) -> Any:
        return dr.gather(mi.Float, values, mi.UInt32(place))

    direction = mi.Vector3f(
        *(
            entry(matrix, 3 * row) * x + entry(matrix, 3 * row + 1) * y + entry(matrix, 3 * row + 2)
            for row in range(3)
        )
    )
    origin = mi.Point3f(*(entry(eye, axis) for axis in range(3)))
    return mi.Ray3f(origin, dr.normalize(direction))
