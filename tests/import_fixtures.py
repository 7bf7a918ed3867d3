"""Tiny Mitsuba scenes for the import tests, written by hand in the words of each version."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

# A room of 4 x 3 m and 2.6 m height in Y-up axes: x from 0 to 4, z from -3 to 0, floor at y = 0.
# Each side is a rectangle ([-1, 1]^2, facing +z) moved into place so that it faces the room.
_SIDES_Y_UP = {
    "floor": ("2 0 0 2  0 0 1 0  0 -1.5 0 -1.5  0 0 0 1"),
    "ceiling": ("2 0 0 2  0 0 -1 2.6  0 1.5 0 -1.5  0 0 0 1"),
    "north": ("2 0 0 2  0 1.3 0 1.3  0 0 1 -3  0 0 0 1"),
    "south": ("-2 0 0 2  0 1.3 0 1.3  0 0 -1 0  0 0 0 1"),
    "west": ("0 0 1 0  0 1.3 0 1.3  -1.5 0 0 -1.5  0 0 0 1"),
    "east": ("0 0 -1 4  0 1.3 0 1.3  1.5 0 0 -1.5  0 0 0 1"),
}
SENSOR_0_6 = """
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="toWorld">
      <lookAt origin="3.5, 1.5, -0.5" target="1, 1, -2.5" up="0, 1, 0"/>
    </transform>
    <film type="hdrfilm">
      <integer name="width" value="64"/><integer name="height" value="48"/>
    </film>
  </sensor>"""
LAMP_0_6 = """
  <shape type="sphere" id="lamp">
    <point name="center" x="2" y="2.2" z="-1.5"/><float name="radius" value="0.1"/>
    <emitter type="area"><spectrum name="radiance" value="30"/></emitter>
  </shape>"""


def room(without: tuple[str, ...] = (), bsdf: str = "", scale: float = 1.0) -> str:
    """The room's shapes in version 0.x, Y up; `scale` multiplies all lengths."""
    shapes = []
    for name, matrix in _SIDES_Y_UP.items():
        if name in without:
            continue
        shapes.append(
            f'<shape type="rectangle" id="{name}"><transform name="toWorld">'
            f'<matrix value="{matrix}"/><scale value="{scale}"/></transform>{bsdf}</shape>'
        )
    return "\n".join(shapes)


def wall_with_hole(
    low: tuple[float, float] = (1.5, 0.9), high: tuple[float, float] = (2.5, 2.0)
) -> str:
    """The north wall (z = -3) in four pieces around a window from `low` to `high` in (x, y)."""
    pieces = {
        "north_left": (0.0, 0.0, low[0], 2.6),
        "north_right": (high[0], 0.0, 4.0, 2.6),
        "north_below": (low[0], 0.0, high[0], low[1]),
        "north_above": (low[0], high[1], high[0], 2.6),
    }
    return "\n".join(
        f'<shape type="rectangle" id="{name}"><transform name="toWorld">'
        f'<scale x="{(x1 - x0) / 2}" y="{(y1 - y0) / 2}"/>'
        f'<translate x="{(x0 + x1) / 2}" y="{(y0 + y1) / 2}" z="-3"/></transform></shape>'
        for name, (x0, y0, x1, y1) in pieces.items()
        if x1 > x0 and y1 > y0
    )


def write(
    folder: Path, body: str, version: str = "0.6.0", head: str = "", name: str = "scene.xml"
) -> Path:
    """Write a scene file with `body` inside `<scene>`."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(
        f'<?xml version="1.0" encoding="utf-8"?>\n{head}<scene version="{version}">\n{body}\n'
        "</scene>\n",
        encoding="utf-8",
    )
    return path


def usual(extra: str = "", **options: object) -> str:
    """A closed 0.6 room with camera and lamp, and `extra` in it."""
    return SENSOR_0_6 + LAMP_0_6 + room(**options) + extra  # type: ignore[arg-type]


def ply(vertices: npt.ArrayLike, faces: list[list[int]]) -> str:
    """An ASCII PLY."""
    points = np.asarray(vertices, dtype=float)
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(repr, map(float, point))) for point in points]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join(lines) + "\n"
