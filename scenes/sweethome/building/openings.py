"""Openings of doors and windows: the walls that they cut and the shape of the holes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import intersection, union
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.cutouts import UnreadablePath, path_region
from pbrnet.scenes.sweethome.building.solids import polygons
from pbrnet.scenes.sweethome.home import HomePiece

_TOUCH = 1.0  # square centimetres: smallest overlap with a wall, and cut-out, that count
_MIDDLE = 0.6  # of a piece's width
_PAST = 3.0  # cm by which a hole is deeper than the wall, skirting included
_AT_FLOOR = 0.5  # cm: a hole that starts no higher above the floor has no sill
_SUNK = 1.5  # cm that such a hole extends into the floor, so that no wall shows there
_WHOLE = box(0, 0, 1, 1)


@dataclass(frozen=True)
class Opening:
    """A door or window in plan coordinates (cm): its coordinate frame and its cut-out.

    `across` points along its width, `out` along its depth to its front. `shape` is the cut-out
    in (distance along the width from the centre, height above the ground), cm.
    """

    piece: HomePiece
    centre: Float64Array
    across: Float64Array
    out: Float64Array
    shape: BaseGeometry

    @property
    def footprint(self) -> Polygon:
        """Region that the piece covers on the plan."""
        return self._strip(-0.5 * self.piece.depth, 0.5 * self.piece.depth)

    def is_in_wall(self, walls: Sequence[BaseGeometry]) -> bool:
        """Test whether one of `walls` fills the middle of the piece on the plan."""
        half, reach = 0.5 * _MIDDLE * self.piece.width, 0.5 * self.piece.depth
        corners = [(-half, -reach), (half, -reach), (half, reach), (-half, reach)]
        middle = Polygon([self.at(along, depth) for along, depth in corners])
        return any(intersection(wall, middle).area >= _TOUCH for wall in walls)

    def depths(self, wall: BaseGeometry, is_round: bool) -> tuple[float, float] | None:
        """Return the range along `out` (cm) of the hole in a wall's region, or None."""
        footprint = self.footprint
        if intersection(wall, footprint).area < _TOUCH:
            return None
        reach = 0.5 * self.piece.depth
        near = intersection(wall, self._strip(-reach - 200, reach + 200))
        touched = [part for part in polygons(near) if intersection(part, footprint).area >= _TOUCH]
        if not touched:
            return None
        across = [self._depths(part) for part in touched]
        low = min(depth.min() for depth in across)
        high = max(depth.max() for depth in across)
        if not is_round and high - low > reach * 2 + 120:
            # The wall continues far beyond the door in its depth: cut only what the piece covers.
            low, high = max(low, -reach), min(high, reach)
        return (low - _PAST, high + _PAST)

    def hole(self, low: float, high: float, floor: float) -> manifold3d.Manifold:
        """Return the cut-out between two depths (cm) as a solid in the world (m).

        `floor` is the height (cm above the ground) of the storey whose wall is cut.
        """
        contours = []
        shape = self.shape
        if abs(shape.bounds[1] - floor) < _AT_FLOOR:
            shape = union([shape, translate(shape, 0, -_SUNK)])
        for part in polygons(shape):
            contours.append(np.asarray(part.exterior.coords)[:-1])
            contours += [np.asarray(inner.coords)[:-1] for inner in part.interiors]
        section = manifold3d.CrossSection(contours, manifold3d.FillRule.Positive)
        solid = manifold3d.Manifold.extrude(section, high - low)
        # Section x runs along the width, y upwards, the extrusion along `out`: right-handed.
        across, out = self.across * [1, -1], self.out * [1, -1]
        origin = self.centre * [1, -1] + low * out
        frame = np.array(
            [
                [across[0], 0.0, out[0], origin[0]],
                [across[1], 0.0, out[1], origin[1]],
                [0.0, 1.0, 0.0, 0.0],
            ]
        )
        return solid.transform(0.01 * frame)

    def at(self, along: float, depth: float) -> Float64Array:
        """Return plan coordinates (2,) of a point in the frame of the opening."""
        return self.centre + along * self.across + depth * self.out

    def _depths(self, region: Polygon) -> Float64Array:
        return (np.asarray(region.exterior.coords) - self.centre) @ self.out

    def _strip(self, low: float, high: float) -> Polygon:
        half = 0.5 * self.piece.width
        corners = [(-half, low), (half, low), (half, high), (-half, high)]
        return Polygon([self.at(along, depth) for along, depth in corners])


def opening_of(piece: HomePiece, elevation: float, changes: Changes) -> Opening | None:
    """Return the opening of a door or window, or None; `elevation` is that of its level (cm)."""
    if piece.cut is None or piece.width <= 0 or piece.height <= 0:
        return None
    cosine, sine = math.cos(piece.angle), math.sin(piece.angle)
    region: BaseGeometry = _WHOLE
    if piece.cut.shape:
        try:
            region = intersection(path_region(piece.cut.shape), _WHOLE)
        except (UnreadablePath, ValueError) as error:
            changes.note("cut-out shapes that cannot be read became rectangles: {}",
                         f"{piece.name} ({error})")  # fmt: skip
        if region.area < 1e-4:
            region = _WHOLE
    cut, bottom = piece.cut, elevation + piece.elevation
    mirror = -1.0 if piece.mirrored else 1.0

    def placed(points: Float64Array) -> Float64Array:
        across = cut.left + cut.width * points[:, 0] - 0.5
        up = 1.0 - (cut.top + cut.height * points[:, 1])
        return np.stack([mirror * across * piece.width, bottom + up * piece.height], axis=1)

    shape = shapely.transform(region, placed)
    if shape.area < _TOUCH:
        changes.note("doors and windows with an empty cut-out cut no wall: {}", piece.name)
        return None
    return Opening(
        piece=piece,
        centre=np.array([piece.x, piece.y]),
        across=np.array([cosine, sine]),
        out=np.array([-sine, cosine]),
        shape=shape,
    )
