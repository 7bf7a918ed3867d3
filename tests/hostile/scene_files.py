"""Hostile scene files: homes, Mitsuba scenes, models and the images that they name."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from tests.fixtures import mitsuba_files as mitsuba
from tests.fixtures import model_file as models
from tests.fixtures import sweethome as draw
from tests.fixtures.gltf import Builder, square
from tests.fixtures.java import serialised
from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.mutations import (
    LONG,
    damaged_bytes,
    damaged_json,
    damaged_text,
    deep,
)
from tests.scenes.sweethome.test_java_home import a_home

HOME, XML, OBJ = (
    "import home.sh3d --out out",
    "import scene.xml --out out",
    "import a.obj --out out --scale 1",
)
TEXTURE = "<texture attribute='floorTexture' name='t' width='10' height='10' image='t'/>"
MTL = "newmtl red\nKd 0.8 0.1 0.1\nNs 30\nd 0.9\nillum 2\nmap_Kd -s 1 1 1 t.png\n"
_LARGEST = 64 * 2**20  # bytes of a member that is packed


def _packed(folder: Path, compression: int = zipfile.ZIP_DEFLATED) -> None:
    """Pack what lies in `members` as a home."""
    with zipfile.ZipFile(folder / "home.sh3d", "w", compression) as archive:
        for path in sorted((folder / "members").rglob("*")):
            if path.is_file() and path.stat().st_size < _LARGEST:
                archive.write(path, path.relative_to(folder / "members"))


def _members(folder: Path, xml: str | bytes, **members: str | bytes) -> None:
    (folder / "members").mkdir(exist_ok=True)
    for name, data in {"Home.xml": xml, **members}.items():
        raw = data.encode() if isinstance(data, str) else data
        (folder / "members" / name).write_bytes(raw)


def _home(folder: Path) -> None:
    body = (
        draw.room(50, 50, 100, 100, TEXTURE)
        + draw.piece(model="box", x=200, y=150)
        + draw.window(x=200, y=0)
        + draw.lamp(x=100, y=100)
        + "<label text='a' x='1' y='1'/><level id='l' name='n' elevation='0' height='250' "
        "floorThickness='12' elevationIndex='0'/>"
    )
    _members(folder, draw.usual(body), box=draw.BOX, t=draw.quadrants())
    _packed(folder)


def _zip_made(xml: str | bytes, **members: str | bytes) -> Made:
    def write(folder: Path) -> Arguments:
        draw.pack(folder / "home.sh3d", xml, dict(members))
        return HOME.split()

    return write


def _archive(compression: int, damage: slice, value: bytes) -> Made:
    """A home packed in another way, with damage to its bytes."""

    def write(folder: Path) -> Arguments:
        _packed(folder, compression)
        data = bytearray((folder / "home.sh3d").read_bytes())
        data[damage] = value
        (folder / "home.sh3d").write_bytes(data)
        return HOME.split()

    return write


def _entities(kind: str) -> str:
    bomb = "".join(
        f"<!ENTITY {b} '{f'&{a};' * 12}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    inside = {
        "bomb": f"<!ENTITY a 'aaaaaaaaaaaa'>{bomb}",
        "file": "<!ENTITY i SYSTEM '/etc/passwd'>",
        "net": "<!ENTITY i SYSTEM 'http://127.0.0.1:1/x'>",
        "zero": "<!ENTITY i SYSTEM '/dev/zero'>",
    }[kind]
    return f"<!DOCTYPE x [{inside}]>"


HOMES_MADE = (
    *(
        _zip_made(draw.home("&i;").replace("<home", _entities(kind) + "<home"))
        for kind in ("bomb", "file", "net", "zero")
    ),
    _zip_made("<a>" * 100_000 + "</a>" * 100_000),
    _zip_made(draw.home("<furnitureGroup>" * 3000 + "</furnitureGroup>" * 3000)),
    _zip_made(draw.usual(draw.room(0, 0, 1, 1).replace("0", "9" * 400))),
    _zip_made(draw.usual(draw.piece(width=LONG, x=1e308, y=-1e308))),
    _zip_made(draw.usual("".join(draw.window(x=n, y=0, width=1) for n in range(2000)))),
    _zip_made(draw.usual("".join(draw.piece(name="\u202e" * 50, x=n) for n in range(1000)))),
    _zip_made(draw.usual(draw.room(0, 0, 1e300, 1e300))),
    _zip_made(draw.usual(draw.piece(model="../../outside", x=100, y=100))),
    _zip_made(draw.usual(draw.piece(model="box", x=100, y=100)), box="v 1\nf 1 1 1\n"),
    _zip_made(draw.usual(), **{"../../../evil": "x"}),
    _zip_made(draw.usual(), **{"/tmp/evil": "x"}),
    _zip_made(b"\xff\xfe" + draw.usual().encode("utf-16-le")),
    _zip_made(b"\0" * 1000),
    _zip_made(draw.usual(version=LONG)),
)


def _java(folder: Path) -> None:
    (folder / "members").mkdir()
    (folder / "members" / "Home").write_bytes(serialised(a_home()))
    (folder / "members" / "1").mkdir()
    (folder / "members" / "1" / "box.obj").write_text(draw.BOX)
    _packed(folder)


def _xml(folder: Path) -> None:
    bsdf = (
        '<bsdf type="roughconductor"><float name="alpha" value="0.2"/>'
        '<string name="material" value="Cu"/></bsdf>'
    )
    extra = (
        '<texture type="bitmap" id="tex"><string name="filename" value="t.png"/></texture>'
        '<bsdf type="diffuse" id="m"><ref name="reflectance" id="tex"/></bsdf>'
        '<shape type="obj" id="o"><string name="filename" value="a.obj"/><ref id="m"/></shape>'
        '<shape type="ply" id="p"><string name="filename" value="m.ply"/></shape>'
        '<shape type="serialized" id="s"><string name="filename" value="m.serialized"/>'
        '<integer name="shapeIndex" value="0"/></shape>'
        '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    )
    mitsuba.write(folder, mitsuba.usual(extra, bsdf=bsdf))
    _obj(folder)
    (folder / "m.ply").write_bytes(_ply_bytes())
    (folder / "t.ply").write_text(mitsuba.ply([[1, 1, -1], [2, 1, -1], [1, 1, -2]], [[0, 1, 2]]))
    (folder / "m.serialized").write_bytes(_serialized_bytes())
    import OpenEXR

    pixels = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    with OpenEXR.File({}, {"RGB": pixels}) as file:
        file.write(str(folder / "sky.exr"))
    (folder / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([9, 9, 9, 128]) * 32
    )


def _ply_bytes(count: str = "uchar", points: int = 3) -> bytes:
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        f"property list {count} int vertex_indices\nend_header\n"
    )
    corners = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]], dtype="<f4").tobytes()
    return head.encode() + corners + struct.pack("<Biii", 3, 0, 1, 2)


def _serialized_bytes() -> bytes:
    points = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]], dtype="<f4").tobytes()
    body = struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", 3, 1) + points
    body += struct.pack("<III", 0, 1, 2)
    return struct.pack("<HH", 0x041C, 4) + zlib.compress(body) + struct.pack("<QI", 0, 1)


def _xml_made(body: str, version: str = "3.0.0", head: str = "") -> Made:
    def write(folder: Path) -> Arguments:
        mitsuba.write(folder, body, version, head)
        return XML.split()

    return write


def _with_file(name: str, data: bytes | str, command: str) -> Made:
    """One file of the base is another."""

    def write(folder: Path) -> Arguments:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8", "surrogatepass"))
        return command.split()

    return write


def _with_link(name: str, target: str, command: str) -> Made:
    def write(folder: Path) -> Arguments:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(target)
        return command.split()

    return write


def _usual(extra: str) -> Made:
    return _xml_made(mitsuba.usual(extra), "0.6.0")


XML_MADE = (
    *(_xml_made("&i;", head=_entities(kind)) for kind in ("bomb", "file", "net", "zero")),
    _xml_made("<shape>" * 50_000),
    _xml_made("<bsdf type='twosided'>" * 3000 + "</bsdf>" * 3000),
    _xml_made("", version=LONG),
    _xml_made("<include filename='scene.xml'/>"),
    _xml_made("<include filename='/etc/passwd'/>"),
    _xml_made("<include filename='/dev/zero'/>"),
    _xml_made("<default name='a' value='$b'/><default name='b' value='$a'/>" + "$a"),
    _xml_made("<path value='../../..'/>"),
    _usual("<ref id='nothing'/>"),
    _usual("<bsdf type='diffuse' id='x'><ref id='x'/></bsdf>"),
    _usual("<shape type='sphere' id='&#0;'/>"),
    _usual("<shape type='sphere'><float name='radius' value='1e308'/></shape>"),
    _usual("<shape type='sphere'><float name='radius' value='nan'/></shape>"),
    _usual(f"<shape type='sphere'><float name='radius' value='{LONG}'/></shape>"),
    _usual("<shape type='obj'><string name='filename' value='/dev/zero'/></shape>"),
    _usual("<shape type='obj'><string name='filename' value='../../../outside.obj'/></shape>"),
    _usual("<shape type='python'><string name='code' value='import os'/></shape>"),
    _usual("<integrator type='path'><integer name='maxDepth' value='" + LONG + "'/></integrator>"),
    _usual("<emitter type='sunsky'><integer name='hour' value='-99999'/></emitter>"),
    _usual("<shape type='sphere'><transform name='toWorld'><scale value='0'/></transform></shape>"),
    _usual(
        "<shape type='sphere'><transform name='toWorld'><matrix value='1 2'/></transform></shape>"
    ),
    _usual(
        "<shape type='sphere'><transform name='toWorld'><translate x='1e300'/></transform></shape>"
    ),
    _usual("".join(f"<shape type='sphere' id='s{n}'/>" for n in range(200))),
    _usual("<shape type='hair'><string name='filename' value='t.png'/></shape>"),
    _usual("<shape type='sphere' id='a'/><shape type='sphere' id='a'/>"),
    _usual("<spectrum name='radiance' value='400:nan, 700:inf'/>"),
    _usual(
        "<bsdf type='roughplastic'><spectrum name='diffuseReflectance' filename='t.png'/></bsdf>"
    ),
    _usual(
        "<shape type='sphere'><bsdf type='conductor'><spectrum name='eta' value='-5'/></bsdf>"
        "</shape>"
    ),
)


def _ply_head(text: str, data: bytes = b"") -> Made:
    return _with_file("m.ply", text.encode() + data, XML)


_VERTICES = "property float x\nproperty float y\nproperty float z\n"
MESHES_MADE = (
    _ply_head(f"ply\nformat ascii 1.0\nelement vertex {LONG}\n{_VERTICES}end_header\n"),
    _ply_head(f"ply\nformat ascii 1.0\nelement vertex 999999999999\n{_VERTICES}end_header\n"),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\n{_VERTICES}end_header\n",
        b"\0" * 100,
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{_VERTICES}element face 1\n"
        "property int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0\n"
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{_VERTICES}element face 1\n"
        "property list double int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n1e308 0\n"
    ),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{_VERTICES}"
        "element face 1\nproperty list double int vertex_indices\nend_header\n",
        struct.pack("<d", 1e308),
    ),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{_VERTICES}"
        "element face 1\nproperty list float int vertex_indices\nend_header\n",
        struct.pack("<f", float("nan")),
    ),
    _ply_head(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y"
        "\nproperty float z\nend_header\n1 0 0 0\n"
    ),
    _ply_head("ply\nformat ascii 1.0\n" + "element vertex 0\n" * 50_000 + "end_header\n"),
    _ply_head("ply\n" + "comment x\n" * 100_000),
    _ply_head("ply\nformat binary_big_endian 1.0\nend_header\n"),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{_VERTICES}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{_VERTICES}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "nan 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"
    ),
    _with_file("m.serialized", struct.pack("<HH", 0x041C, 4) + zlib.compress(bytes(10**8)), XML),
    _with_file("m.serialized", b"\x1c\x04\x04\x00" + struct.pack("<QI", 2**63, 2**32 - 1), XML),
    _with_file(
        "m.serialized",
        struct.pack("<HH", 0x041C, 4)
        + zlib.compress(struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", 2**62, 2**62))
        + struct.pack("<QI", 0, 1),
        XML,
    ),
)


def _obj(folder: Path) -> None:
    (folder / "a.mtl").write_text(MTL)
    (folder / "t.png").write_bytes(draw.quadrants())
    text = draw.BOX.replace("usemtl amber", "vt 0 0\nvt 1 0\nvn 0 0 1\no box\ns 1\nusemtl red")
    (folder / "a.obj").write_text("mtllib a.mtl\n" + text + "f 1/1/1 2/2/1 3/1/1\n#  \n")


def _obj_made(text: str) -> Made:
    return _with_file("a.obj", text, OBJ)


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
    _with_file("a.mtl", f"newmtl red\nKd {LONG} nan -1\nNs 1e308\nd nan\nTr inf\nNi -1\n", OBJ),
    _with_file("a.mtl", "newmtl red\nmap_Kd /dev/zero\nbump ../../../x\nrefl -type sphere\n", OBJ),
    _with_file("a.mtl", "newmtl red\nKd spectral a.rfl\nKe xyz 1 2 3\nmap_Kd -mm\n", OBJ),
    _with_file("a.mtl", "newmtl \nnewmtl red\nKd\nKs 1\nillum 99\n", OBJ),
    _with_link("a.mtl", "a.mtl", OBJ),
    _with_link("a.obj", "a.obj", OBJ),
    _with_link("t.png", "/dev/zero", OBJ),
    _with_link("t.png", "../../../../../outside.png", OBJ),
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


def _gltf(folder: Path) -> None:
    _gltf_builder().save(folder / "a.gltf")
    made = _gltf_builder()
    made.save(folder / "a.glb")
    content = json.loads((folder / "a.gltf").read_text())
    (folder / "a.bin").write_bytes(made.data)
    content["buffers"][0]["uri"] = "a.bin"
    (folder / "b.gltf").write_text(json.dumps(content))


GLTF, GLB = "import a.gltf --out out --scale 1", "import a.glb --out out --scale 1"


def _gltf_made(change: Callable[[Builder], object], suffix: str = "gltf") -> Made:
    def write(folder: Path) -> Arguments:
        made = _gltf_builder()
        change(made)
        made.save(folder / f"a.{suffix}")
        return f"import a.{suffix} --out out --scale 1".split()

    return write


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
    _with_file("a.gltf", deep(), GLTF),
    _with_file("a.gltf", '{"asset": ' * 50_000, GLTF),
    _with_file("a.gltf", f'{{"asset": {{"version": {LONG}}}}}', GLTF),
    _with_file("a.gltf", '{"asset": {"version": "2.0"}, "scene": NaN}', GLTF),
    _with_file("a.glb", b"glTF" + struct.pack("<II", 2, 2**32 - 1) + b"\xff" * 8, GLB),
    _with_file("a.glb", b"glTF" + struct.pack("<IIII", 2, 20, 2**31, 0x4E4F534A), GLB),
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


def _parts(folder: Path) -> None:
    """A home whose pieces are COLLADA, 3DS, zipped and KMZ models."""
    names = ("a.dae", "b.3ds", "c.kmz", "d.zip")
    body = "".join(
        draw.piece(model=name, x=80 + 80 * n, y=150, width=40, depth=40)
        for n, name in enumerate(names)
    )
    textured = models.dae(
        geometries=models.box(uv=True),
        materials=models.effect("red", models.TEXTURED, models.SAMPLER),
        libraries="<library_images><image id='img'><init_from>t.png</init_from></image>"
        "</library_images>",
    )
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("x/box.obj", draw.BOX)
    _members(
        folder,
        draw.usual(body),
        **{
            "a.dae": textured,
            "b.3ds": models.file_3ds(nodes=(models.node_3ds("box"),)),
            "c.kmz": models.kmz(models.dae(), {"t.png": draw.quadrants()}),
            "d.zip": inner.getvalue(),
            "t.png": draw.quadrants(),
        },
    )
    _packed(folder)


def _part(name: str, data: str | bytes) -> Made:
    def write(folder: Path) -> Arguments:
        raw = data.encode() if isinstance(data, str) else data
        (folder / "members" / name).write_bytes(raw)
        _packed(folder)
        return HOME.split()

    return write


PARTS_MADE = (
    _part("a.dae", models.dae(head="<?xml version='1.0'?>" + _entities("bomb"))),
    _part("a.dae", models.dae(head="<?xml version='1.0'?>" + _entities("file"))),
    _part("a.dae", models.dae(meter=float("nan"))),
    _part("a.dae", models.dae(nodes="<node>" * 3000 + models.instance() + "</node>" * 3000)),
    _part("a.dae", models.dae(nodes="<node id='n'><instance_node url='#n'/></node>")),
    _part("a.dae", models.dae(nodes="<node><matrix>1 2 3</matrix></node>")),
    _part("b.3ds", models.chunk(0x4D4D, struct.pack("<HI", 0x3D3D, 2**32 - 1))),
    _part("b.3ds", models.chunk(0x4D4D, models.chunk(0x3D3D, struct.pack("<HI", 0x4000, 0)))),
    _part("b.3ds", b"MM" * 5000),
    _part("d.zip", b"PK\x03\x04" + bytes(50)),
)


def _picture(kind: str, **options: object) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (16, 16), "red").save(stream, kind, **options)
    return stream.getvalue()


def _png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = chunk(b"IDAT", zlib.compress(bytes(100)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + data + chunk(b"IEND", b"")


_EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(evil) (w) file\n{} loop\nshowpage\n"
_IMAGES = {
    "eps": _EPS,
    "dds": _picture("DDS"),
    "ico": _picture("ICO"),
    "pdf": _picture("PDF"),
    "jpeg2000": b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(60),
    "svg": b"<svg xmlns='http://www.w3.org/2000/svg'><image href='/etc/passwd'/></svg>",
    "huge": _png(2**31 - 1, 2**31 - 1),
    "wide": _png(100_000_000, 1),
    "large": _png(40_000, 40_000),
    "none": _png(0, 0),
    "tiff": _picture("TIFF"),
    "gif": _picture("GIF"),
    "tga": _picture("TGA"),
    "ppm": b"P6 99999999 99999999 255\n",
    "ppm deep": b"P5 4 4 99999\n" + bytes(40),
    "hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999999 +X 99999999\n",
    "exr": b"\x76\x2f\x31\x01\x02\0\0\0" + b"\xff" * 200,
    "webp": _picture("WEBP"),
    "bmp": b"BM"
    + struct.pack("<IIIIiiHHIIIIII", 99, 0, 54, 40, -(2**31), -1, 1, 32, 0, 0, 0, 0, 0, 0),
}
IMAGES_MADE = (
    *(_with_file("t.png", data, OBJ) for data in _IMAGES.values()),
    *(_with_file("t.png", _IMAGES[name], XML) for name in ("eps", "dds", "large", "hdr", "exr")),
    *(_with_file("sky.exr", data, XML) for data in _IMAGES.values()),
    _with_link("t.png", "t.png", XML),
    _with_link("sky.exr", "/dev/zero", XML),
)


def _images(folder: Path) -> None:
    _xml(folder)
    for name, kind in {
        "j.jpg": "JPEG",
        "g.gif": "GIF",
        "f.tif": "TIFF",
        "w.webp": "WEBP",
        "b.bmp": "BMP",
        "a.tga": "TGA",
    }.items():
        (folder / name).write_bytes(_picture(kind))
        (folder / f"{name}.mtl").write_text(MTL.replace("t.png", name))
        text = (folder / "a.obj").read_text().replace("a.mtl", f"{name}.mtl")
        (folder / f"{name}.obj").write_text(text)
    text = (folder / "scene.xml").read_text()
    (folder / "hdr.xml").write_text(text.replace("sky.exr", "sky.hdr"))


SCENES = (
    Family(
        "homes",
        200,
        _home,
        (
            Victim("members/Home.xml", damaged_text, (HOME,)),
            Victim("members/Home.xml", damaged_text, (HOME, HOME + " --time 21:30")),
            Victim("members/box", damaged_text, (HOME,)),
            Victim("members/t", damaged_bytes, (HOME,)),
        ),
        HOMES_MADE,
        _packed,
    ),
    Family(
        "archives",
        120,
        _home,
        (Victim("home.sh3d", damaged_bytes, (HOME,)),),
        (
            *(
                _archive(kind, slice(60, 90), bytes(30))
                for kind in (
                    zipfile.ZIP_STORED,
                    zipfile.ZIP_DEFLATED,
                    zipfile.ZIP_BZIP2,
                    zipfile.ZIP_LZMA,
                )
            ),
            *(
                _archive(kind, slice(46, 52), b"\xff" * 6)
                for kind in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
            ),
            _archive(zipfile.ZIP_LZMA, slice(42, 47), b"\0" * 5),
            _with_link("home.sh3d", "home.sh3d", HOME),
            _with_link("home.sh3d", "/dev/zero", HOME),
        ),
    ),
    Family(
        "java homes", 100, _java, (Victim("members/Home", damaged_bytes, (HOME,)),), (), _packed
    ),
    Family(
        "model parts",
        120,
        _parts,
        (
            Victim("members/a.dae", damaged_text, (HOME,)),
            Victim("members/b.3ds", damaged_bytes, (HOME,)),
            Victim("members/c.kmz", damaged_bytes, (HOME,)),
            Victim("members/d.zip", damaged_bytes, (HOME,)),
        ),
        PARTS_MADE,
        _packed,
    ),
    Family(
        "mitsuba xml",
        220,
        _xml,
        (Victim("scene.xml", damaged_text, (XML,)),),
        XML_MADE,
        costly=frozenset((26,)),
    ),
    Family(
        "meshes",
        200,
        _xml,
        (
            Victim("m.ply", damaged_bytes, (XML,)),
            Victim("m.ply", damaged_text, (XML,)),
            Victim("m.serialized", damaged_bytes, (XML,)),
        ),
        MESHES_MADE,
    ),
    Family(
        "obj",
        170,
        _obj,
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
        _gltf,
        (
            Victim("a.gltf", damaged_json, (GLTF,)),
            Victim("b.gltf", damaged_json, (GLTF.replace("a.", "b."),)),
            Victim("a.bin", damaged_bytes, (GLTF.replace("a.", "b."),)),
            Victim("a.gltf", damaged_text, (GLTF,)),
        ),
        GLTF_MADE,
    ),
    Family("glb", 120, _gltf, (Victim("a.glb", damaged_bytes, (GLB,)),)),
    Family(
        "images",
        180,
        _images,
        (
            Victim("t.png", damaged_bytes, (OBJ, XML)),
            Victim("sky.exr", damaged_bytes, (XML,)),
            Victim("sky.hdr", damaged_bytes, ("import hdr.xml --out out",)),
            *(
                Victim(name, damaged_bytes, (f"import {name}.obj --out out --scale 1",))
                for name in ("j.jpg", "g.gif", "f.tif", "w.webp", "b.bmp", "a.tga")
            ),
        ),
        IMAGES_MADE,
    ),
)
