"""Base colours in GLB, which are greater than Mitsuba's, so that the albedo is the same."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.pipeline.scene_export.glb import _lift
from pbrnet.pipeline.scene_export.looks import Look, Picture
from pbrnet.pipeline.scene_export.pictures import lifted_bytes
from pbrnet.scenes.color import decode_srgb, encode_srgb
from pbrnet.scenes.models.stated import Statement


def test_a_lifted_image_has_its_old_values_again(tmp_path: Path) -> None:
    values = np.arange(240, dtype=np.uint8).reshape(12, 20)
    pixels = np.stack([values, values[::-1], values], axis=-1)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    data, lift = lifted_bytes(tmp_path, Picture("a.png"), 1.07)
    assert lift == 1.07
    (tmp_path / "b.png").write_bytes(data)
    bright = decode_srgb(np.asarray(Image.open(tmp_path / "b.png"), np.float64) / 255)
    assert bright.mean() == pytest.approx(1.07 * decode_srgb(pixels / 255).mean(), rel=2e-3)
    assert np.array_equal(np.rint(255 * encode_srgb(bright / lift)), pixels)


def test_no_image_is_clipped(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 200, 100)).save(tmp_path / "white.png")
    data, lift = lifted_bytes(tmp_path, Picture("white.png"), 1.07)
    assert lift == 1 and data == (tmp_path / "white.png").read_bytes()
    Image.new("RGB", (4, 4), (250, 200, 100)).save(tmp_path / "pale.png")
    _, lift = lifted_bytes(tmp_path, Picture("pale.png"), 1.07)
    assert lift == pytest.approx(1 / decode_srgb(np.array(250 / 255)), rel=1e-6)


def test_only_principled_dielectrics_are_lifted() -> None:
    assert _lift(Look(specular=0.5)) == pytest.approx(1.07)
    for other in (Look(metallic=1.0), Look(transmission=1.0), Look(diffuse_transmission=0.5),
                  Look(stated=Statement("diffuse"))):  # fmt: skip
        assert _lift(other) == 1
