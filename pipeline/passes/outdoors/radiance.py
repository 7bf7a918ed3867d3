"""Light that surfaces outdoors send to a camera through windows, without camera paths.

Surfaces have the reflectance and roughness of their materials, with textures and bumps. Each gets,
by rays of fixed sequences:

* sun, distant lights and the bright parts of an environment map: a shadow ray to one of a set of
  directions;
* lamps: a shadow ray to a point on one of those that matter outdoors;
* sky: a cosine-distributed ray. Where it meets a surface, that surface sends the same direct light
  and that of a further ray; where this one meets a surface, the mean of what such surfaces send.

A ray that goes to the sky's bright parts, or to a lamp, counts once: by its shadow ray.
"""

from __future__ import annotations

import numpy as np

from pbrnet.pipeline.passes.groundtruth import rooms_box
from pbrnet.pipeline.passes.outdoors.lights import OutdoorLights
from pbrnet.pipeline.passes.outdoors.surfaces import Surfaces
from pbrnet.pipeline.pathtrace.light_plan import is_outdoors
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array, Int32Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere

_SURVEY = 8192  # rays from all rooms together that look for the reflectance of shapes
_MOST_KEPT = 0.8  # of the light, from one bounce to the next


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
    near = Surfaces.seen(scene, directions, eye)
    away = near.bounces()
    found = raycast.oriented(scene.geometry, near.points, away)
    bounced = np.flatnonzero(found.shape >= 0)
    colors = _albedo_of_shapes(scene, near)[found.shape]
    far = Surfaces.met(scene, found, away, colors).take(bounced)
    last = far.bounces()
    outdoors = is_outdoors(far.points, rooms_box(scene.scene.rooms))
    sides = [side for side in (np.flatnonzero(outdoors), np.flatnonzero(~outdoors)) if len(side)]
    lights = OutdoorLights.of(scene, (near, *map(far.take, sides)), eye)
    both = near.joined(far)
    rays = lights.rays_from(both)
    origins = np.concatenate([both.points[rays.rows], far.points])
    shape, free = raycast.nearest(scene.geometry, origins, np.concatenate([rays.directions, last]))
    direct = rays.reflected(free[: len(rays.rows)], both)
    again = shape[len(rays.rows) :] >= 0  # last rays that meet a surface
    sky = np.pi * lights.sky(np.concatenate([away, last]))
    sent = direct[count:] + far.reflected(last) * sky[count:] * ~again[:, None]
    for side in sides:
        sent[side] = _with_bounces(sent[side], far.diffuse[side], again[side])
    arriving = sky[:count]
    arriving[bounced] = np.pi * sent
    return direct[:count] + near.reflected(away) * arriving


def _albedo_of_shapes(scene: RenderScene, near: Surfaces) -> Float64Array:
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
