"""Homes for the Sweet Home 3D tests, drawn by hand: a few walls, rooms and plain models."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from PIL import Image

# A box 2 wide, 1 high, 4 deep with a corner at the origin: proportions that cannot be confused.
BOX = """# a box, CC-BY 4.0
v 0 0 0
v 2 0 0
v 2 1 0
v 0 1 0
v 0 0 4
v 2 0 4
v 2 1 4
v 0 1 4
usemtl amber
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 4 8 7 3
f 1 5 8 4
f 2 3 7 6
"""
FULL = "M0,0 v1 h1 v-1 z"


def home(body: str, **attributes: object) -> str:
    """`Home.xml` with `body` inside `<home>`."""
    given = {"version": 7200, "wallHeight": 250.0, "name": "test.sh3d", **attributes}
    text = " ".join(f"{name}='{value}'" for name, value in given.items())
    return f"<?xml version='1.0'?>\n<home {text}>\n{body}\n</home>\n"


def pack(path: Path, xml: str | bytes, members: dict[str, str | bytes] | None = None) -> Path:
    """Write a `.sh3d` with `Home.xml` and other members."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Home.xml", xml)
        for name, data in (members or {}).items():
            archive.writestr(name, data)
    return path


def wall(name: str, start: tuple[float, float], end: tuple[float, float], **more: object) -> str:
    """A `<wall>`, 20 cm thick unless `more` says otherwise."""
    given = {
        "id": name,
        "xStart": start[0],
        "yStart": start[1],
        "xEnd": end[0],
        "yEnd": end[1],
        "thickness": 20,
        "height": 250,
        **more,
    }
    text = " ".join(f"{key}='{value}'" for key, value in given.items() if key != "inside")
    return f"<wall {text}>{more.get('inside', '')}</wall>"


def box_walls(x: float, y: float, width: float, depth: float, tag: str = "", **more: object) -> str:
    """Four joined walls clockwise on the plan; the right side of each is inside."""
    corners = [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]
    names = [f"{side}{tag}" for side in ("north", "east", "south", "west")]
    return "".join(
        wall(
            names[number],
            corners[number],
            corners[(number + 1) % 4],
            wallAtStart=names[number - 1],
            wallAtEnd=names[(number + 1) % 4],
            **more,
        )
        for number in range(4)
    )


def room(x: float, y: float, width: float, depth: float, inside: str = "", **more: object) -> str:
    """A rectangular `<room>`."""
    corners = [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]
    points = "".join(f"<point x='{px}' y='{py}'/>" for px, py in corners)
    text = " ".join(f"{key}='{value}'" for key, value in more.items())
    return f"<room {text}>{inside}{points}</room>"


def piece(kind: str = "pieceOfFurniture", inside: str = "", **more: object) -> str:
    """A piece of furniture, door, window or lamp."""
    given = {"name": "thing", "x": 0, "y": 0, "width": 100, "depth": 50, "height": 80, **more}
    text = " ".join(f"{key}='{value}'" for key, value in given.items())
    return f"<{kind} {text}>{inside}</{kind}>"


def window(**more: object) -> str:
    """A window 1 m wide and high, 0.9 m above the floor, without a model: an open hole."""
    given = {"name": "window", "elevation": 90, "width": 100, "depth": 20, "height": 100,
             "cutOutShape": FULL, **more}  # fmt: skip
    return piece("doorOrWindow", **given)


def lamp(power: float = 0.5, color: str = "00AA9770", **more: object) -> str:
    """A lamp that is nothing but a bulb of 10 cm in the middle of a cube of 20 cm."""
    given = {"name": "bulb", "width": 20, "depth": 20, "height": 20, "power": power, **more}
    source = f"<lightSource x='0.5' y='0.5' z='0.5' color='{color}' diameter='0.5'/>"
    return piece("light", source, **given)


def quadrants() -> bytes:
    """A PNG of four colours: red and green above, blue and white below."""
    image = Image.new("RGB", (64, 64))
    for left, top, color in ((0, 0, "red"), (32, 0, "lime"), (0, 32, "blue"), (32, 32, "white")):
        image.paste(color, (left, top, left + 32, top + 32))
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


# A room of 4 x 3 m inside its walls, from (10, 10) to (410, 310) on the plan.
def usual(extra: str = "", **attributes: object) -> str:
    """A closed room with `extra` in it."""
    return home(box_walls(0, 0, 420, 320) + room(10, 10, 400, 300, name="Room") + extra,
                **attributes)  # fmt: skip
