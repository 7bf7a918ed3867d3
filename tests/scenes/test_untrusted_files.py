"""Files from elsewhere: devices, loops, endless numbers, deep nesting, text that is no Unicode."""

import os
import struct
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.checked import build, shown
from pbrnet.scenes.contract import Credit, Room, Scene
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import parse_json, regular_file, resolved
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry.mesh import Mesh, creased
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.registry import import_scene
from tests.fixtures.encoded import zipped
from tests.fixtures.gltf import Builder, square
from tests.fixtures.paths import ROOT


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe", "device", "loop", "large"])
def test_only_regular_files_are_opened(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "loop":
        path.symlink_to("a")
    elif kind == "large":
        path.write_bytes(b"12345")
    with pytest.raises(InputError, match=str(path)):
        regular_file(path, limit=4)


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "7" * 5000, "1" * 400, "NaN", "[Infinity]", '"\\ud800"', '{"\\ud800": 1}', ""],
)
def test_json_that_nothing_can_use_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"a\.json: not valid JSON"):
        parse_json(text, "a.json")
    assert parse_json('{"a": "\\ud83d\\ude00", "b": 18446744073709551611}', "") == {
        "a": "\U0001f600",
        "b": 2**64 - 5,
    }


@dataclass(frozen=True)
class Number:
    value: float = 0.0


def test_values_in_messages_are_short() -> None:
    bomb: list[object] = ["x"] * 9
    for _ in range(9):
        bomb = [bomb] * 9
    assert len(shown(bomb)) < 500 and len(shown("x" * 10**6)) < 500
    assert shown(10**5000) == "a number of over 1,200 digits"
    for value in (bomb, 10**400, 10**5000, "y" * 10**6):
        with pytest.raises(ParameterError) as error:
            build(Number, {"value": value})
        assert len(str(error.value)) < 600


def test_links_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").symlink_to("a.mtl")
    with pytest.raises(InputError, match="circle"):
        resolved(tmp_path / "a.mtl")
    with pytest.raises(InputError, match="circle"):
        Sandbox(OpenedFiles(tmp_path)).find("a.mtl", "a.obj")


@pytest.mark.parametrize("kind", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2, zipfile.ZIP_DEFLATED])
def test_corrupt_members_of_archives(tmp_path: Path, kind: int) -> None:
    path = tmp_path / "a.sh3d"
    data = bytearray(zipped({"Home.xml": " ".join(map(str, range(3000)))}, kind))
    data[38:60] = b"\xff" * 22
    path.write_bytes(bytes(data))
    with HomeArchive(path) as home, pytest.raises(InputError, match="damaged"):
        home.read("Home.xml")


def ply(properties: str, faces: str, data: bytes = b"", form: str = "ascii") -> bytes:
    return (
        f"ply\nformat {form} 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        f"property float z\nelement face 1\n{properties}\nend_header\n{faces}"
    ).encode() + data


@pytest.mark.parametrize(
    "data",
    [
        ply("property int vertex_indices", "0 0 0\n1 0 0\n0 1 0\n0\n"),
        ply("property list double int vertex_indices", "0 0 0\n1 0 0\n0 1 0\n1e308 0\n"),
        ply("property list uchar int a\nproperty list uchar int a", "0 0 0\n1 0 0\n0 1 0\n0 0\n"),
        ply(
            "property list double int vertex_indices",
            "",
            bytes(36) + struct.pack("<d", 1e308),
            "binary_little_endian",
        ),
        ply(
            "property list double int vertex_indices",
            "",
            bytes(36) + struct.pack("<d", float("nan")),
            "binary_little_endian",
        ),
    ],
)
def test_impossible_lists_of_ply(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.ply"):
        read_ply(tmp_path / "a.ply")


def test_creases_do_not_depend_on_the_size_of_the_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(3)
    mesh = Mesh(random.random((40, 3)), random.integers(0, 40, (300, 3)))
    whole = creased(mesh, 60)
    monkeypatch.setattr("pbrnet.scenes.geometry.mesh._PAIRS", 50)
    assert np.array_equal(creased(mesh, 60).normals, whole.normals)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("item", "key", "value"),
    [
        ("materials", "alphaMode", []),
        ("materials", "name", ["x"]),
        ("nodes", "name", {}),
        ("accessors", "componentType", {}),
        ("accessors", "type", ["VEC3"]),
        ("nodes", "mesh", "0"),
    ],
)
def test_lists_where_gltf_has_text_or_numbers(
    tmp_path: Path, item: str, key: str, value: object
) -> None:
    made = square()
    made.json[item][0][key] = value
    with pytest.raises(InputError, match=f"'{key}' must be"):
        import_scene(made.save(tmp_path / "a.gltf"), tmp_path / "out")


@pytest.mark.parametrize("far", [1e31, 1e300])
def test_a_shape_beyond_single_precision_is_named(tmp_path: Path, far: float) -> None:
    made = Builder()
    made.node(mesh=made.mesh(), name="chair", translation=[far, 0, 0])
    made.save(tmp_path / "a.glb")
    with pytest.raises(InputError, match=r"chair.* lies too far out"):
        import_scene(tmp_path / "a.glb", tmp_path / "out", scale=1.0)


def test_a_room_of_a_scene_folder_lies_within_the_limit() -> None:
    room = Room("r", "r", "other", ((0, 0), (2, -(2.0**63)), (2, 2)), 0, 3, True)
    credit = Credit("everything", "t", "a", "CC0-1.0")
    with pytest.raises(ValueError, match="'r' lies more than 1e\\+06 m away"):
        Scene(
            scene_id="a", lighting="unknown", rooms=(room,), objects=(), lights=(), portals=(),
            credits=(credit,), source={},
        ).verify("")  # fmt: skip


def test_a_child_of_a_limited_process_starts(tmp_path: Path) -> None:
    """Its own limits may be larger than those it inherits, which it cannot raise."""
    code = (
        "import resource, pathlib; from scenes.child_process import run_child\n"
        "resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))\n"
        "run_child('builtins:print', (), pathlib.Path('a.x'), 10, 8 << 30)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, timeout=60)
