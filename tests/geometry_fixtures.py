"""Whether things of a written home cross each other or hang in the air, told by their triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shapely.geometry import Point, Polygon

from scenes.contract import Room, Scene, SceneObject
from scenes.geometry.mesh import read_ply
from scenes.reconstruction.raycast import RayCaster

_DEEP = 3e-3  # metres that surfaces may sink into each other
_SHIFT = 4e-3  # what crosses still does if one of the two is moved by this
_SINK = 0.02  # the same for cloth on upholstery
_MARGIN = 0.006
_REACH = 0.014  # metres of air that may be below what stands


class Solids:
    """The triangles of a scene's things, read once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._read: dict[str, np.ndarray] = {}

    def of(self, thing: SceneObject) -> np.ndarray:
        """Corners (N, 3, 3), metres."""
        if thing.id not in self._read:
            folder: Path = self.scene.folder / "meshes"
            self._read[thing.id] = np.concatenate(
                [read_ply(folder / f"{shape}.ply").corners for shape in thing.shapes]
            )
        return self._read[thing.id]


def crossings(solids: Solids) -> list[tuple[str, str]]:
    """Pairs of furniture, or furniture and doors or windows, whose surfaces cross."""
    things = [
        thing
        for thing in solids.scene.objects
        if not thing.is_structure or thing.category in ("door", "window")
    ]
    found = []
    for index, first in enumerate(things):
        for second in things[index + 1 :]:
            if first.is_structure and second.is_structure:
                continue
            low = np.maximum(first.bbox_min, second.bbox_min)
            high = np.minimum(first.bbox_max, second.bbox_max)
            if not (high - low > _DEEP).all():
                continue
            soft = {first.category, second.category} & {"textile", "cushion"}
            shift = np.diag([_SHIFT, _SHIFT, _SINK if soft else _SHIFT])
            one, other = (_within(solids.of(each), low, high) for each in (first, second))
            if len(one) and len(other) and _cross(one, other, shift):
                found.append((first.id, second.id))
    return found


def floating(solids: Solids, room: Room) -> list[str]:
    """Furniture of a room that neither stands, hangs from the ceiling, nor is on a wall."""
    walls = Polygon(room.floor).exterior
    near = [
        thing
        for thing in solids.scene.objects
        if thing.room == room.id and (not thing.is_structure or thing.category == "window")
    ]
    found = []
    for thing in near:
        low, high = thing.bbox_min[2], thing.bbox_max[2]
        if thing.is_structure or low < room.floor_z + _DEEP or high > room.ceiling_z - _DEEP:
            continue
        points = solids.of(thing).reshape(-1, 3)
        # Fittings touch the wall with their backs.
        if low > 0.005 and min(walls.distance(Point(p[:2])) for p in _outermost(points)) < 0.006:
            continue
        feet = points[points[:, 2] < low + 3e-3]
        feet = feet[:: max(1, len(feet) // 24)]
        others = [other for other in near if other.id != thing.id]
        if not any(_carried(foot, solids, others) for foot in feet):
            found.append(thing.id)
    return found


def _outermost(points: np.ndarray) -> np.ndarray:
    picks = [points[np.argmax(points @ way)] for way in _WAYS]
    return np.array(picks)


_ANGLES = np.arange(16) * np.pi / 8
_WAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), 0 * _ANGLES], axis=1)


def _carried(foot: np.ndarray, solids: Solids, others: list[SceneObject]) -> bool:
    start = foot + np.array([0, 0, 0.021])
    for other in others:
        inside = (foot[:2] > np.array(other.bbox_min[:2]) - 1e-3).all() and (
            foot[:2] < np.array(other.bbox_max[:2]) + 1e-3
        ).all()
        if not inside or not other.bbox_min[2] - 0.02 < foot[2] < other.bbox_max[2] + 0.02:
            continue
        box = np.array([[-1e-3, -1e-3, -0.04], [1e-3, 1e-3, 0.03]]) + foot
        triangles = _within(solids.of(other), box[0], box[1])
        reach = hits(start, np.array([0.0, 0.0, -1.0]), triangles)
        if ((reach > 0) & (reach < 0.021 + _REACH)).any():
            return True
    return False


def _within(triangles: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The triangles (N, 3, 3) that come into a box."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    least, most = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    return triangles[((most > low - _MARGIN) & (least < high + _MARGIN)).all(axis=1)]


def _cross(one: np.ndarray, other: np.ndarray, shift: np.ndarray) -> bool:
    """Whether edges of either run through the other, also if it is moved by any row of `shift`
    (3, 3) or back: things may touch."""
    casters = RayCaster(one), RayCaster(other)
    return all(
        _pierces(one - by, casters[1]) or _pierces(other + by, casters[0])
        for by in (*shift, *-shift)
    )


def _pierces(triangles: np.ndarray, caster: RayCaster) -> bool:
    """Whether an edge of the triangles (N, 3, 3) runs through what is cast at, well inside it."""
    starts = triangles.reshape(-1, 3)
    ways = np.roll(triangles, -1, axis=1).reshape(-1, 3) - starts
    lengths = np.linalg.norm(ways, axis=1)
    long = lengths > 2 * _DEEP
    if not long.any():
        return False
    starts, lengths = starts[long], lengths[long]
    ways = ways[long] / lengths[:, None]
    distances, _ = caster.cast(starts + _DEEP * ways, ways)
    return bool((distances < lengths - 2 * _DEEP).any())


def hits(start: np.ndarray, way: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distances (H,) along a ray at which it passes through triangles (N, 3, 3)."""
    a, ab, ac = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    across = np.cross(way, ac)
    volume = (ab * across).sum(axis=1)
    flat = np.abs(volume) < 1e-14
    scale = 1 / np.where(flat, 1.0, volume)
    u = ((start - a) * across).sum(axis=1) * scale
    turned = np.cross(start - a, ab)
    v = (way * turned).sum(axis=1) * scale
    inside = ~flat & (u >= 0) & (v >= 0) & (u + v <= 1)
    return np.asarray((ac * turned).sum(axis=1) * scale)[inside]
