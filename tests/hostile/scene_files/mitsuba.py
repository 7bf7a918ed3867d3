"""Hostile Mitsuba scenes and the PLY and serialised meshes that they name."""

import struct
import zlib
from pathlib import Path

import numpy as np

from tests.fixtures import mitsuba_files as mitsuba
from tests.fixtures.encoded import exr
from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import entities, with_file
from tests.hostile.mutations import LONG, damaged_bytes, damaged_text
from tests.hostile.scene_files.models import write_obj

XML = "import scene.xml --out out"


def write_xml(folder: Path) -> None:
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
    write_obj(folder)
    (folder / "m.ply").write_bytes(ply_bytes())
    (folder / "t.ply").write_text(mitsuba.ply([[1, 1, -1], [2, 1, -1], [1, 1, -2]], [[0, 1, 2]]))
    (folder / "m.serialized").write_bytes(_serialized_bytes())
    pixels = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    (folder / "sky.exr").write_bytes(exr(pixels))
    (folder / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([9, 9, 9, 128]) * 32
    )


def ply_bytes(count: str = "uchar", points: int = 3) -> bytes:
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        f"property list {count} int vertex_indices\nend_header\n"
    )
    corners = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]], dtype="<f4").tobytes()
    return head.encode() + corners + struct.pack("<Biii", 3, 0, 1, 2)


def _serialized_bytes() -> bytes:
    points = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]])
    return mitsuba.serialized([(points, np.array([[0, 1, 2]]))])


def _xml_made(body: str, version: str = "3.0.0", head: str = "") -> Made:
    return with_file("scene.xml", mitsuba.scene_text(body, version, head), XML)


def _usual(extra: str) -> Made:
    return _xml_made(mitsuba.usual(extra), "0.6.0")


XML_MADE = (
    *(_xml_made("&i;", head=entities(kind)) for kind in ("bomb", "file", "net", "zero")),
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
    return with_file("m.ply", text.encode() + data, XML)


PLY_VERTICES = "property float x\nproperty float y\nproperty float z\n"

MESHES_MADE = (
    _ply_head(f"ply\nformat ascii 1.0\nelement vertex {LONG}\n{PLY_VERTICES}end_header\n"),
    _ply_head(f"ply\nformat ascii 1.0\nelement vertex 999999999999\n{PLY_VERTICES}end_header\n"),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\n{PLY_VERTICES}"
        "end_header\n",
        b"\0" * 100,
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{PLY_VERTICES}element face 1\n"
        "property int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0\n"
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{PLY_VERTICES}element face 1\n"
        "property list double int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n1e308 0\n"
    ),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{PLY_VERTICES}"
        "element face 1\nproperty list double int vertex_indices\nend_header\n",
        struct.pack("<d", 1e308),
    ),
    _ply_head(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{PLY_VERTICES}"
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
        f"ply\nformat ascii 1.0\nelement vertex 3\n{PLY_VERTICES}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"
    ),
    _ply_head(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{PLY_VERTICES}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "nan 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"
    ),
    with_file("m.serialized", struct.pack("<HH", 0x041C, 4) + zlib.compress(bytes(10**8)), XML),
    with_file("m.serialized", b"\x1c\x04\x04\x00" + struct.pack("<QI", 2**63, 2**32 - 1), XML),
    with_file(
        "m.serialized",
        struct.pack("<HH", 0x041C, 4)
        + zlib.compress(struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", 2**62, 2**62))
        + struct.pack("<QI", 0, 1),
        XML,
    ),
)


FAMILIES = (
    Family(
        "mitsuba xml",
        220,
        write_xml,
        (Victim("scene.xml", damaged_text, (XML,)),),
        XML_MADE,
        costly=frozenset((26,)),
    ),
    Family(
        "meshes",
        200,
        write_xml,
        (
            Victim("m.ply", damaged_bytes, (XML,)),
            Victim("m.ply", damaged_text, (XML,)),
            Victim("m.serialized", damaged_bytes, (XML,)),
        ),
        MESHES_MADE,
    ),
)
