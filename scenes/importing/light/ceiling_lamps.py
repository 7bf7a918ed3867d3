"""Plain ceiling lamps for rooms without light, the same for every source.

A lamp is a globe of `LUMENS_PER_AREA` for each square metre of its room's floor, below the
ceiling, over the point that is farthest from the walls or near it. A room of which that lamp
would light a part only, such as a hall or a winding corridor, has several.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array, as_triple
from pbrnet.scenes.color import REC709, Color, decode_srgb_value
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import deepest_point
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape, make_object
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom, inside_points

LUMENS_PER_AREA = 150.0  # of a ceiling lamp, per square metre of floor
_LEAST_LUMENS, _MOST_LUMENS = 1000.0, 6000.0
_LAMP_COLOR = 0xAA9770  # sRGB; of the lamps in the catalogue of Sweet Home 3D
_GLOBE, _DROP = 0.12, 0.3  # metres: radius, and from the ceiling to the centre
_CLEARANCE = 0.25  # metres from the centre of a lamp to the nearest surface
_GRID = 7  # places tried each way, if the middle of the room is not free
_FAR = 6.0  # metres, in plan, up to which a lamp lights a floor
_LIT = 0.8  # share of the floor that lamps light
_MOST_LAMPS = 16  # of a room
_PLACES = 200  # of a floor, that are lit or may have a lamp
_FROM = 0.6  # of a room's height, from which the ceiling is looked for
_DIRECTIONS = 64


@dataclass(frozen=True)
class HungLamp:
    """A ceiling lamp as parts of a scene, and its flux in lumens."""

    shape: Shape
    emitter: Element
    object: SceneObject
    lumens: float


@dataclass(frozen=True)
class CeilingLamp:
    """A globe that shines evenly to all sides, in metres, Z up."""

    centre: tuple[float, float, float]
    radius: float
    lumens: float
    radiance: Color

    @property
    def mesh(self) -> Mesh:
        """An octahedron around the globe, for its bounds."""
        return octahedron(np.array(self.centre), self.radius)


def ceiling_lamp(floor: Polygon, ceiling_z: float) -> CeilingLamp:
    """The lamp of a room whose middle is free below the ceiling."""
    x, y = deepest_point(floor)
    return _lamp(floor.area, np.array([x, y, ceiling_z - _DROP]))


def free_ceiling_lamps(room: FoundRoom, rays: RayCaster) -> list[CeilingLamp]:
    """The lamps of a room among the triangles of `rays`: below the surface above, in free air."""
    places = _lamp_places(room.floor)
    area = room.floor.area / len(places)
    return [_lamp(area, _free_centre(room, place, rays)) for place in places]


def _lamp_places(floor: Polygon) -> list[Float64Array]:
    """Places (2,) in plan of lamps that together light most of a floor; the first is its middle.

    A lamp lights what is in line of sight, at most `_FAR` away.
    """
    middle, points = deepest_point(floor), inside_points(floor, _PLACES, _CLEARANCE)
    places, lit = [middle], _sees(floor, middle, points)
    if lit.mean() >= _LIT:
        return places
    shapely.prepare(floor)
    views = np.array([_sees(floor, point, points) for point in points])
    while lit.mean() < _LIT and len(places) < _MOST_LAMPS:
        best = int(np.argmax((views & ~lit).sum(axis=1)))
        places.append(points[best])
        lit |= views[best]
    return places


def _sees(floor: Polygon, place: Float64Array, points: Float64Array) -> BoolArray:
    """Return which of `points` (N, 2) are near `place` (2,) and in line of sight on a floor."""
    near: BoolArray = ((points - place) ** 2).sum(axis=1) <= _FAR**2
    ends = np.stack([np.broadcast_to(place, points.shape), points], axis=1)
    near[near] = shapely.covers(floor, shapely.linestrings(ends[near]))
    return near


def _free_centre(room: FoundRoom, place: Float64Array, rays: RayCaster) -> Float64Array:
    """The centre (3,) of a lamp as near to `place` (2,) in plan as there is `_CLEARANCE` around it.

    Without such a place, the one with the most free air.
    """
    floor, ceiling_z = room.floor, room.ceiling_z
    below = room.floor_z + _FROM * (ceiling_z - room.floor_z)
    low, high = np.array(floor.bounds[:2]), np.array(floor.bounds[2:])
    steps = (np.arange(_GRID) + 0.5) / _GRID
    grid = np.stack(np.meshgrid(*(low + (high - low) * steps[:, None]).T), axis=-1).reshape(-1, 2)
    grid = grid[np.argsort(np.linalg.norm(grid - place, axis=1), kind="stable")]
    best, most = np.array([*place, ceiling_z - _DROP]), -1.0
    for x, y in np.vstack([place[None], grid]):
        if not floor.contains(Point(x, y)):
            continue
        above = float(rays.cast(np.array([x, y, below]), np.array([[0.0, 0, 1]]))[0][0])
        centre = np.array([x, y, min(ceiling_z, below + above) - _DROP])
        free = float(rays.cast(centre, fibonacci_sphere(_DIRECTIONS))[0].min())
        if free > most:
            best, most = centre, free
        if free >= _CLEARANCE:
            break
    return best


def hung_lamp(lamp: CeilingLamp, id: str, room: str) -> HungLamp:
    """`lamp` in the room with the id `room`, its shape with the id `id`."""
    to_world = np.diag([lamp.radius] * 3 + [1.0])
    to_world[:3, 3] = lamp.centre
    black = Surface(plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0)), name="lamp")
    shape = Shape(id, "ceiling lamp", lamp.mesh, black, sphere=to_world)
    return HungLamp(
        shape,
        plugin("emitter", "area", radiance=lamp.radiance),
        make_object(id, "ceiling lamp", "lamp", [shape], room=room),
        round(lamp.lumens, 1),
    )


def octahedron(centre: Float64Array, radius: float) -> Mesh:
    """An octahedron around a ball at `centre` (3,)."""
    tips = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
                      [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])  # fmt: skip
    return Mesh(centre + radius * tips, faces)


def _lamp(area: float, centre: Float64Array) -> CeilingLamp:
    """The lamp at `centre` (3,) for a floor of `area` square metres."""
    lumens = float(np.clip(LUMENS_PER_AREA * area, _LEAST_LUMENS, _MOST_LUMENS))
    bands = [decode_srgb_value(((_LAMP_COLOR >> shift) & 255) / 255) for shift in (16, 8, 0)]
    white = float(np.array(bands) @ REC709)
    luminance = lumens * LUMEN / (math.pi * (4 * math.pi * _GLOBE**2))
    red, green, blue = (luminance * (band / white) for band in bands)
    return CeilingLamp(as_triple(centre), _GLOBE, lumens, (red, green, blue))
