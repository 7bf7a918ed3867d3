"""Hostile scene folders and places for `pbrnet export-scene`, and files that it did not write."""

import json
import shutil
import struct
from pathlib import Path
from typing import Any

from pbrnet.scenes.contract import Portal
from tests.fixtures.changed import changed
from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link, with_text, with_value
from tests.hostile.mutations import damaged_json, damaged_text
from tests.hostile.project_files.folders import PARTS, write_room

_ROOM = "scenes/room"
GLB, USD, ZIP = (
    f"export-scene {_ROOM} --to {name} --out out.{suffix}"
    for name, suffix in (("glb", "glb"), ("usdz", "usdz"), ("mitsuba", "zip"))
)
BACK = "import room.glb --out back"
_WINDOW = Portal("w", "window", ((-1, 2, 1), (-1, 2, 2), (1, 2, 2), (1, 2, 1)), (0, 1, 0), True,
                 panes=1)  # fmt: skip


def _base(folder: Path) -> None:
    """A scene folder with a window, another light of it, its GLB, and a folder in the way."""
    from pbrnet.pipeline.scene_export.export import export_scene

    write_room(folder, (_WINDOW,))
    (folder / "scenes.glb").mkdir()
    record = json.loads((folder / _ROOM / "scene.json").read_text())
    record |= {"plan": "room", "lighting": "day"}
    (folder / _ROOM / "scene.json").write_text(json.dumps(record))
    shutil.copytree(folder / _ROOM, folder / "scenes/room-v1")
    night = json.dumps({**record, "lighting": "night", "scene_id": "room-v1"})
    (folder / "scenes/room-v1/scene.json").write_text(night)
    export_scene(folder / _ROOM, "glb", folder / "room.glb")


@case
def _document(folder: Path, path: tuple[str | int, ...], value: Any) -> str:
    """The GLB with one value of its JSON changed."""
    data = (folder / "room.glb").read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    document = changed(json.loads(data[20 : 20 + size]), path, value)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = struct.pack("<II", len(text), 0x4E4F534A) + text + data[20 + size :]
    (folder / "room.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(rest)) + rest)
    return BACK


@case
def _removed(folder: Path, name: str, command: str) -> str:
    (folder / name).unlink()
    return command


def _placed(out: str) -> Made:
    """A place for the file that cannot be written."""
    return lambda folder: f"export-scene {_ROOM} --to glb --out {out}".split()


_PROGRAM = b"\x7fELF\x02\x01\x01" + bytes(64)
_NAMES = ("../../x", "a/b", "\x00", "\n\x1b[31m", "con", "x" * 5000, "é\u202e", "")
_FIELDS: tuple[tuple[str | int, ...], ...] = (
    ("scene_id",),
    ("lighting",),
    ("objects", 0, "id"),
    ("objects", 0, "category"),
    ("objects", 0, "shapes", 0),
    ("portals", 0, "id"),
    ("source", "views"),
)
_STATED = ("materials", 0, "extras", "pbrnet")
_VALUES: tuple[Any, ...] = (
    {"bsdf": "roughplastic"}, {"bsdf": "conductor", "eta": [1]}, {"bsdf": "plugin"}, {"bsdf": 7},
    {"bsdf": "conductor", "eta": [1e9] * 3, "k": [0] * 3}, [], "diffuse", {"file": "/etc/passwd"},
)  # fmt: skip

_MADE = (
    *(with_text(f"{_ROOM}/scene.xml", *part, command)
      for part in PARTS.values() for command in (GLB, USD, ZIP)),
    *(
        with_value(f"{_ROOM}/scene.json", command, field, name)
        for field in _FIELDS
        for name in _NAMES
        for command in (GLB, USD)
    ),
    *(with_file(f"{_ROOM}/textures/t.png", _PROGRAM, command) for command in (GLB, USD)),
    *(with_file(f"{_ROOM}/meshes/box.ply", _PROGRAM, command) for command in (GLB, USD)),
    *(_removed(f"{_ROOM}/{name}", command)
      for name in ("textures/t.png", "meshes/box.ply", "scene.json")
      for command in (GLB, USD, ZIP)),
    *(with_text(f"{_ROOM}/meshes/box.ply", "0 0", new, command)
      for new in ("nan nan", "1e39 0", "inf 0", "1e300 0") for command in (GLB, USD)),
    *(with_link(f"{_ROOM}/{name}", target, command)
      for name, target in (("textures/t.png", "/dev/zero"), ("meshes/box.ply", "/etc/passwd"),
                           ("extra", "/etc/passwd"), ("scene.xml", "scene.xml"))
      for command in (GLB, USD, ZIP)),
    *(_placed(out) for out in ("scenes", "scenes.glb", "room.glb/out.glb", "out.exe")),
    *(with_link("out.glb", target, GLB) for target in ("/dev/null", "/dev/full", "out.glb")),
    *(with_file("scenes/room-v1/scene.json", text, USD) for text in ("{", "[]", "null", "")),
    *(with_value("scenes/room-v1/scene.json", USD, ("lighting",), name) for name in _NAMES),
    with_link("scenes/room-v1/textures/t.png", "/dev/zero", USD),
    *(_document(_STATED, value) for value in _VALUES),
    _document(("scenes", 0, "extras", "pbrnet", "scene", "portals", 0, "id"), "../../x"),
    _document(("scenes", 0, "extras", "pbrnet", "scene", "objects", 0, "shapes", 0), "box.leaf"),
)  # fmt: skip

FAMILIES = (
    Family(
        "exported scenes",
        len(_MADE) + 60,
        _base,
        (
            Victim(f"{_ROOM}/scene.xml", damaged_text, (GLB, USD)),
            Victim(f"{_ROOM}/scene.json", damaged_json, (GLB, ZIP)),
            Victim(f"{_ROOM}/meshes/box.ply", damaged_text, (GLB,)),
        ),
        _MADE,
        seconds=1.5,
    ),
)
