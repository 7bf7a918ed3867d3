"""Plain closed room around a single object: floor, four walls, ceiling, a window, a lamp."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.primitives import cube
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.camera import Camera
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.photometry import lamp_radiance

_Box = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest corner

_AIR = 1.5  # metres between the object and each wall
_LEAST = np.array([3.6, 3.2, 2.6])  # least inner width, depth and height, metres
_ABOVE = 0.8  # metres between the object and the ceiling
_THICK = 0.2  # thickness of walls, floor and ceiling, metres
_WINDOW = (1.6, 1.3, 0.9)  # width, height, sill, metres
_LAMP = (0.4, 0.03, 1500.0, 4000.0)  # side, thickness, metres; lumens; kelvin
_CORNER, _EYE = 0.35, 1.55  # metres from the walls of a corner view, and its height
_HALF_FOV = 0.5534  # radians, as in PBRS
_FLOOR: Color = (0.30, 0.25, 0.20)
_WALL: Color = (0.72, 0.71, 0.69)
_CEILING: Color = (0.82, 0.82, 0.80)


@dataclass(frozen=True)
class Showroom:
    """The room in metres, Z up."""

    shapes: list[Shape]
    area: dict[str, Element]  # the lamp's emitter by shape id
    cameras: list[Camera]  # views of the object from the corners
    move: Float64Array  # (4, 4), places the object in the room


def showroom(low: Float64Array, high: Float64Array) -> Showroom:
    """Build a room for an object with bounds `low` and `high` (3,), metres, Z up.

    The object stands on the floor in the middle. The window is in the south wall (towards -Y),
    on the side of the sun of `daylight.daylight`.
    """
    size = high - low
    width, depth = np.maximum(_LEAST[:2], size[:2] + 2 * _AIR)
    height = float(max(_LEAST[2], size[2] + _ABOVE))
    x, y, t = float(width) / 2, float(depth) / 2, _THICK
    across, tall, sill = _WINDOW
    w, top = across / 2, sill + tall
    outer = (-x - t, -y - t, x + t, y + t)
    boxes: dict[str, list[_Box]] = {
        "room_floor": [((*outer[:2], -t), (*outer[2:], 0.0))],
        "room_ceiling": [((*outer[:2], height), (*outer[2:], height + t))],
        "room_wall_north": [((-x - t, y, 0), (x + t, y + t, height))],
        "room_wall_east": [((x, -y, 0), (x + t, y, height))],
        "room_wall_west": [((-x - t, -y, 0), (-x, y, height))],
        "room_wall_south": [
            ((-x - t, -y - t, 0), (-w, -y, height)),
            ((w, -y - t, 0), (x + t, -y, height)),
            ((-w, -y - t, 0), (w, -y, sill)),
            ((-w, -y - t, top), (w, -y, height)),
        ],
    }
    side, thin, lumens, kelvin = _LAMP
    lamp: list[_Box] = [
        ((-side / 2, -side / 2, height - thin), (side / 2, side / 2, height - 0.001))
    ]
    colors = {"room_floor": _FLOOR, "room_ceiling": _CEILING}
    shapes = [
        Shape(name, name, _box_mesh(parts), _matt(colors.get(name, _WALL), name))
        for name, parts in boxes.items()
    ]
    shapes.append(Shape("room_lamp", "room_lamp", _box_mesh(lamp), _matt(_CEILING, "room_lamp")))
    radiance = lamp_radiance(lumens, side * side + 4 * side * thin, kelvin)
    move = np.eye(4)
    move[:3, 3] = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    area = {"room_lamp": plugin("emitter", "area", radiance=radiance)}
    return Showroom(shapes, area, _views(x, y, float(size[2])), move)


def _views(x: float, y: float, height: float) -> list[Camera]:
    """Views from near the corners of a room from -x to x and -y to y, towards the object."""
    views = []
    for name, east, north in (("ne", 1, 1), ("nw", -1, 1), ("sw", -1, -1), ("se", 1, -1)):
        eye = np.array([east * (x - _CORNER), north * (y - _CORNER), _EYE])
        target = np.array([0.0, 0.0, min(0.5 * height, _EYE)])
        pose = look_at(eye, target, np.array([0.0, 0, 1]))
        views.append(Camera(f"corner-{name}", pose, _HALF_FOV, 640, 480))
    return views


def _box_mesh(parts: list[_Box]) -> Mesh:
    """One mesh of several boxes."""
    vertices, faces, count = [], [], 0
    unit = cube()
    for low, high in parts:
        middle, half = 0.5 * (np.array(low) + high), 0.5 * (np.array(high) - low)
        vertices.append(unit.vertices * half + middle)
        faces.append(unit.faces + count)
        count += len(unit.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def _matt(color: Color, name: str) -> Surface:
    matt = plugin("bsdf", "diffuse", reflectance=color)
    return Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name=name)
