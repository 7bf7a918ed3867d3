"""Hostile PBRT scenes of versions 3 and 4, and the files that they include."""

import gzip
import os
from pathlib import Path

from tests.fixtures import pbrt_files as pbrt
from tests.fixtures import sweethome as draw
from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.made import case, with_file, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_text
from tests.hostile.scene_files.mitsuba import PLY_VERTICES, ply_bytes

PBRT, OLD, ZIPPED = (f"import {name} --out out" for name in ("a.pbrt", "v3.pbrt", "z.pbrt"))
LOOK = "LookAt 0.5 1.5 0.5  3 1 2.5  0 1 0\n"
BODY = f"""{pbrt.LAMP}
{pbrt.room(without=("north",))}
Texture "wood" "spectrum" "imagemap" "string filename" "t.png" "float uscale" 2
Texture "grey" "float" "constant" "float value" 0.4
Texture "both" "spectrum" "mix" "texture tex1" "wood" "rgb tex2" [ .1 .2 .3 ] "float amount" 0.5
MakeNamedMaterial "table" "string type" "coateddiffuse" "texture reflectance" "wood"
  "float roughness" 0.2
MakeNamedMaterial "steel" "string type" "conductor" "spectrum eta" "metal-Cu-eta"
  "float uroughness" 0.1 "float vroughness" 0.3
MakeNamedMaterial "mixed" "string type" "mix" "string materials" [ "table" "steel" ]
  "float amount" 0.3
AttributeBegin
  NamedMaterial "mixed"
  Translate 1 0.5 1
  Rotate 20 0 1 0
  Scale 0.5 0.5 0.5
  Shape "plymesh" "string filename" "m.ply"
  Shape "sphere" "float radius" 0.5 "float zmin" -0.2
  Shape "cylinder" "float zmin" -1 "float zmax" 1 "float radius" 0.2
AttributeEnd
ObjectBegin "cup"
  NamedMaterial "steel"
  Shape "disk" "float radius" 0.1 "float height" 0.9
  Shape "bilinearmesh" "point3 P" [ 0 1 0  1 1 0  0 1 1  1 1 1 ]
ObjectEnd
AttributeBegin
  ConcatTransform [ 1 0 0 0  0 1 0 0  0 0 1 0  1 1 1 1 ]
  ObjectInstance "cup"
AttributeEnd
LightSource "infinite" "rgb L" [ 1 1 1 ] "float illuminance" 100
LightSource "point" "point3 from" [ 2 2 1 ] "blackbody I" [ 3000 ]
LightSource "spot" "rgb I" [ 5 5 5 ] "float coneangle" 30
Include "more.pbrt"
"""
MORE = 'Material "diffuse" "rgb reflectance" [ .2 .5 .2 ]\nShape "sphere" "float radius" 0.2\n'
BODY_V3 = f"""
LightSource "infinite" "rgb L" [ 1 1 1 ] "rgb scale" [ 2 2 2 ]
AttributeBegin
  AreaLightSource "diffuse" "blackbody L" [ 3000 1 ] "integer nsamples" 4
  Translate 2 2.2 1.5
  Shape "sphere" "float radius" 0.1
AttributeEnd
{pbrt.room(without=("north",)).replace('"diffuse"', '"matte"').replace("reflectance", "Kd")}
Texture "dots" "color" "checkerboard" "float uscale" 8 "rgb tex1" [ .1 .1 .1 ]
Material "uber" "texture Kd" "dots" "rgb Ks" [ .1 .1 .1 ] "float roughness" 0.1
  "rgb opacity" [1 1 1]
Shape "loopsubdiv" "integer nlevels" 3 "point P" [ 1 .5 1  2 .5 1  1 .5 2 ]
  "integer indices" [0 1 2]
Material "glass" "float index" 1.4
TransformBegin
  Translate 1 1 2
  Shape "trianglemesh" "point P" [ 0 0 0  1 0 0  0 1 0 ] "integer indices" [ 0 1 2 ]
    "normal N" [ 0 0 1  0 0 1  0 0 1 ] "float uv" [ 0 0  1 0  0 1 ]
TransformEnd
WorldEnd
"""


def _pbrt(folder: Path) -> None:
    """A furnished room in version 4, one in version 3, and a compressed include."""
    pbrt.write(folder, BODY, name="a.pbrt")
    head = pbrt.HEAD_V4.replace('"rgb"', '"image"').replace('"volpath"', '"path"')
    pbrt.write(folder, BODY_V3, head, "v3.pbrt")
    pbrt.write(folder, BODY.replace("more.pbrt", "more.pbrt.gz"), name="z.pbrt")
    (folder / "more.pbrt").write_text(MORE)
    (folder / "more.pbrt.gz").write_bytes(gzip.compress(MORE.encode(), mtime=0))
    (folder / "m.ply").write_bytes(ply_bytes())
    (folder / "t.png").write_bytes(draw.quadrants())


@case
def _world(folder: Path, extra: str, head: str = pbrt.HEAD_V4) -> str:
    """A lit room with more in its world block."""
    pbrt.write(folder, f"{pbrt.LAMP}{pbrt.room()}\n{extra}", head, "a.pbrt")
    return PBRT


def _text(text: str | bytes) -> Made:
    return with_file("a.pbrt", text, PBRT)


def _ply(head: str, data: bytes = b"") -> Made:
    return with_file("m.ply", head.encode() + data, PBRT)


def _tree_of_includes(folder: Path) -> Arguments:
    """Twelve levels of files that include the next one eight times."""
    for level in range(12):
        (folder / f"i{level}.pbrt").write_text(f'Include "i{level + 1}.pbrt"\n' * 8)
    (folder / "i12.pbrt").write_text(MORE)
    pbrt.write(folder, 'Include "i0.pbrt"', name="a.pbrt")
    return PBRT.split()


def _bomb(folder: Path) -> Arguments:
    """An include that is a thousand times as long when it is unpacked."""
    (folder / "more.pbrt.gz").write_bytes(gzip.compress(bytes(700 * 2**20), 1, mtime=0))
    return ZIPPED.split()


def _pipe(folder: Path) -> Arguments:
    (folder / "more.pbrt").unlink()
    os.mkfifo(folder / "more.pbrt")
    return PBRT.split()


_MESH = 'Shape "trianglemesh" "point3 P" [{}] "integer indices" [{}]'
_CORNERS = "0 0 0  1 0 0  0 1 0"
_OUTSIDE = ("../../../../../x.pbrt", "/etc/passwd", "/dev/zero", "a.pbrt", ".", "", "A" * 5000)
_NAN = ("nan", "inf", "-inf", "1e308", "1e400", "-nan(0x1)", "0x1p9", LONG)
_TWICE = 'ObjectBegin "{b}"\n' + 'ObjectInstance "{a}"\n' * 10 + "ObjectEnd\n"
MADE = (
    *(_world(f'{word} "{path}"') for word in ("Include", "Import") for path in _OUTSIDE),
    *(
        _world(f'Shape "plymesh" "string filename" "{path}"')
        for path in ("../../../../../x.ply", "/dev/zero", "", "t.png", "missing.ply", "\\0")
    ),
    *(
        _world(
            f'Texture "t" "spectrum" "imagemap" "string filename" "{path}"\n'
            'Material "diffuse" "texture reflectance" "t"\nShape "sphere"'
        )
        for path in ("../../../../../x.png", "/dev/zero", "", "m.ply", "missing.png")
    ),
    *(
        _world(f'LightSource "infinite" "string filename" "{path}"')
        for path in ("../../../../../x.exr", "/dev/zero", "missing.exr", "m.ply", "a.pbrt")
    ),
    *(_world(f'Translate {value} 0 0\nShape "sphere"') for value in _NAN),
    *(_world(f'Transform [ {f"{value} " * 16} ]\nShape "sphere"') for value in _NAN[:4]),
    *(_world(f'Rotate 10 {value} 0 0\nShape "sphere"') for value in ("0", "1e-300", "1e30")),
    *(_world(f'Shape "sphere" "float radius" {value}') for value in (*_NAN, "0", "1e-30", "1e29")),
    *(
        _world(_MESH.format(_CORNERS, indices))
        for indices in (
            "0 1 1e308",
            "0 1 1e29",
            "0 1 -1",
            "0 1 2 0",
            "",
            "0.5 1 2",
            '"a" "b" "c"',
            "true",
            "nan",
            "0 1 2 " * 300_000,
        )
    ),
    _world(_MESH.format("0 0 1e29 " * 3, "0 1 2")),
    _world(_MESH.format("0 0 0 " * 400_000, "0 1 2")),
    _world(_MESH.format("0 0", "0 1 2")),
    _world("Scale 1e30 1e30 1e30\n" * 12 + 'Shape "sphere"'),
    _world("Scale 1e-12 1e-12 1e-12\n" * 3 + 'Shape "sphere"'),
    _world('Translate 1e30 0 0\nShape "sphere"'),
    _world('Scale 0 1 1\nShape "sphere"'),
    _world("AttributeBegin\n" * 200_000),
    _world("AttributeEnd\n"),
    _world("WorldBegin\n"),
    _world('ObjectBegin "o"\nObjectInstance "o"\nObjectEnd\nObjectInstance "o"'),
    _world('ObjectBegin "o"\nObjectBegin "o"\nObjectEnd\nObjectEnd'),
    _world(
        'ObjectBegin "a0"\nShape "sphere"\nObjectEnd\n'
        + "".join(_TWICE.format(a=f"a{n}", b=f"a{n + 1}") for n in range(9))
        + 'ObjectInstance "a9"'
    ),
    _world(
        'ObjectBegin "o"\n'
        + 'Shape "sphere"\n' * 2000
        + "ObjectEnd\n"
        + 'ObjectInstance "o"\n' * 2000
    ),
    _world('ObjectInstance "nothing"'),
    _world(
        'Texture "t" "float" "constant" "texture value" "t"\n'
        'Material "conductor" "texture roughness" "t"\nShape "sphere"'
    ),
    _world(
        'Texture "t" "spectrum" "scale" "texture tex" "t" "texture scale" "t"\n'
        'Material "diffuse" "texture reflectance" "t"\nShape "sphere"'
    ),
    _world(
        "".join(
            f'Texture "t{n}" "spectrum" "mix" "texture tex1" "t{n - 1}" "texture tex2" "t{n - 1}"\n'
            for n in range(1, 60)
        )
        + 'Material "diffuse" "texture reflectance" "t59"\nShape "sphere"'
    ),
    _world(
        'MakeNamedMaterial "m" "string type" "mix" "string materials" [ "m" "m" ]\n'
        'NamedMaterial "m"\nShape "sphere"'
    ),
    _world(
        'MakeNamedMaterial "m0" "string type" "diffuse"\n'
        + "".join(
            f'MakeNamedMaterial "m{n}" "string type" "mix" "string materials" '
            f'[ "m{n - 1}" "m{n - 1}" ]\n'
            for n in range(1, 60)
        )
        + 'NamedMaterial "m59"\nShape "sphere"'
    ),
    _world(
        'MakeNamedMaterial "m" "string type" "mix" "string materials" [ "x" ]\n'
        'NamedMaterial "m"\nShape "sphere"'
    ),
    _world('Material "nothing"\nShape "sphere"'),
    _world('Material "diffuse" "rgb reflectance" [ 1 2 ]\nShape "sphere"'),
    _world('Material "diffuse" "rgb reflectance" [ "a" ]\nShape "sphere"'),
    _world('Material "diffuse" "rgb reflectance" [ 1e29 -1 1e-29 ]\nShape "sphere"'),
    _world('Material "diffuse" "spectrum reflectance" [ 400 ]\nShape "sphere"'),
    _world('Material "diffuse" "spectrum reflectance" "t.png"\nShape "sphere"'),
    _world('Material "diffuse" "spectrum reflectance" "/dev/zero"\nShape "sphere"'),
    _world('Material "conductor" "float roughness" 1e29 "float eta" -1\nShape "sphere"'),
    _world('Material "dielectric" "float eta" 0\nShape "sphere"'),
    _world('Material "dielectric" "spectrum eta" []\nShape "sphere"'),
    _world('LightSource "point" "blackbody I" [ 0 ]'),
    _world('LightSource "point" "blackbody I" [ -5 1e29 ]'),
    _world('LightSource "point" "blackbody I" [ 1e29 ]'),
    _world('LightSource "spot" "float coneangle" 1e29'),
    _world('LightSource "distant" "point3 from" [ 0 0 0 ] "point3 to" [ 0 0 0 ]'),
    _world('LightSource "infinite" "float illuminance" 1e29'),
    _world('AreaLightSource "diffuse" "rgb L" [ 1e29 1e29 1e29 ]\nShape "sphere"'),
    _world('AreaLightSource "diffuse" "float power" -1\nShape "sphere"'),
    _world('AreaLightSource "nothing"\nShape "sphere"'),
    _world('Shape "nothing"'),
    _world('Shape "sphere" "float" 3'),
    _world('Shape "sphere" "float radius"'),
    _world('Shape "sphere" "float radius" ['),
    _world('Shape "sphere" "float radius" []'),
    _world('Shape "sphere" "string radius" "1"'),
    _world('Shape "sphere" "bool radius" true'),
    _world('Shape "cylinder" "float zmin" 1e29 "float zmax" -1e29'),
    _world('Shape "disk" "float radius" 1e29'),
    _world('Shape "bilinearmesh" "point3 P" [ 0 0 0 ]'),
    _world('Shape "curve" "point3 P" [ 0 0 0 ]'),
    _world('Shape "sphere"\n' * 20_000),
    _world("".join(f'Attribute "shape" "float radius" {n}\n' for n in range(3000))),
    _world("".join(f'MakeNamedMaterial "m{n}" "string type" "diffuse"\n' for n in range(20_000))),
    _world('CoordSysTransform "camera"\nShape "sphere"\nCoordSysTransform "nothing"'),
    _world("", pbrt.HEAD_V4.replace('"float fov" 60', '"float fov" 1e29')),
    _world("", pbrt.HEAD_V4.replace('"float fov" 60', '"float fov" 0')),
    _world("", pbrt.HEAD_V4.replace("[ 64 ]", "[ 1e29 ]")),
    _world("", pbrt.HEAD_V4.replace("[ 64 ]", "[ -1 ]")),
    _world("", pbrt.HEAD_V4.replace("[ 64 ]", "[ 0 ]")),
    _world("", pbrt.HEAD_V4.replace(LOOK, "LookAt 0 0 0 0 0 0 0 0 0\n")),
    _world("", pbrt.HEAD_V4.replace("0 1 0\n", "0 0 0\n")),
    _world("", pbrt.HEAD_V4.replace(LOOK, "Scale 1e30 1e30 1e30\n" * 11)),
    _world("", "ActiveTransform nothing\n" + pbrt.HEAD_V4),
    _text(""),
    _text("WorldBegin"),
    _text('"'),
    _text('Shape "' + "x" * 2_000_000),
    _text("#" * 2_000_000),
    _text("# \n" * 500_000),
    _text('"a\\' * 300_000),
    _text("[" * 500_000),
    _text("Shape " * 200_000),
    _text(b"\0" * 100_000),
    _text(bytes(range(256)) * 400),
    _text(b"\xff\xfe" + pbrt.HEAD_V4.encode("utf-16-le")),
    _text("\ufeff" + pbrt.HEAD_V4),
    _ply("ply\nformat ascii 1.0\nelement vertex 999999999999\n" + PLY_VERTICES + "end_header\n"),
    _ply("ply\n" + "comment x\n" * 100_000),
    _ply(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{PLY_VERTICES}"
        "element face 1\nproperty list double int vertex_indices\nend_header\n",
        b"\xff" * 8,
    ),
    _tree_of_includes,
    _bomb,
    _pipe,
    with_link("more.pbrt", "more.pbrt", PBRT),
    with_link("more.pbrt", "/dev/zero", PBRT),
    with_link("a.pbrt", "a.pbrt", PBRT),
    with_link("a.pbrt", "/dev/zero", PBRT),
    with_link("m.ply", "/dev/zero", PBRT),
    with_link("t.png", "/dev/zero", PBRT),
)

FAMILIES = (
    Family(
        "pbrt",
        300,
        _pbrt,
        (
            Victim("a.pbrt", damaged_text, (PBRT,)),
            Victim("a.pbrt", damaged_text, (PBRT, PBRT + " --skip-missing")),
            Victim("v3.pbrt", damaged_text, (OLD,)),
            Victim("more.pbrt", damaged_text, (PBRT,)),
            Victim("more.pbrt.gz", damaged_bytes, (ZIPPED,)),
            Victim("m.ply", damaged_bytes, (PBRT, PBRT + " --skip-missing")),
            Victim("t.png", damaged_bytes, (PBRT,)),
        ),
        MADE,
        costly=frozenset((65, 117, 164, 183, 237, 245, 263)),
    ),
)
