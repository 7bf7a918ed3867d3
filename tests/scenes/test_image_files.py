"""Images from strangers: a list of formats, whatever a file is called, and nothing else."""

import ast
import io
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from pbrnet.scenes.image_files import FORMATS, UnreadableImage, exr_channels, open_image
from tests.fixtures.encoded import picture
from tests.fixtures.paths import ROOT

EPS = b"""%!PS-Adobe-3.0 EPSF-3.0
%%BoundingBox: 0 0 8 8
(MARK) (w) file closefile
showpage
"""


@pytest.mark.parametrize("name", ["PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "PPM", "WEBP"])
def test_known_formats_are_read_from_files_and_from_bytes(tmp_path: Path, name: str) -> None:
    pixels = np.full((5, 7, 3), (200, 30, 90), np.uint8)
    path = tmp_path / "image"
    Image.fromarray(pixels).save(path, name)
    for source in (path, path.read_bytes()):
        image = open_image(source)
        assert image.size == (7, 5) and image.format in FORMATS
        assert np.abs(np.asarray(image.convert("RGB"), int) - pixels).max() <= 6


def test_a_postscript_program_named_png_does_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pillow would start Ghostscript, which the test's own `gs` would tell of."""
    mark = tmp_path / "ran"
    gs = tmp_path / "bin" / "gs"
    gs.parent.mkdir()
    gs.write_text(f"#!/bin/sh\ntouch {mark}\n")
    gs.chmod(0o755)
    monkeypatch.setenv("PATH", f"{gs.parent}:{os.environ['PATH']}")
    assert shutil.which("gs") == str(gs)
    path = tmp_path / "t.png"
    path.write_bytes(EPS)
    with pytest.raises(UnreadableImage, match="not an image of a known format"):
        open_image(path)
    assert not mark.exists()


@pytest.mark.parametrize("name", ["PCX", "SGI", "ICO", "EPS"])
def test_other_formats_of_pillow_are_refused(name: str) -> None:
    assert name not in FORMATS
    stream = io.BytesIO()
    Image.new("RGB", (16, 16), "red").save(stream, name)
    with pytest.raises(UnreadableImage, match="not an image of a known format"):
        open_image(stream.getvalue())


def test_a_bomb_is_refused_by_its_header() -> None:
    with pytest.raises(UnreadableImage, match="pixels"):
        open_image(picture(Image.new("1", (20_000, 20_000))))


@pytest.mark.parametrize("cut", [0, 1, 20, 60, 200])
def test_a_cut_file_is_refused(tmp_path: Path, cut: int) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (40, 40, 3), np.uint8)
    with pytest.raises(UnreadableImage):
        open_image(picture(noise)[:cut])


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.png"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero"), tmp_path):
        with pytest.raises(UnreadableImage, match="not a regular file"):
            open_image(path)
    with pytest.raises(UnreadableImage):
        open_image(tmp_path / "none.png")


def test_nothing_else_in_the_project_opens_images() -> None:
    """Calls of `open` on Pillow's `Image`, by any name that it is imported under."""
    opening = []
    for layer in ("scenes", "pipeline", "model", "benchmarks"):
        for path in (ROOT / layer).rglob("*.py"):
            tree = ast.parse(path.read_text())
            names = {
                alias.asname or alias.name
                for node in ast.walk(tree)
                if isinstance(node, ast.ImportFrom) and node.module == "PIL"
                for alias in node.names
                if alias.name == "Image"
            }
            assert not any(
                alias.name.startswith("PIL")
                for node in ast.walk(tree)
                if isinstance(node, ast.Import)
                for alias in node.names
            ), path
            opening += [
                path.relative_to(ROOT)
                for node in ast.walk(tree)
                if isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == "open"
                and isinstance(node.func.value, ast.Name)
                and node.func.value.id in names
            ]
    assert set(opening) == {Path("scenes/image_files.py")}


def exr(path: Path, pixels: Any, **header: Any) -> Path:
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, {"RGB": pixels}) as file:
        file.write(str(path))
    return path


def test_channels_of_an_exr_are_read(tmp_path: Path) -> None:
    pixels = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    read = exr_channels(exr(tmp_path / "a.exr", pixels))
    assert {name: values.tolist() for name, values in read.items()} == {
        name: pixels[..., place].tolist() for place, name in enumerate("RGB")
    }
    with pytest.raises(UnreadableImage, match="4 x 2 pixels, 3 channels"):
        exr_channels(tmp_path / "a.exr", most=7)


def test_pixels_that_cannot_be_decoded_are_an_error_and_not_a_line_of_output(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The library itself leaves such pixels at 0 and prints a warning."""
    smooth = np.linspace(0, 1, 24 * 32 * 3, dtype=np.float32).reshape(24, 32, 3)
    path = exr(tmp_path / "a.exr", smooth, compression=OpenEXR.ZIP_COMPRESSION)
    data = bytearray(path.read_bytes())
    data[-400:-100] = b"\xff" * 300
    path.write_bytes(data)
    with pytest.raises(UnreadableImage):
        exr_channels(path)
    assert capfd.readouterr().out == ""


def test_damage_is_no_fault_of_files_read_at_the_same_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    smooth = np.zeros((64, 64, 3), np.float16)
    for name in "abcdefgh":
        exr(tmp_path / name, smooth, compression=OpenEXR.ZIP_COMPRESSION)
    data = bytearray((tmp_path / "a").read_bytes())
    data[-20:] = bytes(20)
    (tmp_path / "a").write_bytes(data)

    def damaged(name: str) -> bool:
        print(name)
        try:
            exr_channels(tmp_path / name)
        except UnreadableImage:
            return True
        return False

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(damaged, "abcdefgh" * 40))
    assert found == [name == "a" for name in "abcdefgh"] * 40
    said = capsys.readouterr().out
    assert "".join(sorted(said.replace("\n", ""))) == "".join(sorted("abcdefgh" * 40))


def test_deep_images_are_refused(tmp_path: Path) -> None:
    cells = np.empty((4, 4), dtype=object)
    for place in np.ndindex(4, 4):
        cells[place] = np.ones(2, np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(header, dict.fromkeys("RGB", cells)) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(UnreadableImage, match="deep"):
        exr_channels(tmp_path / "a.exr")
