"""Hostile homes: their XML, archives, serialised objects and the models of pieces."""

import struct
import zipfile
from pathlib import Path

from tests.fixtures import model_file as models
from tests.fixtures import sweethome as draw
from tests.fixtures.encoded import zipped
from tests.fixtures.java import serialised
from tests.hostile.family import Family, Victim
from tests.hostile.made import case, entities, pack, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_text
from tests.scenes.sweethome.test_java_home import a_home

HOME = "import home.sh3d --out out"

TEXTURE = "<texture attribute='floorTexture' name='t' width='10' height='10' image='t'/>"


def _packed(folder: Path, compression: int = zipfile.ZIP_DEFLATED) -> None:
    """Pack what lies in `members` as a home."""
    pack(folder / "members", folder / "home.sh3d", compression)


def _members(folder: Path, xml: str | bytes, **members: str | bytes) -> None:
    (folder / "members").mkdir(exist_ok=True)
    for name, data in {"Home.xml": xml, **members}.items():
        raw = data.encode() if isinstance(data, str) else data
        (folder / "members" / name).write_bytes(raw)


def write_home(folder: Path) -> None:
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


@case
def _zip_made(folder: Path, xml: str | bytes, **members: str | bytes) -> str:
    draw.pack(folder / "home.sh3d", xml, dict(members))
    return HOME


@case
def _archive(folder: Path, compression: int, damage: slice, value: bytes) -> str:
    """A home packed in another way, with damage to its bytes."""
    _packed(folder, compression)
    data = bytearray((folder / "home.sh3d").read_bytes())
    data[damage] = value
    (folder / "home.sh3d").write_bytes(data)
    return HOME


HOMES_MADE = (
    *(
        _zip_made(draw.home("&i;").replace("<home", entities(kind) + "<home"))
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
    _zip_made(draw.usual(), **{"": "x"}),
    _zip_made(
        draw.usual(), **{" ": "x", ".": "x", "a//b": "x", "\x1b[2J": "x", "a\nError: b": "x"}
    ),
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
    _members(
        folder,
        draw.usual(body),
        **{
            "a.dae": textured,
            "b.3ds": models.file_3ds(nodes=(models.node_3ds("box"),)),
            "c.kmz": models.kmz(models.dae(), {"t.png": draw.quadrants()}),
            "d.zip": zipped({"x/box.obj": draw.BOX}),
            "t.png": draw.quadrants(),
        },
    )
    _packed(folder)


@case
def _part(folder: Path, name: str, data: str | bytes) -> str:
    raw = data.encode() if isinstance(data, str) else data
    (folder / "members" / name).write_bytes(raw)
    _packed(folder)
    return HOME


PARTS_MADE = (
    _part("a.dae", models.dae(head="<?xml version='1.0'?>" + entities("bomb"))),
    _part("a.dae", models.dae(head="<?xml version='1.0'?>" + entities("file"))),
    _part("a.dae", models.dae(meter=float("nan"))),
    _part("a.dae", models.dae(nodes="<node>" * 3000 + models.instance() + "</node>" * 3000)),
    _part("a.dae", models.dae(nodes="<node id='n'><instance_node url='#n'/></node>")),
    _part("a.dae", models.dae(nodes="<node><matrix>1 2 3</matrix></node>")),
    _part("b.3ds", models.chunk(0x4D4D, struct.pack("<HI", 0x3D3D, 2**32 - 1))),
    _part("b.3ds", models.chunk(0x4D4D, models.chunk(0x3D3D, struct.pack("<HI", 0x4000, 0)))),
    _part("b.3ds", b"MM" * 5000),
    _part("d.zip", b"PK\x03\x04" + bytes(50)),
)


FAMILIES = (
    Family(
        "homes",
        200,
        write_home,
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
        write_home,
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
            with_link("home.sh3d", "home.sh3d", HOME),
            with_link("home.sh3d", "/dev/zero", HOME),
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
)
