"""Ray casting for the wavefront variants: one Dr.Jit kernel for all rays.

The same functions as `pbrnet.pipeline.render.raycast.scalar`; `pbrnet.pipeline.render.raycast`
documents them.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import (
    column,
    reflectance_table,
    registry_id,
    shape_table,
    to_numpy,
    vector,
)
from pbrnet.pipeline.render.raycast import meshes
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

Hit: TypeAlias = "mi.PreliminaryIntersection3f"
Values: TypeAlias = "dr.ArrayBase"
Partners: TypeAlias = "tuple[mi.UInt32, mi.UInt32]"  # `starts` and `partners`, see `_partners`
Tables = dict[str, Any]  # of shapes and faces, see `_make_tables`
_HIT_FIELDS = len(fields(Hits))
_MAX_RECORDINGS, _NEVER = 8, 1 << 30  # numbers of rays; Dr.Jit would warn of many


def nearest(
    geometry: SceneGeometry, through: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return shape index (N,) and distance (N,)."""
    return to_numpy(*_first_hit(geometry, _ray(origins, directions), through)[:2])


def nearest_from_cameras(geometry: SceneGeometry, poses: AnyArray, local: AnyArray) -> AnyArray:
    """Return shape indices (N * P,) for cameras (N, 4, 4) and camera-frame directions (P, 3)."""
    return to_numpy(_first_hit(geometry, _camera_rays(poses, local), True)[0])[0]


def surfaces(
    geometry: SceneGeometry,
    colors: bool,
    slots: tuple[TextureSlot, ...] | None,
    origins: AnyArray,
    directions: AnyArray,
) -> tuple[AnyArray, ...]:
    """Return the fields of `Hits`, in order; with slots their values, s, dp_du and dp_dv, too."""
    numbers = [column(mi.UInt32, _texture_numbers(slot)) for slot in slots or ()]
    twins = _tables(geometry)["twins"] if colors else None
    trace = _recorded(geometry, _surfaces) if colors else partial(_surfaces, geometry)
    found = to_numpy(*trace(twins, slots, numbers, _ray(origins, directions)))
    *others, colour = found[:_HIT_FIELDS]
    return *others, np.clip(colour, 0, 1), *found[_HIT_FIELDS:]


def _surfaces(
    geometry: SceneGeometry,
    twins: mi.BSDFPtr | None,
    slots: tuple[TextureSlot, ...] | None,
    numbers: list[mi.UInt32],
    ray: mi.Ray3f,
) -> list[Values]:
    """Return what `surfaces` does.

    `twins` are the reflectance twins, None without colours; `numbers` those of `_texture_numbers`.
    """
    shape, distance, hit, ray = _first_hit(geometry, ray, True)
    valid = shape >= 0
    si = meshes.interaction(_tables(geometry)["meshes"], hit, ray, valid)
    reflectance = mi.Color3f(0)
    if twins is not None:
        bsdf = dr.gather(mi.BSDFPtr, twins, dr.reinterpret_array(mi.UInt32, si.shape), valid)
        reflectance = mi.unpolarized_spectrum(bsdf.eval_diffuse_reflectance(si, valid))
    vectors = [si.p, si.n, si.sh_frame.n, mi.Color3f(reflectance)]
    values = []
    if slots is not None:
        places = zip(slots, numbers, strict=True)
        values = [_evaluated(slot, number, shape, si, valid) for slot, number in places]
        values += [dr.select(valid, vector, 0) for vector in (si.sh_frame.s, si.dp_du, si.dp_dv)]
    return [shape, distance, *(dr.select(valid, vector, 0) for vector in vectors), *values]


def _evaluated(
    slot: TextureSlot,
    numbers: mi.UInt32,
    shape: mi.Int32,
    si: mi.SurfaceInteraction3f,
    valid: mi.Bool,
) -> Values:
    """Return a slot's values. A switch over its textures alone, as in `_passes`."""
    number = dr.gather(mi.UInt32, numbers, mi.UInt32(dr.maximum(shape, 0)), valid)
    ways = [getattr(texture, slot.way) for texture in _distinct(slot)]
    has = valid & (number < len(ways))
    kind = {1: mi.Float, 2: mi.Vector2f, 3: mi.Color3f}[slot.bands]
    return dr.select(has, kind(dr.switch(number, ways, si, has)), kind(0))


def _texture_numbers(slot: TextureSlot) -> AnyArray:
    """Return the number of each shape's texture among the distinct ones; their count for none."""
    places = {id(texture): place for place, texture in enumerate(_distinct(slot))}
    return np.array([places.get(id(texture), len(places)) for texture in slot.textures])


def _distinct(slot: TextureSlot) -> list[mi.Texture]:
    return list({id(texture): texture for texture in slot.textures if texture is not None}.values())


def oriented(
    geometry: SceneGeometry, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return the fields of `Hits`, the geometric normal twice.

    Where all shapes are meshes, no shape is called, which costs most in a scene of many.
    """
    if not all(shape.is_mesh() for shape in geometry.shapes):
        found = surfaces(geometry, False, None, origins, directions)
        return *found[:4], found[3], found[5]
    tables = _tables(geometry)
    shape, distance, hit, ray = _first_hit(geometry, _ray(origins, directions), True)
    face, valid = _face(tables, hit)
    corner = dr.gather(mi.Vector3u, tables["faces"], face, valid)
    a, b, c = (dr.gather(mi.Point3f, tables["vertices"], number, valid) for number in corner)
    normal = dr.normalize(dr.cross(b - a, c - a))
    vectors = (dr.select(valid, vector, 0) for vector in (ray(hit.t), normal))
    shape, distance, position, normal = to_numpy(shape, distance, *vectors)
    return shape, distance, position, normal, normal, np.zeros_like(normal)


class _Recorded:
    """A function of a geometry whose launches are recorded once, then replayed for other rays.

    Python and Dr.Jit need up to 0.2 s to trace a function through all materials, several times what
    the rays of an image need.
    """

    def __init__(self, geometry: SceneGeometry, function: Callable[..., list[Values]]) -> None:
        itself = weakref.ref(geometry)

        def trace(
            scene: mi.Scene, arrays: dict[str, Any], arguments: tuple[Any, ...]
        ) -> list[Values]:
            known = itself()
            assert known is not None
            return function(known, *arguments)

        self._launch = dr.freeze(trace, limit=_MAX_RECORDINGS, warn_after=_NEVER)
        self._geometry, self._function = itself, function

    def __call__(self, *arguments: Any) -> list[Values]:
        geometry = self._geometry()
        assert geometry is not None
        arrays = {name: table for name, table in _tables(geometry).items() if name != "masks"}
        return list(self._launch(geometry.scene, arrays, arguments))


def _recorded(geometry: SceneGeometry, function: Callable[..., list[Values]]) -> _Recorded:
    """Return the recorded form of a function; cached on the geometry."""
    key = f"recorded {function.__name__}"
    return geometry.cached(key, lambda: _Recorded(geometry, function))


def objects_along(
    geometry: SceneGeometry, numbers: AnyArray, words: int, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return a bit for each object that a ray meets, (N, words)."""
    tables = _tables(geometry)
    any_mask = bool(geometry.masked.any())
    ray = _ray(origins, directions)
    width = dr.opaque(mi.UInt32, words)
    found = dr.zeros(mi.UInt32, len(directions) * words)
    table = column(mi.UInt32, np.append(numbers, -1).astype(np.int64) & 0xFFFFFFFF)
    pixel = dr.arange(mi.UInt32, len(directions))

    def note_shape(number: mi.UInt32, active: mi.Bool) -> None:
        shape = dr.gather(mi.Int32, tables["shape"], number, active)
        known = active & (shape >= 0)
        thing = dr.gather(mi.UInt32, table, mi.UInt32(dr.maximum(shape, 0)), known)
        known &= thing != 0xFFFFFFFF
        bit = mi.UInt32(1) << (thing & 31)
        dr.scatter_reduce(dr.ReduceOp.Or, found, bit, pixel * width + (thing >> 5), known)

    touching: Any = _touching_objects(geometry, numbers)

    def note_partner(
        place: mi.UInt32, end: mi.UInt32, ray: mi.Ray3f
    ) -> tuple[mi.UInt32, mi.UInt32, mi.Ray3f]:
        other, met = _meets_partner(tables, touching, ray, place)
        note_shape(dr.gather(mi.UInt32, tables["owner"], other), met)
        return place + 1, end, ray

    def note(hit: Hit, ray: mi.Ray3f, active: mi.Bool) -> None:
        met = active & ~_passes(tables, hit, ray, any_mask)
        note_shape(dr.reinterpret_array(mi.UInt32, hit.shape), met)
        if touching is not None:
            face, on_mesh = _face(tables, hit)
            dr.while_loop(
                state=(*_places(touching, face, met & on_mesh), ray),
                cond=lambda place, end, ray: place < end,
                body=note_partner,
                labels=("place", "end", "ray"),
            )

    def step(
        active: mi.Bool, hit: Hit, ray: mi.Ray3f, layer: mi.UInt32
    ) -> tuple[mi.Bool, Hit, mi.Ray3f, mi.UInt32]:
        note(hit, ray, active)
        onward = _onward(ray, hit)
        hit = _intersect(geometry, tables, onward)
        return active & hit.is_valid() & (layer < MAX_SURFACES), hit, onward, layer + 1

    hit = _intersect(geometry, tables, ray)
    dr.while_loop(
        state=(hit.is_valid(), hit, ray, mi.UInt32(0)),
        cond=lambda active, hit, ray, layer: active,
        body=step,
        labels=("active", "hit", "ray", "layer"),
    )
    return (found.numpy().reshape(len(directions), words),)


def emitted_radiance(
    geometry: SceneGeometry, emitting: AnyArray, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    """Return shape index (N,), distance (N,) and emitted radiance (N, 3)."""
    shape, distance, hit, ray = _first_hit(geometry, _ray(origins, directions), True)
    if not emitting.any():
        return (*to_numpy(shape, distance), np.zeros((len(directions), 3)))
    lamps = np.flatnonzero(emitting)
    numbers = np.full(len(emitting), len(lamps), dtype=np.int64)
    numbers[lamps] = np.arange(len(lamps))
    lamp = dr.gather(
        mi.UInt32, column(mi.UInt32, numbers), mi.UInt32(dr.maximum(shape, 0)), shape >= 0
    )
    lit = (shape >= 0) & (lamp < len(lamps))
    # A switch over the lamps alone, as in `_passes`.
    emissions = [partial(_emission, geometry.shapes[index]) for index in lamps]
    light = dr.select(lit, dr.switch(lamp, emissions, ray, hit, lit), mi.Color3f(0))
    return to_numpy(shape, distance, light)


def environment_radiance(emitter: mi.Emitter, directions: AnyArray) -> AnyArray:
    """Return the radiance (N, 3) of an environment emitter along `directions` (N, 3)."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = vector(mi.Vector3f, -directions)
    # One row where the radiance is constant.
    return np.broadcast_to(to_numpy(mi.Color3f(emitter.eval(si)))[0], directions.shape)


def sample_emitters(
    emitters: tuple[mi.Emitter, ...], indices: AnyArray, origin: AnyArray, samples: AnyArray
) -> tuple[AnyArray, ...]:
    """Return direction (N, 3), distance (N,), radiance over density (N, 3), density (N,)."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(indices))
    if origin.ndim == 2:
        si.p = vector(mi.Point3f, origin)
    else:  # Opaque, or the position would be compiled into the kernel, one kernel per view.
        si.p = mi.Point3f(*(dr.opaque(mi.Float, float(value)) for value in origin))
    # A switch over these alone: sun and sky are apart here, and not met by virtual calls.
    calls = [partial(_sampled, emitter) for emitter in emitters]
    ds, weight = dr.switch(column(mi.UInt32, indices), calls, si, vector(mi.Point2f, samples))
    direction, distance, weights, density = to_numpy(
        ds.d, ds.dist, mi.Color3f(weight), dr.select(ds.delta, 0, ds.pdf)
    )
    return direction.astype(np.float64), distance, weights, density.astype(np.float64)


def _sampled(
    emitter: mi.Emitter, si: mi.SurfaceInteraction3f, sample: mi.Point2f
) -> tuple[mi.DirectionSample3f, mi.Color3f]:
    ds, weight = emitter.sample_direction(si, sample)
    return ds, mi.Color3f(weight)


def _ray(origins: AnyArray, directions: AnyArray) -> mi.Ray3f:
    return mi.Ray3f(vector(mi.Point3f, origins), vector(mi.Vector3f, directions))


def _camera_rays(poses: AnyArray, local: AnyArray) -> mi.Ray3f:
    """Return rays of every pose (N, 4, 4) along every local direction (P, 3), pose by pose."""
    count = len(local)
    index = dr.arange(mi.UInt32, len(poses) * count)
    pose, pixel = index // dr.opaque(mi.UInt32, count), index % dr.opaque(mi.UInt32, count)
    table = column(mi.Float, poses[:, :3, :].ravel())
    columns = [column(mi.Float, local[:, axis]) for axis in range(3)]
    row = [[dr.gather(mi.Float, table, pose * 12 + 4 * i + j) for j in range(4)] for i in range(3)]
    x, y, z = (dr.gather(mi.Float, column, pixel) for column in columns)
    return mi.Ray3f(
        mi.Point3f(row[0][3], row[1][3], row[2][3]),
        mi.Vector3f(*(row[i][0] * x + row[i][1] * y + row[i][2] * z for i in range(3))),
    )


def _first_hit(
    geometry: SceneGeometry, ray: mi.Ray3f, through: bool
) -> tuple[mi.Int32, mi.Float, Hit, mi.Ray3f]:
    """Return shape index, distance from the ray's origin, the hit, and the ray it belongs to.

    Behind each clear surface the ray continues from a slightly later start on the same line.
    """
    tables = _tables(geometry)
    any_mask, any_clear = bool(geometry.masked.any()), bool(geometry.clear.any())
    hit = _intersect(geometry, tables, ray)
    start = mi.Point3f(ray.o)
    if through and (any_mask or any_clear):
        passing = _passes(tables, hit, ray, any_mask)
        layer = mi.UInt32(0)
        passing, hit, ray, layer = dr.while_loop(
            state=(passing, hit, ray, layer),
            cond=lambda passing, hit, ray, layer: passing & (layer < MAX_LAYERS),
            body=lambda passing, hit, ray, layer: _step(
                geometry, tables, any_mask, hit, ray, layer
            ),
            labels=("passing", "hit", "ray", "layer"),
        )
        hit.valid &= ~passing
    valid = hit.is_valid()
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    shape = dr.select(valid, dr.gather(mi.Int32, tables["shape"], number, valid), -1)
    distance = dr.select(valid, hit.t + dr.dot(ray.o - start, ray.d), dr.inf)
    return shape, distance, hit, ray


def _step(
    geometry: SceneGeometry,
    tables: Tables,
    any_mask: bool,
    hit: Hit,
    ray: mi.Ray3f,
    layer: mi.UInt32,
) -> tuple[mi.Bool, Hit, mi.Ray3f, mi.UInt32]:
    ray = _onward(ray, hit)
    hit = _intersect(geometry, tables, ray)
    return _passes(tables, hit, ray, any_mask), hit, ray, layer + 1


def _intersect(geometry: SceneGeometry, tables: Tables, ray: mi.Ray3f) -> Hit:
    """Return the first hit of each ray; on a mesh, face and place follow `triangles`.

    Where faces of several shapes lie in one plane, the last opaque one of them is hit.
    """
    hit, face = _first_hit_face(geometry, tables, ray)
    ties = tables["ties"]
    if ties is not None:
        owner = dr.gather(mi.UInt32, tables["owner"], face, face > 0)
        clear = dr.gather(mi.UInt32, tables["clear"], owner, face > 0) == 1
        _, _, last = dr.while_loop(
            state=(*_places(ties, face, face > 0), dr.select(clear, 0, face)),
            cond=lambda place, end, last: place < end,
            body=lambda place, end, last: (place + 1, end, _last(tables, ray, place, last)),
            labels=("place", "end", "last"),
        )
        face = dr.select(last > 0, last, face)
    on_mesh = face > 0
    owner = dr.gather(mi.UInt32, tables["owner"], face, on_mesh)
    hit.shape = dr.select(on_mesh, dr.reinterpret_array(mi.ShapePtr, owner), hit.shape)
    first = dr.gather(mi.UInt32, tables["first"], owner, on_mesh)
    hit.prim_index = dr.select(on_mesh, face - first, hit.prim_index)
    exact, t, u, v = _meet(tables, ray, face, on_mesh)
    hit.t = dr.select(exact, mi.Float(t), hit.t)
    hit.prim_uv = dr.select(exact, mi.Point2f(mi.Float(u), mi.Float(v)), hit.prim_uv)
    hit.valid |= on_mesh
    return hit


def _first_hit_face(
    geometry: SceneGeometry, tables: Tables, ray: mi.Ray3f
) -> tuple[Hit, mi.UInt32]:
    """Return a hit to be filled in, and the number of the face that each ray meets first.

    Faces are those that Embree finds along `triangles.ASIDE`. Where the ray meets none of them, or
    they lead to what is no mesh, Embree's hit along the ray itself counts; face 0 is none.
    """
    across, count = mi.Frame3f(ray.d), dr.width(ray.d)
    zero = dr.zeros(mi.UInt32, count)

    def look(
        number: mi.UInt32, one: mi.UInt32, two: mi.UInt32, three: mi.UInt32, other: mi.Bool
    ) -> tuple[Values, ...]:
        x, y = _of(number, *(mi.Float(x) for x, _ in ASIDE)), _of(number, *(y for _, y in ASIDE))
        aside = mi.Ray3f(ray)
        aside.d = ray.d + across.s * x + across.t * y
        hit = geometry.scene.ray_intersect_preliminary(aside, coherent=True)
        face, on_mesh = _face(tables, hit)
        face = dr.select(on_mesh, face, 0)
        return number + 1, two, three, face, other | (hit.is_valid() & ~on_mesh)

    _, one, two, three, other = dr.while_loop(
        state=(zero, zero, zero, zero, dr.full(mi.Bool, False, count)),
        cond=lambda number, one, two, three, other: number < len(ASIDE),
        body=look,
        labels=("number", "one", "two", "three", "other"),
    )
    # Three rays about this one on the same face: it meets that, too, because faces are convex.
    apart = (one != two) | (two != three)

    def compare(number: mi.UInt32, face: mi.UInt32, t: Values) -> tuple[Values, ...]:
        candidate = _of(number, one, two, three)
        met, distance = _reaches(tables, ray, candidate, candidate > 0)
        nearer = met & ((distance < t) | ((distance == t) & (candidate > face)))
        return number + 1, dr.select(nearer, candidate, face), dr.select(nearer, distance, t)

    _, face, t = dr.while_loop(
        state=(
            zero,
            dr.select(apart, 0, one),
            dr.full(dr.float64_array_t(mi.Float), dr.inf, count),
        ),
        cond=lambda number, face, t: apart & (number < len(ASIDE)),
        body=compare,
        labels=("number", "face", "t"),
    )
    hit = geometry.scene.ray_intersect_preliminary(ray, coherent=True, active=other | (face == 0))
    own, on_mesh = _face(tables, hit)
    face = dr.select(on_mesh & (face == 0), own, face)
    return hit, dr.select(hit.is_valid() & ~on_mesh & (hit.t < t), 0, face)


def _of(number: mi.UInt32, first: Values, second: Values, third: Values) -> Values:
    """Return the value of that number, 0 to 2."""
    return dr.select(number == 0, first, dr.select(number == 1, second, third))


def _reaches(
    tables: Tables, ray: mi.Ray3f, face: mi.UInt32, active: mi.Bool
) -> tuple[mi.Bool, Values]:
    """Return whether each ray meets a face or passes close to its edge, and the distance."""
    rows = _rows(tables, ray, face, active)
    t, _, _, determinant = meet(*rows)
    t /= determinant
    return active & (t > 0) & comes_near(rows[0], rows[1], rows[2:], determinant), t


def _face(tables: Tables, hit: Hit) -> tuple[mi.UInt32, mi.Bool]:
    """Return the number of the face that is hit, and whether it is one of a mesh."""
    valid = hit.is_valid()
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    first = dr.gather(mi.UInt32, tables["first"], number, valid)
    return first + hit.prim_index, valid & (first > 0)


def _places(partners: Partners, face: mi.UInt32, active: mi.Bool) -> tuple[mi.UInt32, mi.UInt32]:
    """Return the first place of a face's partners, and the one behind the last."""
    starts = (dr.gather(mi.UInt32, partners[0], face + step, active) for step in (0, 1))
    return tuple(starts)  # type: ignore[return-value]


def _last(tables: Tables, ray: mi.Ray3f, place: mi.UInt32, face: mi.UInt32) -> mi.UInt32:
    """Return the later one of a face and the partner at `place`, if the ray meets that."""
    other, met = _meets_partner(tables, tables["ties"], ray, place)
    return dr.select(met, dr.maximum(face, other), face)


def _meets_partner(
    tables: Tables, partners: Partners, ray: mi.Ray3f, place: mi.UInt32
) -> tuple[mi.UInt32, mi.Bool]:
    """Return the partner at `place`, and whether the ray meets it."""
    other = dr.gather(mi.UInt32, partners[1], place)
    exact, t, u, v = _meet(tables, ray, other, dr.full(mi.Bool, True))
    return other, exact & (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)


def _meet(tables: Tables, ray: mi.Ray3f, face: mi.UInt32, active: mi.Bool) -> tuple[Values, ...]:
    """Return whether a ray crosses a face's plane, and t, u and v there in double precision."""
    t, u, v, determinant = meet(*_rows(tables, ray, face, active))
    return active & (determinant != 0), t / determinant, u / determinant, v / determinant


def _rows(tables: Tables, ray: mi.Ray3f, face: mi.UInt32, active: mi.Bool) -> list[list[Values]]:
    """Return origin and direction of a ray and the corners of a face, in double precision."""
    corner = dr.gather(mi.Vector3u, tables["faces"], face, active)
    points = [dr.gather(mi.Point3f, tables["vertices"], number, active) for number in corner]
    double = dr.float64_array_t(mi.Float)
    return [[double(value) for value in vector] for vector in (ray.o, ray.d, *points)]


def _onward(ray: mi.Ray3f, hit: Hit) -> mi.Ray3f:
    """Return the ray from a little past the surface: more than the hit point's rounding."""
    past = hit.t + 1e-5 * (1 + dr.max(dr.abs(ray(hit.t))))
    onward = mi.Ray3f(ray)
    onward.o = ray(past)
    return onward


def _passes(tables: Tables, hit: Hit, ray: mi.Ray3f, any_mask: bool) -> mi.Bool:
    valid = hit.is_valid()
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    passes = dr.gather(mi.UInt32, tables["clear"], number, valid) == 1
    if any_mask:
        masked = dr.gather(mi.UInt32, tables["masked"], number, valid) == 1
        # A switch over the masked shapes alone: a virtual call would trace every shape there is.
        mask = dr.gather(mi.UInt32, tables["mask"], number, masked)
        passes |= masked & (dr.switch(mask, tables["masks"], ray, hit, masked) > 0.5)
    return passes & valid


def _emission(shape: mi.Shape, ray: mi.Ray3f, hit: Hit, active: mi.Bool) -> mi.Color3f:
    """Return the radiance that a shape emits at a hit, back along the ray."""
    si = shape.compute_surface_interaction(ray, hit, mi.RayFlags.All, active)
    si.wi = mi.Vector3f(0, 0, -dr.dot(si.sh_frame.n, ray.d))  # area emitters read its sign alone
    return mi.Color3f(shape.emitter().eval(si, active))


def _tables(geometry: SceneGeometry) -> Tables:
    """Return shape properties by registry id; cached on the geometry."""
    return geometry.cached("tables", lambda: _make_tables(geometry))


def _make_tables(geometry: SceneGeometry) -> Tables:
    shapes, triangles = geometry.shapes, triangles_of(geometry.shapes)
    ids = np.array([registry_id(shape, mi.ShapePtr) for shape in shapes], dtype=np.int64)
    return {
        "vertices": mi.Float(triangles.vertices.ravel()),
        "faces": mi.UInt32(triangles.faces.ravel()),
        "owner": mi.UInt32(ids[owners_of(triangles)]),
        "ties": _partners(geometry, triangles),
        "first": shape_table(shapes, triangles.first),
        "shape": shape_table(shapes, range(len(shapes)), -1, mi.Int32),
        "clear": shape_table(shapes, geometry.clear),
        "masked": shape_table(shapes, geometry.masked),
        **_mask_tables(geometry),
        "twins": reflectance_table(geometry),
        "meshes": meshes.triangles_of(geometry.scene),
    }


def _touching_objects(geometry: SceneGeometry, numbers: AnyArray) -> Partners | None:
    """Return the faces of other objects that touch each face; None if none does in any view.

    As `_partners`, on either side. `numbers` are the objects of `objects_along`: faces without
    one, or of the same one, would tell nothing and are left out.
    """
    touching = geometry.cached("touching", lambda: _find_touching(geometry))
    if not len(touching.partner):
        return None
    one, other = numbers[touching.shape], numbers[touching.partner_shape]
    kept = (other >= 0) & (one != other)
    starts = np.searchsorted(touching.face[kept], np.arange(touching.faces + 1))
    partners = touching.partner[kept]
    return mi.UInt32(starts), mi.UInt32(partners if len(partners) else [0])


@dataclass(frozen=True)
class _Touching:
    """Pairs of touching faces: the numbers of `face`, in order, and `partner`, and their shapes."""

    faces: int  # of the scene
    face: AnyArray
    partner: AnyArray
    shape: AnyArray
    partner_shape: AnyArray


def _find_touching(geometry: SceneGeometry) -> _Touching:
    """Return the pairs of faces that overlap in a plane, on either side."""
    triangles = triangles_of(geometry.shapes)
    opaque = ~(geometry.clear | geometry.masked)
    starts, partner = partners_of(triangles, opaque, same_side=False)
    face = np.repeat(np.arange(len(triangles.faces)), np.diff(starts))
    owner = owners_of(triangles)
    return _Touching(len(triangles.faces), face, partner, owner[face], owner[partner])


def _partners(geometry: SceneGeometry, triangles: Triangles) -> Partners | None:
    """Return `starts` and `partners` of faces that are hit in one another's place, None without.

    The partners of face f are `partners[starts[f] : starts[f + 1]]`.
    """
    opaque = ~(geometry.clear | geometry.masked)
    starts, partners = partners_of(triangles, opaque, True, geometry.clear)
    return (mi.UInt32(starts), mi.UInt32(partners)) if len(partners) else None


def _mask_tables(geometry: SceneGeometry) -> Tables:
    """Return `mask`, the number of each masked shape, and `masks`, their null transmissions."""
    shapes = [shape for shape, has in zip(geometry.shapes, geometry.masked, strict=True) if has]
    return {
        "mask": shape_table(shapes, range(len(shapes))),
        "masks": [partial(_null_transmission, shape) for shape in shapes],
    }


def _null_transmission(shape: mi.Shape, ray: mi.Ray3f, hit: Hit, active: mi.Bool) -> mi.Float:
    """Return the share of light that passes a shape's material undeviated at a hit."""
    si = shape.compute_surface_interaction(ray, hit, mi.RayFlags.All, active)
    own = shape.bsdf()  # None for an instance: its shape group holds the BSDF
    share = (si.bsdf() if own is None else own).eval_null_transmission(si, active)
    return dr.mean(mi.unpolarized_spectrum(share))
