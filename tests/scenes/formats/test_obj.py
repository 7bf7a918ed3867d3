"""OBJ, MTL and PLY: one reader of each, for every importer."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.mtl import read_mtl
from pbrnet.scenes.formats.obj import parse_obj
from pbrnet.scenes.formats.obj_model import read_model_materials
from pbrnet.scenes.formats.ply import read_ply, write_ply
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.registry import import_scene

SQUARE = """\
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
f 1/1/1 2/2/1 3/3/1 4/4/1
"""
AREA = 1.0


def area(data: str | bytes) -> float:
    mesh = parse_obj(data.encode() if isinstance(data, str) else data, "a.obj").mesh()
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(normals, axis=1).sum())


@pytest.mark.parametrize(
    "text",
    {
        "plain": SQUARE,
        "tabs": SQUARE.replace(" ", "\t"),
        "blanks": SQUARE.replace(" ", "  ").replace("\n", "  \n  "),
        "Windows": SQUARE.replace("\n", "\r\n"),
        "old Macintosh": SQUARE.replace("\n", "\r"),
        "a byte order mark": "\ufeff" + SQUARE,
        "faces first": "".join(sorted(SQUARE.splitlines(keepends=True))),
        "continued": SQUARE.replace(" 3/3/1", " \\\n 3/3/1"),
        "continued, Windows": SQUARE.replace(" 3/3/1", " \\\r\n 3/3/1"),
        "counted back": SQUARE.replace("1/1/1 2/2/1 3/3/1 4/4/1",
                                       "-4/-4/-1 -3/-3/-1 -2/-2/-1 -1/-1/-1"),
        "counted back and from the start": SQUARE.replace("3/3/1 4/4/1", "-2/3/1 -1/4/-1"),
        "positions alone": SQUARE.replace("/1/1", "").replace("/2/1", "").replace("/3/1", "")
        .replace("/4/1", ""),
        "no texture coordinates": SQUARE.replace("/1/", "//").replace("/2/", "//")
        .replace("/3/", "//").replace("/4/", "//"),
        "mixed": SQUARE.replace("2/2/1 3/3/1 4/4/1", "2/2 3 4//1"),
        "open ends": SQUARE.replace("/1 ", "/ ").replace("4/4/1", "4/4/"),
        "colours at the vertices": SQUARE.replace("v 1 0 0", "v 1 0 0 0.5 0.5 0.5"),
        "words after numbers": SQUARE.replace("v 1 0 0", "v 1 0 0 x"),
        "no end of line": SQUARE.rstrip(),
    }.items(),
    ids=lambda item: item[0],
)  # fmt: skip
def test_a_square_is_a_square_however_it_is_written(text: tuple[str, str]) -> None:
    assert area(text[1]) == AREA


def test_texture_coordinates_and_normals_belong_to_their_corners() -> None:
    mesh = parse_obj(SQUARE.encode(), "a.obj").mesh()
    assert mesh.uvs is not None and mesh.normals is not None
    np.testing.assert_array_equal(mesh.uvs, np.column_stack([mesh.vertices[:, 0],
                                                             1 - mesh.vertices[:, 1]]))  # fmt: skip
    np.testing.assert_array_equal(mesh.normals, np.tile([0, 0, 1], (4, 1)))
    mixed = parse_obj(SQUARE.replace("2/2/1", "2").encode(), "a.obj").mesh()
    assert mixed.uvs is None


def test_counting_back_means_the_last_read_so_far() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n"
    obj = parse_obj(text.encode(), "a.obj")
    assert obj.corners[:, 0].tolist() == [1, 2, 3, 4, 5, 6]


def test_objects_groups_and_materials_go_with_their_faces() -> None:
    text = SQUARE + (
        "o Table top\nusemtl Eiche natur\nf 1 2 3\ng leg\ns 1\nf 1 3 4\nf 2 3 4\n"
        "mtllib first library.mtl\nmtllib a.mtl b.mtl\nl 1 2\no Lamp\nf 1 2 4\n"
    )
    obj = parse_obj(text.encode(), "a.obj")
    named = [(obj.runs[run].object, obj.runs[run].group) for run in obj.run_of_face]
    assert named == [("", ""), ("Table top", ""), *[("Table top", "leg")] * 2, ("Lamp", "")]
    assert [obj.runs[run].material for run in obj.run_of_face] == ["", *["Eiche natur"] * 4]
    assert [obj.runs[run].smooth for run in obj.run_of_face] == [False, False, True, True, True]
    assert obj.libraries == ["first library.mtl", "a.mtl", "b.mtl"]
    assert obj.without_faces == {"l": 1}
    assert len(obj.mesh(np.array([2, 3])).faces) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v 0 0\nf 1 1 1\n", "a.obj: v: a damaged line"),
        ("v 0 0 x\nf 1 1 1\n", "a.obj: v: a damaged line"),
        ("v 0 0 0\nf 1 1 2\n", "vertex that does not exist"),
        ("v 0 0 0\nf 1 1 0\n", "vertex that does not exist"),
        ("v 0 0 0\nf 1 \\\n1 1\nf 1//2 1//2 1//2\n", "a.obj:4: a face refers to a vn .* 2 of 0"),
        ("v 0 0 0\nf 1 1 -2\n", "counts back too far"),
        ("v 0 0 0\nf 1 1 1/x\n", "damaged corner"),
        ("v 0 0 0\nf 1 1 99999999999999999999999\n", "damaged corner"),
        ("v 0 0 0\nf 1 1\n", "fewer than three"),
        ("v 0 0 0\n", "without faces"),
        ("", "without faces"),
    ],
)
def test_damage_is_named(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        area(text)


@pytest.mark.parametrize(
    ("lines", "opacity"),
    [
        ("Kd 1 1 1\nTr 0.75", 0.25),
        ("Tr 0.75\nKd 1 1 1\nKs 0 0 0", 0.25),
        ("Kd 1 1 1\nTr 0.75\nd 0.5", 0.5),  # `d` is the standard's
        ("d 0.5\nTr 0.75", 0.5),
        ("Kd\t1\t1\t1\nTr\t0.75", 0.25),
        ("kd 1 1 1\ntr 0.75", 0.25),
        ("d -halo 0.5", 0.5),
        ("Kd 1 1 1", 1.0),
        ("Tr 7", 0.0),
    ],
)
def test_opacity_whatever_else_a_material_says(lines: str, opacity: float) -> None:
    data = f"newmtl glass\n{lines}\nnewmtl other\nd 0.9\n".encode()
    assert read_mtl(data, "a.mtl")["glass"].opacity == opacity
    assert read_model_materials(data, "a.mtl", lambda name: None)["glass"].opacity == opacity


def test_glass_of_an_obj_comes_in_clear(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl glass\nKd\t0.8 0.8 0.8\nTr\t0.9\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl glass\n" + SQUARE.replace(" ", "\t"))
    scene = import_scene(tmp_path / "a.obj", tmp_path / "scene")
    assert any("became clear glass" in change for change in scene.changes)


def test_names_of_images_hold_blanks_and_options_go_before() -> None:
    data = b"newmtl a\nmap_Kd -s 2 4 1 -o 0.5 0 0 -clamp on my  wood.jpg\nmap_Kd2 x\n"
    image = read_mtl(data, "a.mtl")["a"].maps["map_Kd"]
    assert (image.name, image.clamp) == ("my  wood.jpg", True)
    assert image.to_uv is not None
    np.testing.assert_array_equal(image.to_uv[:2, :2], [[2, 0], [0, 4]])


def test_names_are_utf_8_or_latin_1() -> None:
    for coding in ("utf-8", "latin-1"):
        assert list(read_mtl("newmtl Grün\nKd 1 1 1\n".encode(coding), "a.mtl")) == ["Grün"]
        obj = parse_obj(("usemtl Grün\n" + SQUARE).encode(coding), "a.obj")
        assert [run.material for run in obj.runs] == ["Grün"]


def test_a_mesh_survives_a_ply(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    vertices = np.rint(rng.normal(size=(20, 3)) * 2**20) / 2**20  # what a file can hold
    uvs = np.rint(rng.uniform(size=(20, 2)) * 2**20) / 2**20
    faces = rng.integers(0, 20, (30, 3))
    for mesh in (Mesh(vertices, faces), Mesh(vertices, faces, vertices, uvs)):
        write_ply(tmp_path / "a.ply", mesh)
        read = read_ply(tmp_path / "a.ply")
        np.testing.assert_array_equal(read.vertices, vertices)
        np.testing.assert_array_equal(read.faces, faces)
        assert (read.normals is None) == (mesh.normals is None)
        if mesh.uvs is not None and mesh.normals is not None:
            np.testing.assert_array_equal(read.uvs, uvs)
            np.testing.assert_array_equal(read.normals, vertices)


def test_the_last_bit_of_a_sine_leaves_no_trace_in_a_ply(tmp_path: Path) -> None:
    """Numbers that differ by a rounding error are written as the same bytes."""
    angle = np.linspace(0, 2 * np.pi, 97)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(2 * angle)], axis=1)
    faces = np.arange(96).reshape(-1, 3)
    write_ply(tmp_path / "a.ply", Mesh(ring, faces))
    for sign in (-1, 1):
        write_ply(tmp_path / "b.ply", Mesh(ring + sign * 2.0**-52, faces))
        assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
