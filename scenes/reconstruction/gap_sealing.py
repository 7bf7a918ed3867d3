"""Thin slabs that seal the gaps between the surfaces of a room, from outside.

Input: the light-stopping triangles, the rooms and the openings. Output: triangles of further
slabs. Walls, frames and panels of real scenes often miss each other by millimetres, and the light
of a bright sky gets in.

Random walks (`light_walks`) that escape pass through such gaps. Just behind a surface beside the
gap there is air that nobody indoors sees: the enclosed region of it around the escaping segment
becomes a thin slab. A slab is kept if it blocks the segment and hardly any of it is visible from
indoors; further rounds of walks, aimed close to the earlier escapes, look for what is still open.
The search ends after a certain number of walks that no slab can block. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
import trimesh
from shapely.geometry import Polygon, box

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.directions import cross
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    polygon_parts,
    simplified,
    thickened,
)
from pbrnet.scenes.reconstruction.aperture_sections import CrossSections, PlaneFrame
from pbrnet.scenes.reconstruction.light_walks import EscapedWalk, LightWalker, points_in_room
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom, slice_segments
from pbrnet.scenes.seeds import generator

GAP_SEALING_ID = "caulk"  # part of the format of scene folders
_WALKS = 16_384  # in a scene and round
_ROUNDS = 4
_MAX_TRIANGLES = 1_000_000  # of all rounds together: scenes of many triangles get fewer rounds
_AIMED_WALKS = 8_000  # more in each further round, close to the earlier escapes
_AIMED_AT = 60  # escaped walks, the latest
_AIM_SPREAD = 0.04  # metres, standard deviation
_MAX_SLABS = 60  # escaped walks that may get a slab in one round
_MOST_FRUITLESS = 100  # escaped walks of a scene for which no slab is found, after which to end
_BEHIND = 5e-5  # metres from the surface beside a gap to the slab behind it
_THICKNESS = 8e-3  # metres
_HALF_SLIT = 2e-4  # half of the widest slit in what bounds a slab, metres
_CLEARANCE = 2e-5  # metres between a slab and what bounds it: without it, the slab would show
# through a wall without thickness
_EXTENTS = (0.4, 0.1, 0.03)  # metres to each side of an escaping segment, tried in this order
_ANGLES = (0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06, 0.12)  # radians around a segment
_RAYS_PER_ANGLE = 12
_CLOSE = 0.3  # metres from a slab's plane to the openings that must stay clear of it
_MAX_PLANES = 6  # beside a segment that are tried
_SLAB_SAMPLES = 48  # points of a slab whose visibility is tested
_VIEWPOINTS = 24  # in each room
_EYES = (2, 8)  # of the viewpoints, after which to see whether too much is visible already
_MAX_VISIBLE = 0.2  # share of a slab that may be seen from indoors, through the gap itself


@dataclass(frozen=True)
class _Slab:
    frame: PlaneFrame  # depth 0 is the surface beside the gap
    outline: Polygon

    def blocks(self, segment: Float64Array) -> bool:
        """Return whether it lies across a straight segment (2, 3)."""
        point = _crossing_point(segment, self.frame)
        return point is not None and bool(shapely.contains_xy(self.outline, *point))

    def corners(self) -> Float64Array:
        """Its triangles, (F, 3, 3)."""
        solid = trimesh.creation.extrude_polygon(self.outline, _THICKNESS, engine="earcut")
        local = np.asarray(solid.vertices)[np.asarray(solid.faces)]
        flat, depth = local[..., :2], local[..., 2:] + _BEHIND
        return self.frame.to_world(flat, 0.0) + depth * self.frame.normal


def seal_gaps(
    corners: Float64Array,
    rays: RayCaster,
    rooms: list[FoundRoom],
    openings: list[FoundOpening],
    max_visible: float = _MAX_VISIBLE,
) -> tuple[Float64Array, int]:
    """Return triangles (F, 3, 3) of slabs that seal the gaps found, and the number of slabs.

    `corners` (F, 3, 3) are the light-stopping triangles that `rays` holds. At most `max_visible`
    of a slab may be seen from indoors: what shows more may be an opening that is not known.
    """
    slabs: list[_Slab] = []
    added = np.empty((0, 3, 3))
    known: list[EscapedWalk] = []
    fruitless_left = _MOST_FRUITLESS
    for round_ in range(max(1, min(_ROUNDS, _MAX_TRIANGLES // len(corners)))):
        all_corners = np.concatenate([corners, added])
        sections = CrossSections(all_corners)
        all_rays = RayCaster(added, rays) if len(added) else rays
        normals = face_areas(all_corners)[1]
        walker = LightWalker(all_rays, normals, openings)
        escaped = walker.escaped_walks(rooms, max(1, _WALKS // max(1, len(rooms))), 100 + round_)
        if known:
            escaped += _walks_near(known, walker, generator(round_, "caulk"))
        if not escaped:
            break
        known += escaped
        viewpoints = _sample_viewpoints(rooms)
        new: list[_Slab] = []
        for walk in escaped[:_MAX_SLABS]:
            segments = [walk.points[row : row + 2] for row in range(len(walk.points) - 1)]
            if fruitless_left <= 0:
                break
            if not any(slab.blocks(segment) for slab in new for segment in segments):
                tried = (
                    _slab_across(
                        segment, all_rays, sections, normals, openings, viewpoints, max_visible
                    )
                    for segment in reversed(segments)
                )
                found = next((slab for slab in tried if slab is not None), None)
                if found is None:
                    fruitless_left -= 1
                else:
                    new.append(found)
        if not new:
            break
        slabs += new
        added = np.concatenate([added, *(slab.corners() for slab in new)])
        if fruitless_left <= 0:
            break
    return added, len(slabs)


def _walks_near(
    known: list[EscapedWalk], walker: LightWalker, rng: np.random.Generator
) -> list[EscapedWalk]:
    """Trace walks close to escaped ones and return those that escape."""
    chosen = known[-_AIMED_AT:]
    count = max(1, _AIMED_WALKS // sum(len(walk.points) - 1 for walk in chosen))
    found: list[EscapedWalk] = []
    for walk in chosen:
        starts, ends = walk.points[:-1], walk.points[1:]
        origins, targets = np.repeat(starts, count, axis=0), np.repeat(ends, count, axis=0)
        # Targets all along the segment, so that the walks explore a gap's width and its length.
        share = rng.uniform(0.05, 1.0, (len(origins), 1))
        targets = origins + share * (targets - origins) + rng.normal(0, _AIM_SPREAD, origins.shape)
        directions = targets - origins
        directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
        found += walker.trace(walk.room, origins, directions, rng)[0]
    return found


def _slab_across(
    segment: Float64Array,
    rays: RayCaster,
    sections: CrossSections,
    normals: Float64Array,
    openings: list[FoundOpening],
    viewpoints: Float64Array,
    max_visible: float,
) -> _Slab | None:
    """A slab that blocks an escaping segment (2, 3) and is not visible from indoors."""
    for frame in _planes_beside(segment, rays, normals, sections):
        for extent in _EXTENTS:
            outline = _slab_outline(segment, sections, frame, extent, openings)
            if outline is None:
                break
            slab = _Slab(frame, outline)
            if slab.blocks(segment) and _is_hidden(slab, rays, viewpoints, max_visible):
                return slab
    return None


def _planes_beside(
    segment: Float64Array, rays: RayCaster, normals: Float64Array, sections: CrossSections
) -> Iterator[PlaneFrame]:
    """The planes of the surfaces that rays close to a segment (2, 3) hit, the closest first."""
    start, end = segment
    along = (end - start) / np.linalg.norm(end - start)
    first = _perpendicular(along)
    turns = 2 * np.pi * np.arange(_RAYS_PER_ANGLE) / _RAYS_PER_ANGLE
    ring = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * cross(along, first)
    seen: set[tuple[float, ...]] = set()
    cones = [np.cos(angle) * along + np.sin(angle) * ring for angle in _ANGLES]
    hit = rays.cast(start, np.concatenate(cones))[1]  # all at once: calls cost more than rays
    for triangles in np.split(hit, len(_ANGLES)):
        for triangle in triangles[triangles >= 0].tolist():
            outward = normals[triangle] * (1.0 if normals[triangle] @ along > 0 else -1.0)
            origin = sections.corners[triangle, 0]
            key = (*np.round(outward, 2).tolist(), round(float(outward @ origin), 3))
            if outward @ along < 0.02 or key in seen:
                continue
            seen.add(key)
            u = _perpendicular(outward)
            yield PlaneFrame(origin, u, cross(outward, u))
            if len(seen) >= _MAX_PLANES:
                return


def _perpendicular(vector: Float64Array) -> Float64Array:
    """A unit vector (3,) at right angles to `vector`, from its smallest component's axis."""
    made = cross(vector, np.eye(3)[int(np.argmin(np.abs(vector)))])
    made /= np.linalg.norm(made)
    return made


def _slab_outline(
    segment: Float64Array,
    sections: CrossSections,
    frame: PlaneFrame,
    extent: float,
    openings: list[FoundOpening],
) -> Polygon | None:
    """The enclosed air around a segment in the section just behind a surface."""
    point = _crossing_point(segment, frame)
    if point is None:
        return None
    depth = _BEHIND + 0.5 * _THICKNESS
    low, high = point - extent, point + extent
    nearby = sections.near(frame, np.append(low, 0.0), np.append(high, 2 * depth))
    lines = slice_segments(nearby, depth)
    free = box(*low, *high)
    if len(lines):
        walls = thickened(shapely.linestrings(lines), _HALF_SLIT, quad_segs=2)
        free = difference(free, walls)
    for outline in _projected(openings, frame):
        free = difference(free, outline)
    parts = [
        part for part in polygon_parts(free) if part.distance(shapely.Point(point)) <= _HALF_SLIT
    ]
    if not parts:
        return None
    grown = simplified(buffered(parts[0], _HALF_SLIT - _CLEARANCE, quad_segs=2), 0.5 * _CLEARANCE)
    return grown if isinstance(grown, Polygon) and not grown.is_empty else None


def _crossing_point(segment: Float64Array, frame: PlaneFrame) -> Float64Array | None:
    """Point (2,) at which a segment crosses the middle of a slab outwards; None if it does not."""
    depth = _BEHIND + 0.5 * _THICKNESS
    start, end = frame.to_local(segment)
    if not start[2] < depth < end[2]:
        return None
    point: Float64Array = (start + (depth - start[2]) / (end[2] - start[2]) * (end - start))[:2]
    return point


def _projected(openings: list[FoundOpening], frame: PlaneFrame) -> list[Polygon]:
    """The outlines, in a plane, of the openings close to it."""
    if not openings:
        return []
    counts = np.array([len(opening.polygon) for opening in openings], dtype=np.int64)
    depths = frame.to_local(np.concatenate([opening.polygon for opening in openings]))[:, 2]
    first: Int64Array = np.cumsum(counts) - counts
    close = np.minimum.reduceat(np.abs(depths), first) <= _CLOSE
    return [
        shapely.convex_hull(shapely.multipoints(frame.to_local(opening.polygon)[:, :2]))
        for opening, is_close in zip(openings, close.tolist(), strict=True)
        if is_close
    ]


def _sample_viewpoints(rooms: list[FoundRoom]) -> Float64Array:
    """Points indoors, (N, 3), from which slabs must not be visible."""
    rng = generator(0, "witnesses")
    sampled = []
    for room in rooms:
        points = points_in_room(room, _VIEWPOINTS, rng)
        points[:, 2] = rng.uniform(room.floor_z + 0.1, room.ceiling_z - 0.1, len(points))
        sampled.append(room.lowered(points))
    return np.concatenate(sampled)


def _is_hidden(slab: _Slab, rays: RayCaster, viewpoints: Float64Array, max_visible: float) -> bool:
    """Return whether at most `max_visible` of a slab is visible from indoors."""
    rng = generator(0, "slab")
    low, high = np.array(slab.outline.bounds).reshape(2, 2)
    flat = rng.uniform(low, high, (8 * _SLAB_SAMPLES, 2))
    flat = flat[shapely.contains_xy(slab.outline, flat[:, 0], flat[:, 1])][:_SLAB_SAMPLES]
    if not len(flat):
        return True
    points = slab.frame.to_world(flat, 0.5 * _BEHIND)
    nearest = viewpoints[np.argsort(np.linalg.norm(viewpoints - points[0], axis=1))[:_VIEWPOINTS]]
    is_visible = np.zeros(len(points), dtype=bool)
    # From the nearest viewpoints first, since a slab that shows mostly does so from there.
    for eyes in np.split(nearest, _EYES):
        offsets = eyes[None] - points[~is_visible, None]
        lengths = np.linalg.norm(offsets, axis=2)
        directions = (offsets / lengths[..., None]).reshape(-1, 3)
        distance, _ = rays.cast(np.repeat(points[~is_visible], len(eyes), axis=0), directions)
        is_visible[~is_visible] = (distance.reshape(lengths.shape) >= lengths).any(axis=1)
        if is_visible.mean() > max_visible:
            return False
    return True
