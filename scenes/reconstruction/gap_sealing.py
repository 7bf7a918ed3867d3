"""Cracks between the surfaces of a room, closed from outside.

Walls, frames and panelling of real scenes often miss each other by millimetres, and light of a
bright sky gets through. Behind the surface beside such a crack lies air that nobody indoors sees:
a thin slab of it, bounded by whatever stands there, is filled. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
import shapely
import trimesh
from shapely.geometry import Polygon, box

from scenes.arrays import Float64Array
from scenes.geometry.mesh import face_areas
from scenes.reconstruction.aperture_sections import Cuts, Frame
from scenes.reconstruction.hidden_openings import Escape, Walker
from scenes.reconstruction.light_walks import places
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import FoundOpening, FoundRoom, slice_segments
from scenes.seeds import generator

CAULK_ID = "caulk"
_WALKS = 16_384  # a scene and round
_ROUNDS = 4
_TRIANGLES = 1_000_000  # in all rounds together: scenes of many triangles get fewer
_AIMED = 8_000  # more in each further round, close to those that got out before
_FOLLOWED = 60  # of the walks that got out, the latest
_CLOSED_A_ROUND = 60  # of them that get a slab
_ASIDE = 0.04  # metres by which they miss them
_BEHIND = 5e-5  # metres from the surface beside a crack to the slab behind it
_THICK = 8e-3  # metres
_SLIT = 2e-4  # half of the widest gap in what bounds the slab
_SHORT = 2e-5  # metres that a slab stays short of what bounds it: else it would show through a
# wall without thickness
_REACHES = (0.4, 0.1, 0.03)  # metres to each side of an escape, tried in this order
_ANGLES = (0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06, 0.12)  # radians around an escape
_AROUND = 12
_PLANES = 6  # beside an escape that are tried
_SAMPLES = 48  # points of a slab whose sight is tried
_WITNESSES = 24  # places in each room that look
_SEEN = 0.2  # of a slab may be seen from indoors: through the crack itself


@dataclass(frozen=True)
class _Slab:
    frame: Frame  # depth 0 is the surface beside the crack
    plan: Polygon

    def stops(self, stretch: Float64Array) -> bool:
        """Whether it lies across a straight way (2, 3)."""
        point = _crossing(stretch, self.frame)
        return point is not None and bool(shapely.contains_xy(self.plan, *point))

    def corners(self) -> Float64Array:
        """Its triangles, (F, 3, 3)."""
        solid = trimesh.creation.extrude_polygon(self.plan, _THICK, engine="earcut")
        local = np.asarray(solid.vertices)[np.asarray(solid.faces)]
        flat, depth = local[..., :2], local[..., 2:] + _BEHIND
        return self.frame.world(flat, 0.0) + depth * self.frame.normal


def caulk(
    corners: Float64Array, rays: RayCaster, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[Float64Array, int]:
    """Triangles (F, 3, 3) that close what cracks walks of light find, and how many slabs they are.

    `corners` are the triangles that stop light as it is, `rays` cast at them.
    """
    made: list[_Slab] = []
    added = np.empty((0, 3, 3))
    known: list[Escape] = []
    for round_ in range(max(1, min(_ROUNDS, _TRIANGLES // len(corners)))):
        all_corners = np.concatenate([corners, added])
        cuts = Cuts(all_corners)
        tight = RayCaster(added, rays) if len(added) else rays
        normals = face_areas(all_corners)[1]
        walker = Walker(tight, normals, openings)
        escapes = walker.escapes(rooms, max(1, _WALKS // max(1, len(rooms))), 100 + round_)
        if known:
            escapes += _close_to(known, walker, generator(round_, "caulk"))
        if not escapes:
            break
        known += escapes
        witnesses = _witnesses(rooms)
        new: list[_Slab] = []
        for escape in escapes[:_CLOSED_A_ROUND]:
            stretches = [escape.points[row : row + 2] for row in range(len(escape.points) - 1)]
            if not any(slab.stops(stretch) for slab in new for stretch in stretches):
                tried = (
                    _slab_for(one, tight, cuts, normals, openings, witnesses)
                    for one in reversed(stretches)
                )
                new += islice((slab for slab in tried if slab is not None), 1)
        if not new:
            break
        made += new
        added = np.concatenate([added, *(slab.corners() for slab in new)])
    return added, len(made)


def _close_to(known: list[Escape], walker: Walker, rng: np.random.Generator) -> list[Escape]:
    """Walks that get out close to where others did."""
    some = known[-_FOLLOWED:]
    count = max(1, _AIMED // sum(len(escape.points) - 1 for escape in some))
    found: list[Escape] = []
    for escape in some:
        starts, ends = escape.points[:-1], escape.points[1:]
        origins, targets = np.repeat(starts, count, axis=0), np.repeat(ends, count, axis=0)
        # Somewhere along the way, so that a crack is passed by its width and by its length.
        share = rng.uniform(0.05, 1.0, (len(origins), 1))
        targets = origins + share * (targets - origins) + rng.normal(0, _ASIDE, origins.shape)
        ways = targets - origins
        ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
        found += walker.follow(escape.room, origins, ways, rng)[0]
    return found


def _slab_for(
    stretch: Float64Array,
    rays: RayCaster,
    cuts: Cuts,
    normals: Float64Array,
    openings: list[FoundOpening],
    witnesses: Float64Array,
) -> _Slab | None:
    """A slab behind one of the surfaces beside a way out that stops it and is not seen."""
    for frame in _beside(stretch, rays, normals, cuts):
        for reach in _REACHES:
            plan = _plan(stretch, cuts, frame, reach, openings)
            if plan is None:
                break
            slab = _Slab(frame, plan)
            if slab.stops(stretch) and not _is_seen(slab, rays, witnesses):
                return slab
    return None


def _beside(
    stretch: Float64Array, rays: RayCaster, normals: Float64Array, cuts: Cuts
) -> Iterator[Frame]:
    """The planes of what rays close to a way out hit, the closest first."""
    start, end = stretch
    way = (end - start) / np.linalg.norm(end - start)
    first = np.cross(way, np.eye(3)[int(np.argmin(np.abs(way)))])
    first /= np.linalg.norm(first)
    turns = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * np.cross(way, first)
    seen: set[tuple[float, ...]] = set()
    for angle in _ANGLES:
        around = np.cos(angle) * way + np.sin(angle) * ring
        _, triangles = rays.cast(start, around)
        for triangle in triangles[triangles >= 0].tolist():
            outward = normals[triangle] * (1.0 if normals[triangle] @ way > 0 else -1.0)
            origin = cuts.corners[triangle, 0]
            key = (*np.round(outward, 2).tolist(), round(float(outward @ origin), 3))
            if outward @ way < 0.02 or key in seen:
                continue
            seen.add(key)
            u = np.cross(outward, np.eye(3)[int(np.argmin(np.abs(outward)))])
            u /= np.linalg.norm(u)
            yield Frame(origin, u, np.cross(outward, u))
            if len(seen) >= _PLANES:
                return


def _plan(
    stretch: Float64Array, cuts: Cuts, frame: Frame, reach: float, openings: list[FoundOpening]
) -> Polygon | None:
    """The air around a way out in the cut just behind a surface."""
    point = _crossing(stretch, frame)
    if point is None:
        return None
    depth = _BEHIND + 0.5 * _THICK
    low, high = point - reach, point + reach
    lines = slice_segments(cuts.near(frame, np.append(low, 0.0), np.append(high, 2 * depth)), depth)
    free = box(*low, *high)
    if len(lines):
        walls = shapely.union_all(shapely.buffer(shapely.linestrings(lines), _SLIT, quad_segs=2))
        free = free.difference(walls)
    for opening in openings:
        free = free.difference(_shadow(opening, frame))
    parts = [part for part in shapely.get_parts(free).tolist() if part.buffer(_SLIT).intersects(
        shapely.Point(point))]  # fmt: skip
    if not parts:
        return None
    grown = parts[0].buffer(_SLIT - _SHORT, quad_segs=2).simplify(0.5 * _SHORT)
    return grown if isinstance(grown, Polygon) and not grown.is_empty else None


def _crossing(stretch: Float64Array, frame: Frame) -> Float64Array | None:
    """Where a way (2, 3) crosses the middle of a slab behind the frame's plane outwards, (2,)."""
    depth = _BEHIND + 0.5 * _THICK
    start, end = frame.local(stretch)
    if not start[2] < depth < end[2]:
        return None
    point: Float64Array = (start + (depth - start[2]) / (end[2] - start[2]) * (end - start))[:2]
    return point


def _shadow(opening: FoundOpening, frame: Frame) -> Polygon:
    """An opening's outline in a plane that lies near it; empty for others."""
    local = frame.local(opening.polygon)
    if np.abs(local[:, 2]).min() > 0.3:
        return Polygon()
    return shapely.convex_hull(shapely.multipoints(local[:, :2]))


def _witnesses(rooms: list[FoundRoom]) -> Float64Array:
    """Places indoors, (N, 3)."""
    rng = generator(0, "witnesses")
    made = []
    for room in rooms:
        points = places(room.floor, room.floor_z, room.ceiling_z, _WITNESSES, rng)
        points[:, 2] = rng.uniform(room.floor_z + 0.1, room.ceiling_z - 0.1, len(points))
        made.append(points)
    return np.concatenate(made)


def _is_seen(slab: _Slab, rays: RayCaster, witnesses: Float64Array) -> bool:
    """Whether more of the slab's face than a crack shows is in sight from indoors."""
    rng = generator(0, "slab")
    low, high = np.array(slab.plan.bounds).reshape(2, 2)
    flat = rng.uniform(low, high, (8 * _SAMPLES, 2))
    flat = flat[shapely.contains_xy(slab.plan, flat[:, 0], flat[:, 1])][:_SAMPLES]
    if not len(flat):
        return False
    points = slab.frame.world(flat, 0.5 * _BEHIND)
    near = witnesses[np.argsort(np.linalg.norm(witnesses - points[0], axis=1))[:_WITNESSES]]
    ways = near[None] - points[:, None]
    away = np.linalg.norm(ways, axis=2)
    flat_ways = (ways / away[..., None]).reshape(-1, 3)
    distance, _ = rays.cast(np.repeat(points, len(near), axis=0), flat_ways)
    free = (distance >= away.reshape(-1)).reshape(len(points), len(near))
    return bool(free.any(axis=1).mean() > _SEEN)
