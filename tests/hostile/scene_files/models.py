"""Hostile OBJ and glTF models."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.fixtures import sweethome as draw
from tests.fixtures.gltf import Builder, square
from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_json, damaged_text, deep

OBJ = "import a.obj --out out --scale 1"

MTL = "newmtl red\nKd 0.8 0.1 0.1\nNs 30\nd 0.9\nillum 2\nmap_Kd -s 1 1 1 t.png\n"


def write_obj(folder: Path) -> None:
    (folder / "a.mtl").write_text(MTL)
    (folder / "t.png").write_bytes(draw.quadrants())
    text = draw.BOX.replace("usemtl amber", "vt 0 0\nvt 1 0\nvn 0 0 1\no box\ns 1\nusemtl red")
    (folder / "a.obj").write_text("mtllib a.mtl\n" + text + "f 1/1/1 2/2/1 3/1/1\n#  \n")


def _obj_made(text: str) -> Made:
    return with_file("a.obj", text, OBJ)


OBJ_MADE = (
    _obj_made("v 1\nv 1 2\nv\nf 1 2 3\n"),
    _obj_made("v 1 2 3\n" * 3 + "f 1\nf 1 2\nf\n"),
    _obj_made("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n"),
    _obj_made("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -9\nf 0 0 0\n"),
    _obj_made(f"v {LONG} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    _obj_made("v nan inf -inf\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    _obj_made("v 1e308 0 0\nv -1e308 0 0\nv 0 1e308 0\nf 1 2 3\n"),
    _obj_made("v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 100_000 + "\n"),
    _obj_made("mtllib /dev/zero\nmtllib ../../../x.mtl\n" + draw.BOX),
    _obj_made("mtllib a.mtl " * 20_000 + "\n" + draw.BOX),
    _obj_made(draw.BOX + "usemtl " + "x" * 10**6 + "\nf 1 2 3\n"),
    _obj_made("v 0 0 0\\\n" * 100_000),
    _obj_made("call evil.obj\ncsh rm -rf /\n" + draw.BOX),
    _obj_made("\ufeff" + draw.BOX.replace("\n", "\r")),
    with_file("a.mtl", f"newmtl red\nKd {LONG} nan -1\nNs 1e308\nd nan\nTr inf\nNi -1\n", OBJ),
    with_file("a.mtl", "newmtl red\nmap_Kd /dev/zero\nbump ../../../x\nrefl -type sphere\n", OBJ),
    with_file("a.mtl", "newmtl red\nKd spectral a.rfl\nKe xyz 1 2 3\nmap_Kd -mm\n", OBJ),
    with_file("a.mtl", "newmtl \nnewmtl red\nKd\nKs 1\nillum 99\n", OBJ),
    with_link("a.mtl", "a.mtl", OBJ),
    with_link("a.obj", "a.obj", OBJ),
    with_link("t.png", "/dev/zero", OBJ),
    with_link("t.png", "../../../../../outside.png", OBJ),
)


def _gltf_builder() -> Builder:
    made = square(
        pbrMetallicRoughness={
            "baseColorFactor": [1, 0.5, 0.2, 1],
            "roughnessFactor": 0.4,
            "baseColorTexture": {"index": 0},
        },
        emissiveFactor=[0, 0, 0],
        alphaMode="MASK",
        alphaCutoff=0.4,
        extensions={"KHR_materials_transmission": {"transmissionFactor": 0.1}},
    )
    made.texture(np.full((8, 8, 3), 120, np.uint8), wrapS=33071)
    child = made.node(root=False, mesh=0, name="chair", translation=[1, 0, 1], scale=[0.1, 0.1, 1])
    made.node(children=[child], rotation=[0, 0, 0, 1], name="group")
    made.node(root=True, camera=0, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 3, 1])
    made.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})
    made.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_transmission"]
    made.json["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5}]}
    }
    made.node(extensions={"KHR_lights_punctual": {"light": 0}}, translation=[0, 2, 0])
    return made


def write_gltf(folder: Path) -> None:
    _gltf_builder().save(folder / "a.gltf")
    made = _gltf_builder()
    made.save(folder / "a.glb")
    content = json.loads((folder / "a.gltf").read_text())
    (folder / "a.bin").write_bytes(made.data)
    content["buffers"][0]["uri"] = "a.bin"
    (folder / "b.gltf").write_text(json.dumps(content))


GLTF, GLB = "import a.gltf --out out --scale 1", "import a.glb --out out --scale 1"


@case
def _gltf_made(folder: Path, change: Callable[[Builder], object], suffix: str = "gltf") -> str:
    made = _gltf_builder()
    change(made)
    made.save(folder / f"a.{suffix}")
    return f"import a.{suffix} --out out --scale 1"


def _set(*path: str | int, value: object) -> Callable[[Builder], object]:
    def change(made: Builder) -> None:
        place = made.json
        for key in path[:-1]:
            place = place[key]  # type: ignore[index]
        place[path[-1]] = value  # type: ignore[index]

    return change


def _chain(length: int) -> Callable[[Builder], object]:
    def change(made: Builder) -> None:
        first = len(made.json["nodes"])
        made.json["nodes"] += [{"children": [first + n + 1]} for n in range(length)] + [{"mesh": 0}]
        made.json["scenes"][0]["nodes"].append(first)

    return change


def _doubled(depth: int) -> Callable[[Builder], object]:
    """Nodes that name the next one twice: 2^depth instances."""

    def change(made: Builder) -> None:
        first = len(made.json["nodes"])
        made.json["nodes"] += [{"children": [first + n + 1] * 2} for n in range(depth)]
        made.json["nodes"].append({"mesh": 0})
        made.json["scenes"][0]["nodes"].append(first)

    return change


GLTF_MADE = (
    with_file("a.gltf", deep(), GLTF),
    with_file("a.gltf", '{"asset": ' * 50_000, GLTF),
    with_file("a.gltf", f'{{"asset": {{"version": {LONG}}}}}', GLTF),
    with_file("a.gltf", '{"asset": {"version": "2.0"}, "scene": NaN}', GLTF),
    with_file("a.glb", b"glTF" + struct.pack("<II", 2, 2**32 - 1) + b"\xff" * 8, GLB),
    with_file("a.glb", b"glTF" + struct.pack("<IIII", 2, 20, 2**31, 0x4E4F534A), GLB),
    *(
        _gltf_made(_set(*path, value=value))
        for path in (
            ("asset", "version"),
            ("nodes", 0, "name"),
            ("materials", 0, "name"),
            ("materials", 0, "alphaMode"),
            ("images", 0, "mimeType"),
            ("accessors", 0, "type"),
            ("extensionsUsed",),
            ("extensionsRequired",),
        )
        for value in ([], {}, ["x", []], 5)
    ),
    *(
        _gltf_made(_set("nodes", 1, "translation", value=[value, 0, 0]))
        for value in (1e30, 1e300, 10**400, True, "x", None)
    ),
    *(
        _gltf_made(_set("accessors", 0, "count", value=value))
        for value in (0, -1, 2**31, 10**400, 1.5, "4", None, [])
    ),
    _gltf_made(_set("nodes", 0, "name", value="\ud800\udfff" * 3)),
    _gltf_made(_set("materials", 0, "name", value="\ud800")),
    _gltf_made(_set("nodes", 0, "name", value="../../../x")),
    _gltf_made(_set("buffers", value=[{"uri": "../../../x.bin", "byteLength": 4}])),
    _gltf_made(_set("buffers", value=[{"uri": "/dev/zero", "byteLength": 4}])),
    _gltf_made(_set("buffers", value=[{"uri": "file:///etc/passwd", "byteLength": 4}])),
    _gltf_made(_set("buffers", value=[{"uri": "data:;base64,%%%%", "byteLength": 4}])),
    _gltf_made(_set("images", 0, value={"uri": "http://127.0.0.1:1/x.png"})),
    _gltf_made(_set("images", 0, value={"uri": "%2e%2e/%2e%2e/x.png"})),
    _gltf_made(_set("nodes", 1, "children", value=[1, 2])),
    _gltf_made(_set("scenes", 0, "nodes", value=[0] * 100_000)),
    _gltf_made(_set("extensionsRequired", value=["KHR_draco_mesh_compression"])),
    _gltf_made(_set("accessors", 0, "sparse", value={"count": 9, "indices": {}, "values": {}})),
    _gltf_made(_chain(3000)),
    _gltf_made(_chain(99_000)),
    _gltf_made(_doubled(40)),
    _gltf_made(_set("nodes", 0, "matrix", value=[1e30] * 16)),
    _gltf_made(_set("nodes", 0, "matrix", value=[0] * 16), "glb"),
    _gltf_made(_set("materials", 0, "pbrMetallicRoughness", value=[1]), "glb"),
)


FAMILIES = (
    Family(
        "obj",
        170,
        write_obj,
        (
            Victim("a.obj", damaged_text, (OBJ, OBJ + " --up z")),
            Victim("a.mtl", damaged_text, (OBJ,)),
        ),
        OBJ_MADE,
        costly=frozenset((7,)),
    ),
    Family(
        "gltf",
        260,
        write_gltf,
        (
            Victim("a.gltf", damaged_json, (GLTF,)),
            Victim("b.gltf", damaged_json, (GLTF.replace("a.", "b."),)),
            Victim("a.bin", damaged_bytes, (GLTF.replace("a.", "b."),)),
            Victim("a.gltf", damaged_text, (GLTF,)),
        ),
        GLTF_MADE,
    ),
    Family("glb", 120, write_gltf, (Victim("a.glb", damaged_bytes, (GLB,)),)),
)
