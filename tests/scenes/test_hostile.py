"""Truncated and damaged scene files of every kind: refused by name, or imported with a note.

Imports stay within bounds of time and memory. The damage is random with fixed seeds; cases made by
hand are in the tests of each importer.
"""

from __future__ import annotations

import resource
import shutil
import struct
import time
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes
from pbrnet.scenes.image_files import is_intact
from pbrnet.scenes.registry import import_scene
from tests.fixtures import mitsuba_files as mitsuba
from tests.fixtures import sweethome as draw
from tests.fixtures.gltf import square

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_walks")]

SECONDS, MEMORY = 10.0, 2**20  # KiB
OBJ = "mtllib a.mtl\n" + draw.BOX.replace("usemtl amber", "usemtl red") + "#  \n"
MTL = "newmtl red\nKd 0.8 0.1 0.1\nNs 30\nmap_Kd t.png\n"


def a_home(folder: Path) -> tuple[Path, Path]:
    texture = "<texture attribute='floorTexture' name='t' width='10' height='10' image='t'/>"
    body = draw.usual(draw.room(50, 50, 100, 100, texture) + draw.piece(model="box", x=200, y=150))
    path = draw.pack(folder / "a.sh3d", body, {"box": draw.BOX, "t": draw.quadrants()})
    return path, path


def home_xml(folder: Path) -> tuple[Path, Path]:
    """A home whose `Home.xml` is damaged before it is packed."""
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


# Effect of a file that is cut to a share of its length, where it is not refused: the note of the
# loss, or "" where the missing bytes carry nothing.
CUT = {
    ("obj", 0.99): "",  # a part of the comment at the end
    ("mtl", 0.0): "a material that no library defines became grey: red",
    ("mtl", 0.1): "a material that no library defines became grey: red",
    ("mtl", 0.9): "missing texture, replaced by the plain colour: 't'",
    ("mtl", 0.99): "",  # the last end of line
    ("png", 0.0): "damaged texture, replaced by the plain colour: t.png",
    ("png", 0.1): "damaged texture, replaced by the plain colour: t.png",
    ("png", 0.5): "damaged texture, replaced by the plain colour: t.png",
    ("png", 0.9): "an image with wrong checksums was written anew: t.png",
    ("png", 0.99): "",  # the checksum of the end
}
CHECKED = ("home", "png")  # kinds with checksums: damage is noticed wherever it matters


def content_digest(folder: Path) -> str:
    """Digest of a scene folder; images count by their pixels."""
    return digest_bytes(
        *(
            Image.open(file).convert("RGBA").tobytes()
            if file.suffix == ".png"
            else file.read_bytes()
            for file in sorted(folder.rglob("*"))
            if file.is_file()
        )
    )


class Import:
    """An import of a file: its scene and the digest of its folder, or the error."""

    def __init__(self, path: Path, out: Path) -> None:
        if path.name == "Home.xml":
            path = draw.pack(path.parent / "a.sh3d", path.read_bytes())
        self.scene: Scene | None = None
        self.error = self.digest = ""
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        started = time.process_time()
        try:
            import_scene(path, out)
            self.scene = load_scene(out)
            self.digest = content_digest(out)
            assert all(is_intact(file) for file in out.rglob("*.png"))  # as libpng demands
        except InputError as error:
            self.error = str(error)
            assert not out.exists() and not list(out.parent.glob(".partial*"))
        assert time.process_time() - started < SECONDS
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY
        shutil.rmtree(out, ignore_errors=True)

    def notes(self, whole: Import) -> list[str]:
        """Changes that the import of the undamaged file does not have."""
        assert self.scene is not None and whole.scene is not None
        return [one for one in self.scene.changes if one not in whole.scene.changes]


def assert_whole_or_noted(damaged: Import, whole: Import) -> None:
    """An imported scene has the rooms and objects of the undamaged one, but for noted losses."""
    assert damaged.scene is not None and whole.scene is not None
    assert len(damaged.scene.rooms) == len(whole.scene.rooms)
    if not damaged.notes(whole):
        # Ids and names are text, which damage may change; the number of things is not.
        assert len(damaged.scene.objects) == len(whole.scene.objects)
        assert len(damaged.scene.lights) == len(whole.scene.lights)


@pytest.fixture(scope="module")
def undamaged(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Import]:
    """Imports of the undamaged files by kind, each made once."""

    @cache
    def made(kind: str) -> Import:
        folder = tmp_path_factory.mktemp("undamaged")
        return Import(KINDS[kind](folder)[0], folder / "out")

    return made


@pytest.mark.parametrize("kind", KINDS)
def test_an_undamaged_file_is_imported(undamaged: Callable[[str], Import], kind: str) -> None:
    assert undamaged(kind).scene is not None


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("kind", KINDS)
def test_truncated_files(
    tmp_path: Path, undamaged: Callable[[str], Import], kind: str, share: float
) -> None:
    path, damaged = KINDS[kind](tmp_path)
    whole = undamaged(kind)
    data = damaged.read_bytes()
    damaged.write_bytes(data[: int(share * len(data))])
    cut = Import(path, tmp_path / "out")
    loss = CUT.get((kind, share))
    if loss is None:
        assert cut.scene is None
        assert damaged.name in cut.error
    elif not loss:
        assert cut.digest == whole.digest
    else:
        (note,) = cut.notes(whole)
        assert note.startswith(loss)
        assert_whole_or_noted(cut, whole)


@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bytes(tmp_path: Path, undamaged: Callable[[str], Import], kind: str) -> None:
    path, damaged = KINDS[kind](tmp_path)
    whole = undamaged(kind)
    data = np.frombuffer(damaged.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(7)
    refused = 0
    # An import that succeeds takes much longer than one that is refused at once.
    for _ in range(4 if kind in ("png", "mtl", "obj") else 12):
        hurt = data.copy()
        places = rng.integers(0, len(hurt), 1 + len(hurt) // 2000)
        hurt[places] = rng.integers(0, 256, len(places))
        damaged.write_bytes(hurt.tobytes())
        tried = Import(path, tmp_path / "out")
        if tried.scene is None:
            refused += 1
            assert damaged.name in tried.error
        elif kind in CHECKED:
            assert tried.notes(whole) or tried.digest == whole.digest
            assert len(tried.scene.rooms) == len(whole.scene.rooms)  # type: ignore[union-attr]
        else:
            assert_whole_or_noted(tried, whole)
    # A damaged image costs only itself; every other kind holds bytes that nothing can do without.
    assert refused == 0 if kind == "png" else refused >= (1 if kind in ("mtl", "obj") else 3)


@pytest.mark.parametrize("kind", ["Home.xml", "gltf", "obj", "mtl", "xml", "scene.json"])
def test_absurd_numbers(tmp_path: Path, kind: str) -> None:
    path, damaged = KINDS[kind](tmp_path)
    text = damaged.read_text()
    rng = np.random.default_rng(11)
    places = [at for at, sign in enumerate(text) if sign.isdigit()]
    for number, wild in enumerate(("nan", "inf", "-1", "1e308", "99999999999", "1e-300")):
        at = places[int(rng.integers(len(places)))]
        damaged.write_text(text[:at] + wild + text[at + 1 :])
        tried = Import(path, tmp_path / f"out{number}")
        assert tried.scene is not None or damaged.name in tried.error
