"""Portal rectangles of doors and windows, and the points on either side of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import simplified
from pbrnet.scenes.sweethome.building.openings import Opening
from pbrnet.scenes.sweethome.building.solids import polygons
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem

_BEYOND = 25.0  # cm in front of and behind a wall: points that tell the rooms on its sides
_MAX_CORNERS = 48
_COVER = 0.75  # share of an opening that a closed door or a blind hides; frames hide up to 0.6
_GRID = 16  # points of an opening in each direction that are tested


class Leaves:
    """The doors and windows among items, indexed by their place on the plan."""

    def __init__(self, items: list[PlacedItem]) -> None:
        self._items = [item for item in items if item.category in ("door", "window")]
        self._bounds = np.array([item.bounds for item in self._items]).reshape(-1, 2, 3)
        low, high = self._bounds[:, 0], self._bounds[:, 1]
        self._tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))

    def near(self, low: Float64Array, high: Float64Array) -> list[PlacedItem]:
        """Return those whose bounds meet the box from `low` to `high` (3,)."""
        found = sorted(self._tree.query(shapely.box(*low[:2], *high[:2])).tolist())
        return [
            self._items[number]
            for number in found
            if self._bounds[number, 0, 2] <= high[2] and self._bounds[number, 1, 2] >= low[2]
        ]


@dataclass(frozen=True)
class Doorway:
    """An opening through walls. `polygon` (N, 3) is counter-clockwise seen from its front.

    `front` and `back` are points (3,) on either side; `normal` (3,) points to the front. World,
    metres.
    """

    polygon: Float64Array
    normal: Float64Array
    front: Float64Array
    back: Float64Array
    depth: float  # metres between the outermost wall faces

    def is_clear(self, leaves: Leaves) -> bool:
        """Return whether light passes through: no opaque part fills the hole, frames aside.

        A grid of points is tested against the triangles of doors and windows.
        """
        middle = self.polygon.mean(axis=0)
        reach = np.linalg.norm(self.polygon - middle, axis=1).max() + 0.1
        across = self.polygon[1] - self.polygon[0]
        across = across / max(np.linalg.norm(across), 1e-9)
        axes = np.stack([np.cross([0.0, 0, 1], self.normal), [0.0, 0, 1], self.normal])
        flat = (self.polygon - middle) @ axes[:2].T
        low, high = flat.min(axis=0), flat.max(axis=0)
        grid = np.stack(
            np.meshgrid(
                *(np.linspace(a, b, 2 * _GRID + 1)[1::2] for a, b in zip(low, high, strict=True))
            ),
            axis=-1,
        ).reshape(-1, 2)
        hidden = np.zeros(len(grid), dtype=bool)
        for item in leaves.near(middle - reach, middle + reach):
            for part in item.parts:
                if part.finish.kind in ("glass", "sheer"):
                    continue
                corners = (part.mesh.corners - middle) @ axes.T
                hidden |= _covered(corners, grid, 0.5 * self.depth + 0.1)
        return bool(hidden.mean() < _COVER)


def find_doorways(opening: Opening, walls: list[tuple[BaseGeometry, bool]]) -> list[Doorway]:
    """Return the doorways of an opening, one for each part of it; none if it cuts no wall."""
    spans = [span for region, is_round in walls if (span := opening.depths(region, is_round))]
    if not spans:
        return []
    low, high = min(span[0] for span in spans), max(span[1] for span in spans)
    # The plane of the panes goes through the centre of the piece if that is inside the wall.
    depth = min(max(0.0, low + 4.0), high - 4.0)
    found = []
    for part in polygons(opening.shape):
        outline = _few_corners(part)
        ring = np.asarray(outline.exterior.coords)[:-1]
        points = np.array([[*opening.at(along, depth), up] for along, up in ring])
        along, up = part.representative_point().coords[0]
        sides = [
            np.array([*opening.at(along, at), up]) * [0.01, -0.01, 0.01]
            for at in (high + _BEYOND, low - _BEYOND)
        ]
        normal = np.array([opening.out[0], -opening.out[1], 0.0])
        found.append(
            Doorway(points * [0.01, -0.01, 0.01], normal, sides[0], sides[1], 0.01 * (high - low))
        )
    return found


def _few_corners(part: Polygon) -> Polygon:
    """Return the outline with at most `_MAX_CORNERS` corners, else its bounding box."""
    outline = Polygon(part.exterior)
    if len(outline.exterior.coords) - 1 > _MAX_CORNERS:
        outline = simplified(outline, 0.5)
    if len(outline.exterior.coords) - 1 > _MAX_CORNERS:
        outline = outline.envelope
    return outline


def _covered(triangles: Float64Array, points: Float64Array, depth: float) -> np.ndarray:
    """Return bool (N,): does a triangle cross the line through a point within `depth` of it?

    `triangles` (T, 3, 3) have the plane's coordinates and the distance from it, `points` (N, 2)
    lie in it. A leaf that stands open crosses these lines farther away.
    """
    covered = np.zeros(len(points), dtype=bool)
    triangles = triangles[(np.abs(triangles[..., 2]).min(axis=1) < depth)]
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = _cross(b - a, c - a)
    a, b, c, area = (values[area != 0] for values in (a, b, c, area))
    for number, point in enumerate(points):
        point = np.append(point, 0.0)
        at_b, at_c = _cross(point - a, c - a) / area, _cross(b - a, point - a) / area
        distance = a[:, 2] + at_b * (b - a)[:, 2] + at_c * (c - a)[:, 2]
        inside = (at_b > 0) & (at_c > 0) & (at_b + at_c < 1)
        covered[number] = bool((inside & (np.abs(distance) < depth)).any())
    return covered


def _cross(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return the cross products (N,) of the first two coordinates of vectors (N, 3)."""
    made: Float64Array = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return made
