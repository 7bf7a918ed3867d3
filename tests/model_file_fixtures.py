"""Handmade models as COLLADA and 3DS: boxes 2 wide, 1 high, 4 deep with a corner at the origin."""

from __future__ import annotations

import io
import struct
import zipfile

import numpy as np

# Corners with x right, y up, z to the front, and faces that look outwards.
POINTS = np.array(
    [[x, y, z] for z in (0.0, 4.0) for x, y in ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0))]
)
QUADS = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [3, 7, 6, 2], [0, 4, 7, 3], [1, 2, 6, 5]]
TRIANGLES = [tri for a, b, c, d in QUADS for tri in ([a, b, c], [a, c, d])]

# An image `img` as a texture `samp`, and a shading that shows it.
SAMPLER = (
    "<newparam sid='surf'><surface type='2D'><init_from>img</init_from></surface></newparam>"
    "<newparam sid='samp'><sampler2D><source>surf</source></sampler2D></newparam>"
)
TEXTURED = "<diffuse><texture texture='samp' texcoord='UV'/></diffuse>"
PLAIN = "<diffuse><color>1 0.5 0.25 1</color></diffuse>"


def effect(name: str, shading: str, before: str = "") -> str:
    """An effect and its material, both called after `name`."""
    return (
        f"<library_effects><effect id='{name}-fx'><profile_COMMON>{before}"
        f"<technique sid='c'><phong>{shading}</phong></technique></profile_COMMON></effect>"
        f"</library_effects><library_materials><material id='{name}-id' name='{name}'>"
        f"<instance_effect url='#{name}-fx'/></material></library_materials>"
    )


def numbers(values: object) -> str:
    """Numbers with blanks between."""
    return " ".join(f"{value:g}" for value in np.ravel(np.asarray(values)))


def source(name: str, values: object, axes: str) -> str:
    """A `<source>` of a table (N, len(axes))."""
    count = np.asarray(values).size
    params = "".join(f"<param name='{axis}' type='float'/>" for axis in axes)
    return (
        f"<source id='{name}'><float_array id='{name}-a' count='{count}'>{numbers(values)}"
        f"</float_array><technique_common><accessor source='#{name}-a' "
        f"count='{count // len(axes)}' stride='{len(axes)}'>{params}</accessor>"
        "</technique_common></source>"
    )


def box(
    points: object = POINTS, name: str = "box", polygons: bool = False, uv: bool = False
) -> str:
    """A `<geometry>` of the box, of triangles or as a polygon list."""
    faces = QUADS if polygons else TRIANGLES
    inputs = f"<input semantic='VERTEX' source='#{name}-v' offset='0'/>"
    more = ""
    corners: object = faces
    if uv:
        more = source(f"{name}-uv", [[0, 0], [1, 0], [1, 1]], "ST")
        inputs += f"<input semantic='TEXCOORD' source='#{name}-uv' offset='1' set='0'/>"
        corners = [[[v, k] for k, v in enumerate(face)] for face in faces]
    if polygons:
        counts = numbers([4] * 6)
        drawn = f"<polylist count='6' material='m'>{inputs}<vcount>{counts}</vcount>"
        drawn += f"<p>{numbers(corners)}</p></polylist>"
    else:
        drawn = f"<triangles count='12' material='m'>{inputs}<p>{numbers(corners)}</p></triangles>"
    return (
        f"<geometry id='{name}' name='{name}'><mesh>{source(f'{name}-p', points, 'XYZ')}{more}"
        f"<vertices id='{name}-v'><input semantic='POSITION' source='#{name}-p'/></vertices>"
        f"{drawn}</mesh></geometry>"
    )


def instance(name: str = "box", material: str = "red-id") -> str:
    """An `<instance_geometry>` with its material bound."""
    return (
        f"<instance_geometry url='#{name}'><bind_material><technique_common>"
        f"<instance_material symbol='m' target='#{material}'/></technique_common>"
        "</bind_material></instance_geometry>"
    )


def dae(
    nodes: str = "",
    geometries: str = "",
    materials: str = "",
    libraries: str = "",
    up: str = "Y_UP",
    meter: float = 1.0,
    asset: str = "",
    head: str = "<?xml version='1.0'?>",
) -> str:
    """A whole file; the box in orange if not told otherwise."""
    nodes = nodes or f"<node name='one'>{instance()}</node>"
    return (
        f"{head}<COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
        f"<asset>{asset}<created>2020-01-01T00:00:00Z</created>"
        f"<modified>2020-01-01T00:00:00Z</modified><unit meter='{meter}' name='u'/>"
        f"<up_axis>{up}</up_axis></asset>{libraries}{materials or effect('red', PLAIN)}"
        f"<library_geometries>{geometries or box()}</library_geometries>"
        f"<library_visual_scenes><visual_scene id='s'>{nodes}</visual_scene>"
        "</library_visual_scenes><scene><instance_visual_scene url='#s'/></scene></COLLADA>"
    )


def kmz(model: str, members: dict[str, bytes] | None = None, name: str = "models/a.dae") -> bytes:
    """A zip as Google Earth's, with a model and images."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", "<kml/>")
        archive.writestr(name, model)
        for one, data in (members or {}).items():
            archive.writestr(one, data)
    return stream.getvalue()


def chunk(kind: int, *content: bytes) -> bytes:
    """A 3DS chunk."""
    body = b"".join(content)
    return struct.pack("<HI", kind, len(body) + 6) + body


def text(words: str) -> bytes:
    """A text of a 3DS file."""
    return words.encode("latin-1") + b"\0"


def percent(kind: int, value: int) -> bytes:
    """A percentage chunk."""
    return chunk(kind, chunk(0x0030, struct.pack("<h", value)))


def material_3ds(
    name: str = "red", *more: bytes, color: tuple[int, int, int] = (255, 128, 64)
) -> bytes:
    """A material of a 3DS file."""
    return chunk(
        0xAFFF, chunk(0xA000, text(name)),
        chunk(0xA020, chunk(0x0011, struct.pack("<3B", *color))), *more,
    )  # fmt: skip


def mesh_3ds(
    name: str = "box",
    points: np.ndarray = POINTS,
    frame: np.ndarray | None = None,
    material: str = "red",
    uv: bool = False,
    smoothing: list[int] | None = None,
    faces: list[list[int]] = TRIANGLES,
) -> bytes:
    """A named mesh; `points` are y up and come out as the file's Z up, `frame` is the file's."""
    stored = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    parts = [chunk(0x4110, struct.pack("<H", len(stored)), stored.astype("<f4").tobytes())]
    if uv:
        table = np.zeros((len(stored), 2), "<f4")
        parts.append(chunk(0x4140, struct.pack("<H", len(stored)), table.tobytes()))
    if frame is not None:
        parts.append(chunk(0x4160, frame[:3].T.astype("<f4").tobytes()))
    table = np.array([[*face, 7] for face in faces], "<u2")
    group = struct.pack("<H", len(faces)) + np.arange(len(faces), dtype="<u2").tobytes()
    inner = [chunk(0x4130, text(material), group)]
    if smoothing is not None:
        inner.append(chunk(0x4150, np.array(smoothing, "<u4").tobytes()))
    parts.append(chunk(0x4120, struct.pack("<H", len(faces)), table.tobytes(), *inner))
    return chunk(0x4000, text(name), chunk(0x4100, *parts))


def node_3ds(
    name: str,
    parent: int = -1,
    pivot: tuple[float, ...] = (0, 0, 0),
    position: tuple[float, ...] = (0, 0, 0),
    turn: tuple[float, ...] = (0, 0, 0, 1),
    size: tuple[float, ...] = (1, 1, 1),
) -> bytes:
    """A keyframer's node; `turn` is angle and axis."""

    def track(kind: int, values: tuple[float, ...]) -> bytes:
        # One key, with a tension before its values, as the flag says.
        head = struct.pack("<HIIiiH", 0, 0, 0, 1, 0, 1)
        return chunk(kind, head, struct.pack(f"<{1 + len(values)}f", 0.5, *values))

    return chunk(
        0xB002, chunk(0xB010, text(name), struct.pack("<2Hh", 0, 0, parent)),
        chunk(0xB013, struct.pack("<3f", *pivot)),
        track(0xB020, position), track(0xB021, turn), track(0xB022, size),
    )  # fmt: skip


def file_3ds(*editor: bytes, nodes: tuple[bytes, ...] = ()) -> bytes:
    """A whole 3DS file."""
    key = chunk(0xB000, *nodes) if nodes else b""
    return chunk(
        0x4D4D, chunk(0x0002, struct.pack("<I", 3)),
        chunk(0x3D3D, *(editor or (material_3ds(), mesh_3ds()))), key,
    )  # fmt: skip
