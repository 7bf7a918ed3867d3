"""Hostile images, as textures and skies."""

import struct
import time
from pathlib import Path

from PIL import Image

from tests.fixtures.encoded import empty_png, picture
from tests.hostile.family import Family, Victim
from tests.hostile.made import with_file, with_link
from tests.hostile.mutations import damaged_bytes
from tests.hostile.scene_files.mitsuba import XML, write_xml
from tests.hostile.scene_files.models import MTL, OBJ


def _picture(kind: str, **options: object) -> bytes:
    return picture(Image.new("RGB", (16, 16), "red"), kind, **options)


def _png(width: int, height: int) -> bytes:
    return empty_png(width, height, bytes(100))


_EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(evil) (w) file\n{} loop\nshowpage\n"

_IMAGES = {
    "eps": _EPS,
    "dds": _picture("DDS"),
    "ico": _picture("ICO"),
    "pdf": _picture("PDF", creationDate=time.gmtime(0), modDate=time.gmtime(0)),
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
    *(with_file("t.png", data, OBJ) for data in _IMAGES.values()),
    *(with_file("t.png", _IMAGES[name], XML) for name in ("eps", "dds", "large", "hdr", "exr")),
    *(with_file("sky.exr", data, XML) for data in _IMAGES.values()),
    with_link("t.png", "t.png", XML),
    with_link("sky.exr", "/dev/zero", XML),
)


def _images(folder: Path) -> None:
    write_xml(folder)
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


FAMILIES = (
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
