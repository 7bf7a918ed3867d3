"""Cloth by position-based dynamics (Müller et al. 2007): sheets that fall on bodies or hang.

A sheet is a grid of points, float64 (3, n, m), metres. Only sums, products, quotients and square
roots move it, each a rounded operation of IEEE 754, and none is a reduction, whose order may
differ: equal arguments give equal bits on every processor. Sines that shape a sheet at the start
are rounded by `started`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, grid, merge, rims
from pbrnet.scenes.seeds import generator

Push = Callable[[Float64Array], BoolArray]  # moves points out of a body; True where it did
_GRAVITY = 0.0006  # metres a step squared
_DAMPING = 0.93
_FASTEST = 0.03  # metres a step
_REFRESH = 3  # steps for which the nearest samples of a surface are kept
_NEAR = 0.01  # metres between the places of a long edge at which faces are looked for
_LONG = 0.008  # metres
_FACES = 12  # nearest faces of a mesh that are tested there
_SPACING = 0.012  # metres between the samples of a surface
_AT_EDGES = 3  # nearest samples that are asked for
_ROUNDED = 6  # decimals, of starts and results


@dataclass(frozen=True)
class Weave:
    """Resistance of a sheet: shares of a spring's error that one iteration removes."""

    stretch: float = 1.0
    shear: float = 0.25
    bend: float = 0.08  # over two points; a duvet is stiffer than a towel
    fold: float = 0.0  # over four points


LINEN = Weave(1.0, 0.2, 0.03)


def started(points: Sequence[Float64Array]) -> Float64Array:
    """Return the coordinates x, y, z (n, m) as a sheet (3, n, m), rounded."""
    return np.round(np.stack(np.broadcast_arrays(*points)), _ROUNDED)


def block(low: Sequence[float], high: Sequence[float], radius: float, gap: float) -> Push:
    """A box with edges rounded by `radius`, kept `gap` metres away from."""
    low_, high_ = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    radius = min(radius, 0.49 * float((high_ - low_).min()))
    middle = (0.5 * (low_ + high_)).reshape(3, 1, 1)
    core = (0.5 * (high_ - low_) - radius).reshape(3, 1, 1)
    reach = radius + gap

    def push(place: Float64Array) -> BoolArray:
        offset = place - middle
        near = np.clip(offset, -core, core)
        away = offset - near
        squared = away[0] * away[0] + away[1] * away[1] + away[2] * away[2]
        hit = squared < reach * reach
        if not hit.any():
            return hit
        inside = hit & (squared <= 0)
        if inside.any():
            depth = core - np.abs(offset)
            least = np.minimum(np.minimum(depth[0], depth[1]), depth[2])
            for axis in range(3):
                out = inside & (depth[axis] <= least)
                away[axis][out] = np.where(offset[axis] < 0, -1.0, 1.0)[out]
                near[axis][out] = (np.where(offset[axis] < 0, -1.0, 1.0) * core[axis])[out]
                inside &= ~out
            squared = away[0] * away[0] + away[1] * away[1] + away[2] * away[2]
        scale = reach / np.sqrt(np.maximum(squared, 1e-18))
        np.copyto(place, middle + near + scale * away, where=hit)
        return hit

    return push


def surface(triangles: Float64Array | Samples, gap: float) -> Push:
    """Triangles (N, 3, 3), kept `gap` metres away from on their front sides.

    They are sampled: a point is moved off the plane of the nearest sample.
    """
    samples = triangles if isinstance(triangles, Samples) else Samples(triangles)
    reach = gap + 2.5 * _SPACING
    calls = 0
    near = which = np.zeros(0, dtype=np.int64)

    def push(place: Float64Array) -> BoolArray:
        nonlocal calls, near, which
        points = place.reshape(3, -1).T
        if calls % _REFRESH == 0:
            near, which = samples.nearest(points, reach)
        calls += 1
        depth, normal = samples.depth(points[near], which)
        inside = depth < gap
        hit = np.zeros(len(points), dtype=bool)
        hit[near[inside]] = True
        points = points.copy()
        points[near[inside]] += (gap - depth[inside])[:, None] * normal[inside]
        place[:] = points.T.reshape(place.shape)
        return hit.reshape(place.shape[1:])

    return push


def cleared(mesh: BodyMesh, triangles: Float64Array | Samples, depth: float) -> BodyMesh | None:
    """Return a mesh whose vertices and edges that triangles (N, 3, 3) pierce are moved out of them.

    None if some stay `depth` metres or more behind triangles that are near.
    """
    samples = triangles if isinstance(triangles, Samples) else Samples(triangles)
    places, label = np.unique(np.round(mesh.vertices, 7), axis=0, return_inverse=True)
    label = label.reshape(-1)
    corners = label[mesh.faces]
    pairs = np.sort(np.concatenate([corners[:, :2], corners[:, 1:]]), axis=1)
    keys = np.unique(pairs @ np.array([len(places), 1]))
    edges = np.stack(np.divmod(keys, len(places)), axis=1)
    for last in (False, False, False, True):
        move, count = np.zeros_like(places), np.zeros(len(places))
        for ends in (np.arange(len(places))[:, None], edges):
            points = places[ends].sum(axis=1) / ends.shape[1]
            near, which = samples.nearest(points, 3 * _SPACING)
            signed, normal = samples.depth(points[near], which)
            behind = signed < (-depth if last else 0.0005)
            if last and behind.any():
                return None
            push = (0.002 - signed[behind])[:, None] * normal[behind]
            for end in ends[near[behind]].T:
                np.add.at(move, end, push)
                np.add.at(count, end, 1.0)
        places = places + move / np.maximum(count, 1)[:, None]
    return replace(mesh, vertices=places[label])


def pierces(triangles: Float64Array, mesh: BodyMesh) -> bool:
    """Test whether long edges of triangles (N, 3, 3) pass through a mesh, 2 mm from their ends.

    The corners of rails and boards; fine meshes have no edge of `_LONG`, and are passed over.
    """
    corners = mesh.vertices[mesh.faces]
    middles = corners.sum(axis=1) / 3
    low, high = middles.min(axis=0) - 3 * _NEAR, middles.max(axis=0) + 3 * _NEAR
    starts, ends = triangles.reshape(-1, 3), np.roll(triangles, -1, axis=1).reshape(-1, 3)
    close = ((np.minimum(starts, ends) < high) & (np.maximum(starts, ends) > low)).all(axis=1)
    starts, edges = starts[close], ends[close] - starts[close]
    length = np.sqrt(edges[:, 0] ** 2 + edges[:, 1] ** 2 + edges[:, 2] ** 2)
    starts, edges, length = starts[length > _LONG], edges[length > _LONG], length[length > _LONG]
    if len(length) == 0:
        return False
    tree = cKDTree(middles)
    count = np.ceil(length / _NEAR).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    places = starts[owner] + ((step + 0.5) / count[owner])[:, None] * edges[owner]
    found, which = tree.query(places, k=_FACES, distance_upper_bound=2 * _NEAR)
    close = np.isfinite(found)
    face, edge = which[close], np.broadcast_to(owner[:, None], which.shape)[close]
    # Möller and Trumbore 1997
    start, along = starts[edge], edges[edge]
    a = corners[face, 0]
    ab, ac = corners[face, 1] - a, corners[face, 2] - a
    normal, offset = np.cross(ab, ac), start - a
    volume = -(normal * along).sum(axis=1)
    scale = 1 / np.where(np.abs(volume) < 1e-14, np.inf, volume)
    turned = np.cross(offset, along)
    u, v = (ac * turned).sum(axis=1) * scale, -(ab * turned).sum(axis=1) * scale
    t = (normal * offset).sum(axis=1) * scale
    margin = 0.002 / length[edge]
    crossed = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > margin) & (t < 1 - margin)
    return bool((crossed & (scale != 0)).any())


class Samples:
    """Points on triangles with their normals; those at an edge occur once for each face there."""

    def __init__(self, triangles: Float64Array) -> None:
        self.points, self.normals = _samples(triangles, _SPACING)
        self.tree = cKDTree(self.points)

    def nearest(self, points: Float64Array, reach: float) -> tuple[Int64Array, Int64Array]:
        """Points (M,) within reach, and their nearest samples (M, k), one repeated if there are
        not as many at the same place."""
        found, which = self.tree.query(points, k=_AT_EDGES, distance_upper_bound=reach)
        near = np.flatnonzero(np.isfinite(found[:, 0]))
        found, which = found[near], which[near]
        return near, np.where(found <= found[:, :1] + 1e-6, which, which[:, :1])

    def depth(self, points: Float64Array, which: Int64Array) -> tuple[Float64Array, Float64Array]:
        """Signed distance (M,) in front of the faces of the samples, and the normal it is along.

        Edges are taken as convex: in front of one face is outside.
        """
        best = np.full(len(points), -np.inf)
        along = np.zeros((len(points), 3))
        for k in range(which.shape[1]):
            normal = self.normals[which[:, k]]
            offset = points - self.points[which[:, k]]
            depth = offset[:, 0] * normal[:, 0] + offset[:, 1] * normal[:, 1]
            depth = depth + offset[:, 2] * normal[:, 2]
            better = depth > best
            best = np.where(better, depth, best)
            along = np.where(better[:, None], normal, along)
        return best, along


def sampled(triangles: Float64Array) -> Float64Array:
    """Points (S, 3) on triangles (N, 3, 3), 12 mm apart at most."""
    return _samples(triangles, _SPACING)[0]


def _samples(triangles: Float64Array, spacing: float) -> tuple[Float64Array, Float64Array]:
    """Points (S, 3) on triangles, about `spacing` apart, and their unit normals (S, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    cross = np.cross(b - a, c - a)
    long = np.sqrt(cross[:, 0] ** 2 + cross[:, 1] ** 2 + cross[:, 2] ** 2)
    triangles, cross, long = triangles[long > 1e-9], cross[long > 1e-9], long[long > 1e-9]
    edges = np.roll(triangles, -1, axis=1) - triangles
    side = np.sqrt((edges[..., 0] ** 2 + edges[..., 1] ** 2 + edges[..., 2] ** 2).max(axis=1))
    steps = np.maximum(1, np.ceil(side / spacing)).astype(np.int64)
    points, facing = [], []
    for count in np.unique(steps).tolist():
        own = steps == count
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        keep = i + j <= count
        u, v = (i[keep] / count)[None, :, None], (j[keep] / count)[None, :, None]
        start = triangles[own][:, None]
        first, second = start[:, :, 1] - start[:, :, 0], start[:, :, 2] - start[:, :, 0]
        points.append((start[:, :, 0] + u * first + v * second).reshape(-1, 3))
        normal = cross[own] / long[own][:, None]
        facing.append(np.repeat(normal, int(keep.sum()), axis=0))
    return np.round(np.concatenate(points), _ROUNDED), np.concatenate(facing)


def rod(y: float, z: float, radius: float) -> Push:
    """A round bar along x; `radius` includes the gap."""

    def push(place: Float64Array) -> BoolArray:
        dy, dz = place[1] - y, place[2] - z
        long = np.sqrt(dy * dy + dz * dz)
        hit = long < radius
        scale = radius / np.maximum(long, 1e-9)
        place[1] = np.where(hit, y + dy * scale, place[1])
        place[2] = np.where(hit, z + dz * scale, place[2])
        return hit

    return push


def plane(axis: int, at: float, side: float = 1.0) -> Push:
    """The half-space where side * (coordinate - at) < 0."""

    def push(place: Float64Array) -> BoolArray:
        hit = side * (place[axis] - at) < 0
        place[axis] = np.where(hit, at, place[axis])
        return hit

    return push


@dataclass(frozen=True)
class _Springs:
    """Springs of one rest length from each point of a grid to that `offset` places later in it.

    `first` and `second` are the shares of the error that each end takes, (n * m,); 0 where there is
    no spring.
    """

    offset: int
    rest: float
    first: Float64Array
    second: Float64Array


class _Relaxer:
    """Relaxes springs of a sheet (3, ..., n, m) in place.

    Places are in one row, x before y before z: NumPy runs over it several times as fast as over
    slices of a grid. What is worked out where there is no spring is multiplied by 0.
    """

    def __init__(self, place: Float64Array, springs: Sequence[_Springs]) -> None:
        row = place.reshape(-1)
        assert np.shares_memory(row, place)
        apart, part = np.zeros((2, row.size))
        long = np.empty(row.size // 3)

        def shares(of: Float64Array, size: int) -> Float64Array:
            return np.tile(of, row.size // of.size)[:size]

        self._groups: list[tuple[float, tuple[Float64Array, ...]]] = []
        for spring in springs:
            size, count = row.size - spring.offset, long.size - spring.offset
            first = second = shares(spring.first, size)
            if spring.second is not spring.first:
                second = shares(spring.second, size)
            ends = row[:size], row[spring.offset :], first, second
            rows = apart[:size], part[:size], long[:count]
            ways, squares = (each.reshape(3, -1)[:, :count] for each in (apart, part))
            self._groups.append((spring.rest, (*ends, *rows, ways, squares)))

    def relax(self) -> None:
        """Relax each group of springs once."""
        for rest, views in self._groups:
            one, two, first, second, apart, part, scale, ways, squares = views
            np.subtract(two, one, out=apart)
            np.multiply(apart, apart, out=part)
            np.add(squares[0], squares[1], out=scale)
            np.add(scale, squares[2], out=scale)
            np.sqrt(scale, out=scale)
            np.maximum(scale, 1e-9, out=scale)
            np.divide(rest, scale, out=scale)
            np.subtract(1, scale, out=scale)
            np.multiply(ways, scale, out=ways)
            np.multiply(first, apart, out=part)
            np.add(one, part, out=one)
            if second is not first:
                np.multiply(second, apart, out=part)
            np.subtract(two, part, out=two)


def _springs(
    shape: tuple[int, int],
    rest: tuple[float, float],
    weave: Weave,
    mass: Float64Array | None,
    ghost: BoolArray | None,
) -> list[_Springs]:
    n, m = shape
    inverse = np.ones(shape) if mass is None else mass
    light = np.zeros(shape, dtype=bool) if ghost is None else ghost
    plain = mass is None and ghost is None
    made: list[_Springs] = []

    def add(a: int, b: int, stiff: float, start: int = 0, step: int = 1) -> None:
        """Springs from (i, j) to (i + a, j + b); every `step`-th from `start` along the move."""
        rows = slice(start if a else 0, n - a, step if a else 1)
        columns = slice(max(0, -b) if a else start, m - max(0, b), 1 if a else step)
        one = (rows, columns)
        two = (
            slice(rows.start + a, n, rows.step),
            slice(columns.start + b, columns.stop + b, columns.step),
        )
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        long = float(np.sqrt((a * rest[0]) ** 2 + (b * rest[1]) ** 2))
        first, second = np.zeros((2, n, m))
        if plain:
            first[one] = 0.5 * stiff
            row = first.reshape(-1)
            made.append(_Springs(a * m + b, long, row, row))
            return
        ends = inverse[one].copy(), inverse[two].copy()
        ends[0][light[two] & ~light[one]] = 0.0
        ends[1][light[one] & ~light[two]] = 0.0
        total = np.maximum(ends[0] + ends[1], 1e-9)
        first[one], second[one] = (stiff * end / total for end in ends)
        made.append(_Springs(a * m + b, long, first.reshape(-1), second.reshape(-1)))

    for start in (0, 1):
        add(1, 0, weave.stretch, start, 2)
        add(0, 1, weave.stretch, start, 2)
    for b in (1, -1):
        add(1, b, weave.shear)
    for far, stiff in ((2, weave.bend), (4, weave.fold)):
        if stiff > 0 and n > far and m > far:
            add(far, 0, stiff)
            add(0, far, stiff)
    return made


def settle(
    place: Float64Array,
    rest: tuple[float, float],
    bodies: Sequence[Push],
    steps: int,
    weave: Weave = LINEN,
    *,
    mass: Float64Array | None = None,
    ghost: BoolArray | None = None,
    friction: float = 0.4,
    iterations: int = 3,
    pressure: float = 0.0,
) -> Float64Array:
    """Return a sheet (3, n, m) after `steps` of falling, rounded to a micrometre.

    `rest` are the distances of its points along i and j, metres; `mass` (n, m) inverse masses, 0
    for what is held; `ghost` (n, m) marks points that follow the others without pulling at them.
    `friction` is the share of its way that a touching point loses; `pressure` pushes along the
    normals of a bag, (3, 2, n, m), whose two sheets have one rim.
    """
    place = place.copy()
    before = place.copy()
    springs = _springs((place.shape[-2], place.shape[-1]), rest, weave, mass, ghost)
    relaxer = _Relaxer(place, springs)
    free = np.ones(place.shape[1:]) if mass is None else (mass > 0).astype(np.float64)
    for _ in range(steps):
        speed = np.clip(_DAMPING * (place - before), -_FASTEST, _FASTEST)
        speed[2] -= _GRAVITY
        before = place.copy()
        place += speed * free
        if pressure > 0:
            place += pressure * _bag_normals(place)
        for _ in range(iterations):
            relaxer.relax()
            if pressure > 0:
                _join_rims(place)
        for push in bodies:
            hit = push(place)
            place += friction * hit * (before - place)
    for push in [*bodies] * _REFRESH:
        push(place)
    return np.round(place, _ROUNDED)


def normals(place: Float64Array) -> Float64Array:
    """Unit normals of a sheet, d/di x d/dj, in the shape of `place`."""
    a, b = _differences(place, -2), _differences(place, -1)
    rings = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    cross = np.stack(rings)
    long = np.sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
    return np.asarray(cross / np.maximum(long, 1e-12))


def _differences(place: Float64Array, axis: int) -> Float64Array:
    out = np.empty_like(place)
    old, new = (each.swapaxes(axis, -1) for each in (place, out))
    np.subtract(old[..., 2:], old[..., :-2], out=new[..., 1:-1])
    np.subtract(old[..., 1], old[..., 0], out=new[..., 0])
    np.subtract(old[..., -1], old[..., -2], out=new[..., -1])
    return out


def _bag_normals(place: Float64Array) -> Float64Array:
    """Outward normals of a bag: the second sheet is the lower one."""
    out = normals(place)
    out[:, 1] *= -1
    return out


def _join_rims(place: Float64Array) -> None:
    for cut in (np.s_[:, :, 0, :], np.s_[:, :, -1, :], np.s_[:, :, :, 0], np.s_[:, :, :, -1]):
        rim = place[cut]
        rim[:] = (0.5 * (rim[:, 0] + rim[:, 1]))[:, None]


def refined(place: Float64Array) -> Float64Array:
    """Return a sheet of twice the resolution, (..., 2n - 1, 2m - 1), through the same points.

    The scheme of four points (Dyn et al. 1987).
    """
    for axis in (-2, -1):
        old = np.moveaxis(place, axis, -1)
        new = np.empty((*old.shape[:-1], 2 * old.shape[-1] - 1))
        new[..., ::2] = old
        outer = np.concatenate(
            [2 * old[..., :1] - old[..., 1:2], old, 2 * old[..., -1:] - old[..., -2:-1]], axis=-1
        )
        near = outer[..., 1:-2] + outer[..., 2:-1]
        new[..., 1::2] = 0.5625 * near - 0.0625 * (outer[..., :-3] + outer[..., 3:])
        place = np.moveaxis(new, -1, axis)
    return place


def solid(
    place: Float64Array, rest: tuple[float, float], thickness: float, cells: BoolArray | None = None
) -> BodyMesh:
    """Return the closed body of a sheet whose front is `place` (3, n, m); uvs are those at rest.

    `cells` (n - 1, m - 1) marks the quads that the cloth has.
    """
    n, m = place.shape[1:]
    inner = place - thickness * normals(place)
    if cells is None:
        cells = np.ones((n - 1, m - 1), dtype=bool)
    index = np.arange(n * m).reshape(n, m)
    corner = [index[:-1, :-1][cells], index[1:, :-1][cells]]
    corner += [index[1:, 1:][cells], index[:-1, 1:][cells]]
    a, b, c, d = corner
    front = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    i, j = np.meshgrid(np.arange(n) * rest[0], np.arange(m) * rest[1], indexing="ij")
    uvs = np.stack([j, i], axis=-1).reshape(-1, 2)
    used, numbers = np.unique(front, return_inverse=True)
    front = numbers.reshape(-1, 3)
    upper, lower = (side.reshape(3, -1).T[used] for side in (place, inner))
    meshes = [
        BodyMesh(upper, front, uvs[used]),
        BodyMesh(lower, front[:, ::-1], uvs[used]),
        rims(upper, lower, front, uvs[used]),
    ]
    return merge(meshes)


@lru_cache(maxsize=64)
def plump(shape: int, aspect: int, dented: bool = False) -> Float64Array:
    """A stuffed cushion of half extents 1 (x) and `aspect` / 100 (y): (3, 2, n, m), upper first.

    Two sheets sewn at their rims, blown up between two plates, of thickness 1; wrinkles run in from
    the seams. `dented`: by a head.
    """
    draw = generator(shape, "cushion", aspect, dented)
    n, m = 21, 2 * int(10 * aspect / 100) + 1
    step = (2.0 / (n - 1), 2.0 * aspect / 100 / (m - 1))
    x, y = np.meshgrid(
        (np.arange(n) - (n - 1) / 2) * step[0],
        (np.arange(m) - (m - 1) / 2) * step[1],
        indexing="ij",
    )
    swell = 0.02 * (1 - np.abs(x)) + 0.01 * draw.standard_normal((2, n, m))
    place = started((x[None], y[None], swell * np.array([1.0, -1.0])[:, None, None]))
    _join_rims(place)
    thick = 0.5  # of half extents; scaled to 1 below
    bodies = [plane(2, -0.5 * thick), plane(2, 0.5 * thick, -1.0)]
    if dented:
        for deep in (0.0, 0.12):
            at = draw.uniform(-0.35, 0.35, 2) * (1, aspect / 100)
            bodies.append(_ball(float(at[0]), float(at[1]), 0.58 + deep, 0.5))
    weave = Weave(1.0, 0.15, 0.02)
    place = settle(place, step, bodies, 100, weave, friction=0.15, pressure=0.003)
    place[2] /= thick
    return place


def _ball(x: float, y: float, z: float, radius: float) -> Push:
    def push(place: Float64Array) -> BoolArray:
        a, b, c = place[0] - x, place[1] - y, place[2] - z
        long = np.sqrt(a * a + b * b + c * c)
        hit = long < radius
        scale = radius / np.maximum(long, 1e-9)
        for axis, (offset, centre) in enumerate(((a, x), (b, y), (c, z))):
            place[axis] = np.where(hit, centre + scale * offset, place[axis])
        return hit

    return push


def stuffed(
    size: Sequence[float], shape: int, dented: bool = False, turned: bool = False
) -> BodyMesh:
    """Return a cushion of `size` (x, y, thickness), its lowest point at z = 0.

    `shape` chooses one of few; `turned` by half a turn.
    """
    aspect = max(45, min(100, round(20 * size[1] / size[0]) * 5))
    place = plump(shape, aspect, dented)
    place = refined(place)
    scale = np.array([0.5 * size[0], 0.5 * size[1] / (aspect / 100), size[2]])
    if turned:
        scale[:2] *= -1
    points = np.moveaxis(place, 0, -1) * scale
    n, m = points.shape[1:3]
    i, j = np.meshgrid(np.linspace(0, size[0], n), np.linspace(0, size[1], m), indexing="ij")
    upper = grid(points[0], np.stack([i, j], axis=-1))
    lower = grid(points[1].swapaxes(0, 1), np.stack([i, j], axis=-1).swapaxes(0, 1))
    mesh = merge([upper, lower])
    return mesh.moved(z=-float(mesh.vertices[:, 2].min()))
