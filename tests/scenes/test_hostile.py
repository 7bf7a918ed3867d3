"""Every kind of scene file cut short or damaged: a clear error or a whole scene, soon, in bounds.

The damage is drawn from fixed seeds. The cases made by hand stand beside each importer's tests.
"""

from __future__ import annotations

import resource
import shutil
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.registry import import_scene
from tests.fixtures import mitsuba_files as mitsuba
from tests.fixtures import sweethome as draw
from tests.fixtures.gltf import square

SECONDS, MEMORY = 10.0, 2**20  # KiB
OBJ = "mtllib a.mtl\nusemtl red\n" + draw.BOX
MTL = "newmtl red\nKd 0.8 0.1 0.1\nNs 30\nmap_Kd t.png\n"


def a_home(folder: Path) -> tuple[Path, Path]:
    texture = "<texture attribute='floorTexture' name='t' width='10' height='10' image='t'/>"
    body = draw.usual(draw.room(50, 50, 100, 100, texture) + draw.piece(model="box", x=200, y=150))
    path = draw.pack(folder / "a.sh3d", body, {"box": draw.BOX, "t": draw.quadrants()})
    return path, path


def home_xml(folder: Path) -> tuple[Path, Path]:
    """A home whose `Home.xml` is damaged before it is packed, see `rebuilt`."""
    path = folder / "Home.xml"
    path.write_text(draw.usual(draw.window(x=200, y=0) + draw.lamp(x=100, y=100)))
    return path, path


def a_glb(folder: Path) -> tuple[Path, Path]:
    path = square().save(folder / "a.glb")
    return path, path


def a_gltf(folder: Path) -> tuple[Path, Path]:
    path = square().save(folder / "a.gltf")
    return path, path


def an_obj(folder: Path) -> tuple[Path, Path]:
    (folder / "a.mtl").write_text(MTL)
    (folder / "t.png").write_bytes(draw.quadrants())
    (folder / "a.obj").write_text(OBJ)
    return folder / "a.obj", folder / "a.obj"


def a_library(folder: Path) -> tuple[Path, Path]:
    return an_obj(folder)[0], folder / "a.mtl"


def an_image(folder: Path) -> tuple[Path, Path]:
    return an_obj(folder)[0], folder / "t.png"


def an_xml(folder: Path) -> tuple[Path, Path]:
    path = mitsuba.write(folder, mitsuba.usual())
    return path, path


def with_mesh(folder: Path, kind: str, data: bytes) -> tuple[Path, Path]:
    name = f"m.{kind}"
    (folder / name).write_bytes(data)
    shape = f'<shape type="{kind}" id="x"><string name="filename" value="{name}"/></shape>'
    return mitsuba.write(folder, mitsuba.usual(shape)), folder / name


def a_ply(folder: Path) -> tuple[Path, Path]:
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    points = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]], dtype="<f4").tobytes()
    return with_mesh(folder, "ply", head.encode() + points + struct.pack("<Biii", 3, 0, 1, 2))


def a_serialized(folder: Path) -> tuple[Path, Path]:
    points = np.array([[1, 1, -1], [2, 1, -1], [1, 1, -2]], dtype="<f4").tobytes()
    body = struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", 3, 1) + points
    body += struct.pack("<III", 0, 1, 2)
    packed = struct.pack("<HH", 0x041C, 4) + zlib.compress(body)
    return with_mesh(folder, "serialized", packed + struct.pack("<QI", 0, 1))


def a_folder(folder: Path) -> tuple[Path, Path]:
    scene = import_scene(square().save(folder / "in" / "a.glb"), folder / "made")
    return scene.folder, scene.folder / "scene.json"


KINDS: dict[str, Callable[[Path], tuple[Path, Path]]] = {
    "home": a_home,
    "Home.xml": home_xml,
    "glb": a_glb,
    "gltf": a_gltf,
    "obj": an_obj,
    "mtl": a_library,
    "png": an_image,
    "xml": an_xml,
    "ply": a_ply,
    "serialized": a_serialized,
    "scene.json": a_folder,
}


def comes_in_or_is_refused(path: Path, out: Path) -> bool:
    """Import `path`: a whole scene, or an error for the reader and nothing left behind."""
    if path.name == "Home.xml":
        path = draw.pack(path.parent / "a.sh3d", path.read_bytes())
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.process_time()
    try:
        import_scene(path, out)
        load_scene(out)
        came = True
    except InputError as error:
        assert len(str(error)) > 10
        assert not out.exists() and not list(out.parent.glob(".partial*"))
        came = False
    assert time.process_time() - started < SECONDS
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY
    shutil.rmtree(out, ignore_errors=True)
    return came


@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_file_comes_in(tmp_path: Path, kind: str) -> None:
    path, _ = KINDS[kind](tmp_path)
    assert comes_in_or_is_refused(path, tmp_path / "out")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("kind", KINDS)
def test_truncated_files(tmp_path: Path, kind: str, share: float) -> None:
    path, damaged = KINDS[kind](tmp_path)
    data = damaged.read_bytes()
    damaged.write_bytes(data[: int(share * len(data))])
    comes_in_or_is_refused(path, tmp_path / "out")


@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bytes(tmp_path: Path, kind: str) -> None:
    path, damaged = KINDS[kind](tmp_path)
    data = np.frombuffer(damaged.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(7)
    for _ in range(12):
        hurt = data.copy()
        places = rng.integers(0, len(hurt), 1 + len(hurt) // 2000)
        hurt[places] = rng.integers(0, 256, len(places))
        damaged.write_bytes(hurt.tobytes())
        comes_in_or_is_refused(path, tmp_path / "out")


@pytest.mark.parametrize("kind", ["Home.xml", "gltf", "obj", "mtl", "xml", "scene.json"])
def test_absurd_numbers(tmp_path: Path, kind: str) -> None:
    path, damaged = KINDS[kind](tmp_path)
    text = damaged.read_text()
    rng = np.random.default_rng(11)
    places = [at for at, sign in enumerate(text) if sign.isdigit()]
    for number, wild in enumerate(("nan", "inf", "-1", "1e308", "99999999999", "1e-300") * 2):
        at = places[int(rng.integers(len(places)))]
        damaged.write_text(text[:at] + wild + text[at + 1 :])
        comes_in_or_is_refused(path, tmp_path / f"out{number}")
