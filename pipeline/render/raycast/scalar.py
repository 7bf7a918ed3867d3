"""Ray casting for the scalar variant: a Python loop over the rays.

The same functions as `pbrnet.pipeline.render.raycast.wavefront`; `pbrnet.pipeline.render.raycast`
documents them.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.raycast.triangles import (
    ASIDE,
    Triangles,
    comes_near,
    meet,
    owners_of,
    partners_of,
    triangles_of,
)
from pbrnet.pipeline.render.scene_geometry import (
    MAX_LAYERS,
    MAX_SURFACES,
    Hits,
    SceneGeometry,
    TextureSlot,
)
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.geometry.directions import turned


def nearest(
    geometry: SceneGeometry, through: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return shape index (N,) and distance (N,)."""
    count = len(directions)
    shapes, distances = np.full(count, -1, np.int32), np.full(count, np.inf, np.float32)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shapes[i], distances[i], _, _ = _first_hit(geometry, _ray(o, d), through)
    return shapes, distances


def nearest_from_cameras(geometry: SceneGeometry, poses: AnyArray, local: AnyArray) -> AnyArray:
    """Return shape indices (N * P,) for cameras (N, 4, 4) and camera-frame directions (P, 3)."""
    found = []
    for pose in poses:
        directions = turned(local, pose[:3, :3])
        origins = np.broadcast_to(pose[:3, 3], directions.shape)
        found.append(nearest(geometry, True, origins, directions)[0])
    return np.concatenate(found)


def surfaces(
    geometry: SceneGeometry,
    colors: bool,
    slots: tuple[TextureSlot, ...] | None,
    origins: AnyArray,
    directions: AnyArray,
) -> tuple[AnyArray, ...]:
    """Return the fields of `Hits`, in order; with slots their values, s, dp_du and dp_dv, too."""
    count = len(directions)
    hits = Hits(
        np.full(count, -1, np.int32),
        np.full(count, np.inf, np.float32),
        *(np.zeros((count, 3), np.float32) for _ in range(4)),
    )
    values = [np.zeros((count, slot.bands), np.float32) for slot in slots or ()]
    tangents = [np.zeros((count, 3), np.float32) for _ in range(3)]
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shape, distance, hit, ray = _first_hit(geometry, _ray(o, d), True)
        if shape < 0:
            continue
        si = hit.compute_surface_interaction(ray)
        hits.shape[i], hits.distance[i] = shape, distance
        hits.position[i], hits.geometric_normal[i] = si.p, si.n
        hits.shading_normal[i] = si.sh_frame.n
        if colors:
            twin = geometry.reflectances[_shape_numbers(geometry)[si.shape.ptr]]
            hits.reflectance[i] = np.clip(twin.eval_diffuse_reflectance(si), 0, 1)
        for array, slot in zip(values, slots or (), strict=True):
            if slot.textures[shape] is not None:
                array[i] = getattr(slot.textures[shape], slot.way)(si)
        for array, vector in zip(tangents, (si.sh_frame.s, si.dp_du, si.dp_dv), strict=True):
            array[i] = vector
    found = tuple(vars(hits).values())
    if slots is None:
        return found
    return *found, *(a[:, 0] if a.shape[1] == 1 else a for a in values), *tangents


def oriented(
    geometry: SceneGeometry, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return the fields of `Hits`, the geometric normal twice."""
    shape, distance, position, normal, _, none = surfaces(
        geometry, False, None, origins, directions
    )
    return shape, distance, position, normal, normal, none


def objects_along(
    geometry: SceneGeometry, numbers: AnyArray, words: int, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return a bit for each object that a ray meets, (N, words)."""
    met = np.zeros((len(directions), words), np.uint32)
    indices = _shape_numbers(geometry)
    owners = owners_of(_triangles(geometry))
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        ray = _ray(o, d)
        for _ in range(MAX_SURFACES + 1):
            hit = _intersect(geometry, ray)
            if not hit.is_valid():
                break
            shape = indices[hit.shape.ptr]
            if not _passes(geometry, shape, hit, ray):
                partners = _partners_met(geometry, ray, _face(geometry, hit), same_side=False)
                for number in numbers[[shape, *owners[partners]]]:
                    if number >= 0:
                        met[i, number // 32] |= np.uint32(1 << int(number % 32))
            ray = mi.Ray3f(ray(_past(hit, ray)), ray.d)
    return (met,)


def emitted_radiance(
    geometry: SceneGeometry, emitting: AnyArray, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return shape index (N,), distance (N,) and emitted radiance (N, 3)."""
    count = len(directions)
    shapes, distances = np.full(count, -1, np.int32), np.full(count, np.inf, np.float32)
    light = np.zeros((count, 3))
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shapes[i], distances[i], hit, ray = _first_hit(geometry, _ray(o, d), True)
        if hit is not None and emitting[shapes[i]]:
            si = hit.compute_surface_interaction(ray)
            light[i] = si.shape.emitter().eval(si)
    return shapes, distances, light


def environment_radiance(emitter: Any, directions: AnyArray) -> AnyArray:
    """Return the radiance (N, 3) of an environment emitter along `directions` (N, 3)."""
    light = np.zeros((len(directions), 3))
    si = mi.SurfaceInteraction3f()
    for i, direction in enumerate(directions):
        si.wi = mi.ScalarVector3f(-direction)
        light[i] = emitter.eval(si)
    return light


def sample_emitters(
    emitters: tuple[Any, ...], indices: AnyArray, origin: AnyArray, samples: AnyArray
) -> tuple[AnyArray, ...]:
    """Return direction (N, 3), distance (N,), radiance over density (N, 3), density (N,)."""
    count = len(indices)
    directions, weight = np.zeros((count, 3)), np.zeros((count, 3))
    distances, density = np.zeros(count, np.float32), np.zeros(count)
    si = mi.SurfaceInteraction3f()
    origins = np.broadcast_to(origin, (count, 3))
    for i in range(count):
        si.p = mi.ScalarPoint3f(origins[i])
        ds, value = emitters[indices[i]].sample_direction(si, mi.ScalarPoint2f(samples[i]))
        directions[i], distances[i], weight[i] = ds.d, ds.dist, value
        density[i] = 0 if ds.delta else ds.pdf
    return directions, distances, weight, density


def _ray(origin: AnyArray, direction: AnyArray) -> Any:
    return mi.Ray3f(mi.ScalarPoint3f(origin), mi.ScalarVector3f(direction))


def _first_hit(geometry: SceneGeometry, ray: Any, through: bool) -> tuple[int, float, Any, Any]:
    """Return shape index, distance from the ray's origin, the hit, and the ray it belongs to."""
    numbers = _shape_numbers(geometry)
    travelled = 0.0
    for _ in range(MAX_LAYERS + 1):
        hit = _intersect(geometry, ray)
        if not hit.is_valid():
            break
        shape = numbers[hit.shape.ptr]
        if not (through and _passes(geometry, shape, hit, ray)):
            return shape, travelled + hit.t, hit, ray
        onward = _past(hit, ray)
        travelled += onward
        ray = mi.Ray3f(ray(onward), ray.d)
    return -1, float("inf"), None, ray


def _intersect(geometry: SceneGeometry, ray: Any) -> Any:
    """Return the first hit of a ray; on a mesh, face and place follow `triangles`.

    Where faces of several shapes lie in one plane, the last opaque one of them is hit.
    """
    hit = geometry.scene.ray_intersect_preliminary(ray)
    face = _first_face(geometry, ray, hit)
    if not face:
        return hit
    triangles, owners = _triangles(geometry), owners_of(_triangles(geometry))
    partners = _partners_met(geometry, ray, face, same_side=True)
    last = max(partners if partners and geometry.clear[owners[face]] else [face, *partners])
    owner = int(owners[last])
    hit.shape, hit.prim_index = geometry.shapes[owner], last - int(triangles.first[owner])
    hit.valid = True
    t, u, v = _meet(geometry, ray, last)
    if t is not None:
        hit.t, hit.prim_uv = t, mi.ScalarPoint2f(u, v)
    return hit


def _first_face(geometry: SceneGeometry, ray: Any, hit: Any) -> int:
    """Return the number of the face that a ray meets first; 0 for none, and for no mesh.

    Faces are those that Embree finds along `triangles.ASIDE`; that of `hit` if the ray meets none.
    """
    face, across = _face(geometry, hit), mi.Frame3f(ray.d)
    other = float(hit.t) if hit.is_valid() and not face else float("inf")  # of a sphere, say
    candidates = set()
    for x, y in ASIDE:
        aside = mi.Ray3f(ray.o, ray.d + across.s * x + across.t * y)
        candidates.add(_face(geometry, geometry.scene.ray_intersect_preliminary(aside)))
    met = []
    for candidate in candidates - {0}:
        origin, direction, *corners = _rows(geometry, ray, candidate)
        t, _, _, determinant = meet(origin, direction, *corners)
        if comes_near(origin, direction, corners, determinant) and 0 < t / determinant < other:
            met.append((t / determinant, -candidate))
    return -min(met)[1] if met else face


def _face(geometry: SceneGeometry, hit: Any) -> int:
    """Return the number of the face that is hit; 0 for nothing, and for what is no mesh."""
    if not hit.is_valid() or hit.shape is None:
        return 0
    first = int(_triangles(geometry).first[_shape_numbers(geometry)[hit.shape.ptr]])
    return first and first + int(hit.prim_index)


def _partners_met(geometry: SceneGeometry, ray: Any, face: int, same_side: bool) -> list[int]:
    """Return the partners of a face that a ray meets."""
    starts, partners = _partners(geometry, same_side)
    met = []
    for other in partners[starts[face] : starts[face + 1]].tolist():
        t, u, v = _meet(geometry, ray, other)
        if t is not None and t > 0 and u >= 0 and v >= 0 and u + v <= 1:
            met.append(other)
    return met


def _meet(geometry: SceneGeometry, ray: Any, face: int) -> tuple[Any, ...]:
    """Return t, u and v of a ray in a face's plane; None if it is parallel."""
    t, u, v, determinant = meet(*_rows(geometry, ray, face))
    if not determinant:
        return None, None, None
    return t / determinant, u / determinant, v / determinant


def _rows(geometry: SceneGeometry, ray: Any, face: int) -> list[list[float]]:
    """Return origin and direction of a ray and the corners of a face."""
    triangles = _triangles(geometry)
    corners = triangles.vertices[triangles.faces[face]].astype(np.float64).tolist()
    return [*([float(value) for value in vector] for vector in (ray.o, ray.d)), *corners]


def _past(hit: Any, ray: Any) -> float:
    """Return a distance a little past the surface: more than the hit point's rounding."""
    return float(hit.t + 1e-5 * (1 + max(abs(value) for value in ray(hit.t))))


def _passes(geometry: SceneGeometry, shape: int, hit: Any, ray: Any) -> bool:
    if geometry.clear[shape] or not geometry.masked[shape]:
        return bool(geometry.clear[shape])
    si = hit.compute_surface_interaction(ray)
    return float(np.mean(si.bsdf().eval_null_transmission(si))) > 0.5


def _triangles(geometry: SceneGeometry) -> Triangles:
    return geometry.cached("triangles", lambda: triangles_of(geometry.shapes))


def _partners(geometry: SceneGeometry, same_side: bool) -> tuple[AnyArray, AnyArray]:
    """Return `partners_of` all faces."""
    opaque = ~(geometry.clear | geometry.masked)
    clear = geometry.clear if same_side else None
    return geometry.cached(
        f"partners_{same_side}", lambda: partners_of(_triangles(geometry), opaque, same_side, clear)
    )


def _shape_numbers(geometry: SceneGeometry) -> dict[int, int]:
    """Return the shape index by instance pointer."""
    return geometry.cached(
        "numbers", lambda: {shape.ptr: index for index, shape in enumerate(geometry.shapes)}
    )
