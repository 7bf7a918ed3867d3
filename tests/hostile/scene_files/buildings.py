"""Hostile COLLADA, 3DS, USD and IFC files; those of optional libraries only where these are."""

import os
import struct
import zipfile
from importlib.util import find_spec
from pathlib import Path

from tests.fixtures import model_file as models
from tests.fixtures import usd
from tests.fixtures.encoded import zipped
from tests.fixtures.ifc import house
from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.made import entities, with_file, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_text

DAE, MAX, USD, USDZ, IFC = (
    f"import {name} --out out" for name in ("a.dae", "a.3ds", "a.usda", "a.usdz", "a.ifc")
)
STAGE = usd.stage(usd.SHELL, usd.PAINT)


def _models(folder: Path) -> None:
    (folder / "a.dae").write_text(models.dae(geometries=models.box(models.POINTS * [2.5, 2.6, 1])))
    (folder / "a.3ds").write_bytes(models.file_3ds())


def _nested(levels: int) -> bytes:
    """Chunks in chunks."""
    data = b""
    for _ in range(levels):
        data = models.chunk(0x3D3D, data)
    return models.chunk(0x4D4D, data)


def _stage(folder: Path) -> None:
    (folder / "a.usda").write_text(STAGE)
    _package(folder, {"a.usda": STAGE})


def _house(folder: Path) -> None:
    (folder / "a.ifc").write_text(house().text)


def _package(folder: Path, members: dict[str, str], compression: int = zipfile.ZIP_STORED) -> None:
    (folder / "a.usdz").write_bytes(zipped(members, compression))


def _cycle(folder: Path) -> Arguments:
    world = 'def "x" (references = @./a.usda@)\n{\n}'
    (folder / "a.usda").write_text(usd.stage(world))
    return USD.split()


def _outside(folder: Path) -> Arguments:
    (folder / "a.usda").write_text(usd.stage('def "x" (payload = @/dev/zero@)\n{\n}'))
    return USD.split()


def _many_instances(folder: Path) -> Arguments:
    """Instancers of instancers: 200^4 boxes."""
    inside = usd.box("box", [0, 0, 0], [1, 1, 1])
    for level in range(4):
        inside = f"""
def PointInstancer "i{level}"
{{
    rel prototypes = <{"/World" + "".join(f"/i{k}/p" for k in range(3, level, -1))}/i{level}/p>
    int[] protoIndices = {[0] * 200}
    point3f[] positions = {usd.points([[2 * k, 0, 0] for k in range(200)])}
    def Xform "p"
    {{
        {inside}
    }}
}}
"""
    (folder / "a.usda").write_text(usd.stage(inside))
    return USD.split()


def _bomb(folder: Path) -> Arguments:
    _package(folder, {"a.usda": STAGE, "t.png": "0" * 2**27}, zipfile.ZIP_DEFLATED)
    return USDZ.split()


def _leads_out(folder: Path) -> Arguments:
    _package(folder, {"a.usda": STAGE, "../../out.txt": "no"})
    return USDZ.split()


def _dae(text: str) -> Made:
    return with_file("a.dae", text, DAE)


def _piped(folder: Path) -> Arguments:
    os.mkfifo(folder / "pipe.png")
    return _dae(_image("pipe.png"))(folder)


def _max(data: bytes) -> Made:
    return with_file("a.3ds", data, MAX)


_ROOM = models.box(models.POINTS * [2.5, 2.6, 1])
_XML = "<?xml version='1.0'?>"


def _doubled_nodes(levels: int) -> str:
    """Library nodes that instance the one before twice."""
    nodes = f"<node id='n0'>{models.instance()}</node>" + "".join(
        f"<node id='n{n}'>" + f"<instance_node url='#n{n - 1}'/>" * 2 + "</node>"
        for n in range(1, levels)
    )
    return f"<library_nodes>{nodes}</library_nodes>"


def _image(path: str) -> str:
    """A box whose texture is another file."""
    library = (
        f"<library_images><image id='img'><init_from>{path}</init_from></image></library_images>"
    )
    paint = models.effect("red", models.TEXTURED, models.SAMPLER)
    return models.dae(geometries=models.box(uv=True), materials=paint, libraries=library)


def _mesh(faces: list[list[int]], scale: float = 1.0) -> bytes:
    return models.file_3ds(
        models.material_3ds(), models.mesh_3ds(points=models.POINTS * scale, faces=faces)
    )


MODELS_MADE = (
    *(_dae(models.dae(head=_XML + entities(kind))) for kind in ("bomb", "file", "net", "zero")),
    _dae(models.dae(nodes="<node>" * 3000 + models.instance() + "</node>" * 3000)),
    _dae(models.dae(nodes="<node>" * 100_000 + "</node>" * 100_000)),
    _dae(models.dae(nodes="<node id='n'><instance_node url='#n'/></node>")),
    _dae(
        models.dae(nodes="<node><instance_node url='#n39'/></node>", libraries=_doubled_nodes(40))
    ),
    _dae(models.dae(nodes="<node><instance_node url='/dev/zero#n'/></node>")),
    _dae(models.dae(nodes="<node><matrix>1 2 3</matrix></node>")),
    _dae(models.dae(nodes=f"<node><matrix>{'1e308 ' * 16}</matrix>{models.instance()}</node>")),
    _dae(models.dae(nodes=f"<node><scale>0 0 0</scale>{models.instance()}</node>")),
    _dae(models.dae(nodes=f"<node><rotate>nan 0 0 1</rotate>{models.instance()}</node>")),
    _dae(models.dae(nodes=f"<node name='{LONG * 20}'>{models.instance()}</node>")),
    _dae(models.dae(nodes=f"<node name='&#10;Error: forged&#9;'>{models.instance()}</node>")),
    *(_dae(models.dae(meter=value)) for value in (0.0, -1.0, 1e308, 1e-308, float("inf"))),
    _dae(models.dae(up="W_UP")),
    _dae(models.dae(geometries=_ROOM.replace("count='", "count='9999999999"))),
    _dae(models.dae(geometries=_ROOM.replace("offset='0'", "offset='99999999'"))),
    _dae(models.dae(geometries=_ROOM.replace("offset='0'", "offset='-1'"))),
    _dae(models.dae(geometries=_ROOM.replace("<p>", "<p>-1 99999999999 "))),
    _dae(models.dae(geometries=_ROOM.replace("stride='3'", "stride='0'"))),
    _dae(models.dae(geometries=models.box(polygons=True).replace("4 4 4", "0 -4 999999999"))),
    _dae(models.dae(geometries=models.box([[value] * 3 for value in range(8)]))),
    *(
        _dae(_image(path))
        for path in (
            "/dev/zero",
            "../../../../outside.png",
            "file:///etc/passwd",
            "http://127.0.0.1:1/x.png",
            "%2e%2e/%2e%2e/x.png",
            "a.dae",
            "\\\\host\\x",
        )
    ),
    _dae(""),
    _piped,
    _dae("<COLLADA/>"),
    _dae(models.dae()[:-400]),
    _max(b""),
    _max(b"MM" * 5000),
    _max(models.chunk(0x4D4D)),
    _max(models.chunk(0x4D4D, models.chunk(0x3D3D)) * 2),
    _max(models.chunk(0x4D4D, struct.pack("<HI", 0x3D3D, 2**32 - 1))),
    _max(models.chunk(0x4D4D, struct.pack("<HI", 0x3D3D, 0) * 5000)),
    _max(_nested(3000)),
    _max(_mesh([[0, 1, 65535]])),
    _max(_mesh([])),
    _max(_mesh(models.TRIANGLES, float("nan"))),
    _max(_mesh(models.TRIANGLES, 1e30)),
    _max(_mesh(models.TRIANGLES, 1e-30)),
    _max(models.file_3ds(models.mesh_3ds("\x1b[2J\x07\nError: forged", material="nothing"))),
    _max(models.file_3ds(nodes=tuple(models.node_3ds("box", parent=0) for _ in range(50)))),
    _max(models.file_3ds(nodes=(models.node_3ds("box", size=(0, 0, 0)),))),
    _max(models.file_3ds(nodes=(models.node_3ds("box", turn=(float("nan"), 0, 0, 0)),))),
    _max(
        models.file_3ds(
            models.material_3ds(
                "red", models.chunk(0xA200, models.chunk(0xA300, models.text("/dev/zero")))
            ),
            models.mesh_3ds(uv=True),
        )
    ),
    with_link("a.dae", "/dev/zero", DAE),
    with_link("a.3ds", "a.3ds", MAX),
)


_FAMILIES = [
    Family(
        "collada",
        len(MODELS_MADE) + 60,
        _models,
        (Victim("a.dae", damaged_text, (DAE,)), Victim("a.3ds", damaged_bytes, (MAX,))),
        MODELS_MADE,
        costly=frozenset((7,)),
    ),
]
if find_spec("pxr"):
    _FAMILIES.append(
        Family(
            "usd",
            60,
            _stage,
            (Victim("a.usda", damaged_text, (USD,)), Victim("a.usdz", damaged_bytes, (USDZ,))),
            (_cycle, _outside, _many_instances, _bomb, _leads_out),
            seconds=2.0,
        )
    )
if find_spec("ifcopenshell"):
    _FAMILIES.append(
        Family("ifc", 40, _house, (Victim("a.ifc", damaged_text, (IFC,)),), seconds=3.0)
    )
FAMILIES = tuple(_FAMILIES)
