"""A furniture catalogue drawn by hand: boxes, a table, a shelf, a lamp, a door, and bad pieces."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from pathlib import Path

from PIL import Image

LICENCE = "Under http://creativecommons.org/licenses/by/3.0/us/ as it is"
Span = tuple[tuple[float, float, float], tuple[float, float, float]]


def boxes(spans: Iterable[Span], material: str = "wood", first: int = 1) -> str:
    """An OBJ of boxes given by two corners, in any unit, y up; vertices count from `first`."""
    lines = [f"usemtl {material}"]
    for (x0, y0, z0), (x1, y1, z1) in spans:
        corners = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        for quad in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4),
                     (1, 5, 7, 3)):  # fmt: skip
            lines.append("f " + " ".join(str(first + k) for k in quad))
        first += 8
    return "\n".join(lines) + "\n"


# A table 1.2 x 0.8 x 0.75 m in centimetres: a top 4 cm thick on four legs of 6 cm.
TABLE = boxes(
    [((0, 71, 0), (120, 75, 80))]
    + [((x, 0, z), (x + 6, 71, z + 6)) for x in (0, 114) for z in (0, 74)]
)
# A bookcase 0.8 x 0.3 x 1.6 m: sides, back, and boards with their tops at 0.02, 0.5, 1.0, 1.6 m.
BOOKCASE = boxes(
    [((0, 0, 0), (2, 160, 30)), ((78, 0, 0), (80, 160, 30)), ((0, 0, 0), (80, 160, 1))]
    + [((0, top - 2, 0), (80, top, 30)) for top in (2, 50, 100, 160)]
)
# A box whose front, towards +z, is another material: tells how a piece is turned.
CHAIR = boxes([((0, 0, 0), (45, 90, 50))]) + boxes([((20, 40, 50), (25, 45, 51))], "front", 9)
TEXTURED = """mtllib panel.mtl
v 0 0 0
v 100 0 0
v 100 100 0
v 0 100 0
v 0 0 2
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl cloth
f 1/1 2/2 3/3 4/4
usemtl plain
f 1 2 5
"""
MTL = "newmtl cloth\nKd 0 0 0\nmap_Kd C:\\maps\\Cloth.PNG\nnewmtl plain\nKd 0.5 0.5 0.5\n"
# A lamp: a foot, and an open shade of four walls around the bulb.
LAMP = boxes([((10, 0, 10), (20, 2, 20))]) + boxes(
    [((0, 20, 0), (1, 40, 30)), ((29, 20, 0), (30, 40, 30)),
     ((0, 20, 0), (30, 40, 1)), ((0, 20, 29), (30, 40, 30))], "shade", 9)  # fmt: skip


def png(width: int, height: int, alpha: bool = False) -> bytes:
    """A picture, red on its left half; its right half is transparent if asked for."""
    image = Image.new("RGBA" if alpha else "RGB", (width, height), (20, 40, 60))
    image.paste((200, 30, 30), (0, 0, width // 2, height))
    if alpha:
        image.putalpha(Image.new("L", (width, height), 255))
        image.paste((20, 40, 60, 0), (width // 2, 0, width, height))
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def piece(number: int, name: str, file: str, size: tuple[float, float, float], **more: str) -> str:
    """The properties of one piece; `size` is width, depth, height in centimetres."""
    given = {
        "id": f"Test#{name.replace(' ', '')}",
        "name": name,
        "category": "Living room",
        "model": f"/models/{file}",
        "width": str(size[0]),
        "depth": str(size[1]),
        "height": str(size[2]),
        "movable": "true",
        "doorOrWindow": "false",
        "creator": "J\\u00f6rg Test",
        **more,
    }
    return "\n".join(f"{key}#{number}={value}" for key, value in given.items()) + "\n\n"


def catalogue() -> tuple[str, dict[str, str | bytes]]:
    """Properties and members of a catalogue with eight good pieces."""
    rows = [
        piece(1, "Table", "table.obj", (120, 80, 75)),
        piece(2, "Bookcase", "bookcase.obj", (80, 30, 160), dropOnTopElevation="50"),
        piece(3, "Chair", "chair.obj", (45, 51, 90), dropOnTopElevation="-1"),
        piece(4, "Turned chair", "chair.obj", (51, 45, 90), modelRotation="0 0 1 0 1 0 -1 0 0"),
        piece(5, "Panel", "panel.obj", (100, 2, 100), category="Miscellaneous"),
        piece(
            6,
            "Lamp",
            "lamp.obj",
            (30, 30, 40),
            category="Lights",
            lightSourceX="15",
            lightSourceY="15",
            lightSourceZ="30",
            lightSourceColor="#AA9770",
            lightSourceDiameter="6",
        ),
        piece(
            7,
            "Door",
            "table.obj",
            (90, 20, 210),
            doorOrWindow="true",
            doorOrWindowWallThickness="10",
            doorOrWindowWallDistance="5",
            doorOrWindowSashXAxis="9",
            doorOrWindowSashYAxis="10",
            doorOrWindowSashWidth="72",
            doorOrWindowSashStartAngle="0",
            doorOrWindowSashEndAngle="-90",
        ),
        piece(8, "Zipped chair", "chair.zip", (45, 51, 90)),
    ]
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("chair.obj", CHAIR)
    members: dict[str, str | bytes] = {
        "LICENSE.TXT": LICENCE,
        "models/table.obj": TABLE,
        "models/bookcase.obj": BOOKCASE,
        "models/chair.obj": CHAIR,
        "models/panel.obj": TEXTURED,
        "models/panel.mtl": MTL,
        "models/cloth.png": png(300, 150, alpha=True),
        "models/lamp.obj": LAMP,
        "models/chair.zip": inner.getvalue(),
    }
    head = "id=Test#Library\nname=Test library\nversion=2.1\nprovider=example.org\n\n"
    return head + "".join(rows), members


def pack(path: Path, properties: str, members: dict[str, str | bytes]) -> Path:
    """Write a `.sh3f`."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("PluginFurnitureCatalog.properties", properties.encode("latin-1"))
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def write_catalogue(path: Path, extra: str = "", **members: str | bytes) -> Path:
    """The hand-drawn catalogue, with further rows and members if given."""
    properties, own = catalogue()
    return pack(path, properties + extra, {**own, **members})
