"""Stored textures: what Mitsuba can open."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.image_files import UnreadableImage
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("size", [(1, 1), (3, 1), (1, 4)])
def test_images_of_one_pixel_a_side_are_textures(tmp_path: Path, size: tuple[int, int]) -> None:
    (tmp_path / "textures").mkdir()
    path = tmp_path / "tiny.png"
    Image.new("RGB", size, (255, 0, 0)).save(path)
    store = TextureStore(tmp_path / "textures", Changes())
    red = {store.color(path), store.channel(path, 0), store.scaled(path, np.ones(3))}
    for name in sorted(red):
        texture = mi.load_dict({"type": "bitmap", "filename": str(tmp_path / name)})
        hit = mi.SurfaceInteraction3f()
        hit.uv = mi.Point2f(0.5, 0.5)
        value = texture.eval_1(hit) if "channel" in name else texture.eval(hit)
        assert np.ravel(value)[0] == pytest.approx(1.0)


def test_maps_of_16_bits_are_scaled_not_clipped(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    path = tmp_path / "rough.png"
    ramp = np.arange(256, dtype=np.uint16).reshape(16, 16) * 257
    Image.fromarray(ramp).save(path)
    store = TextureStore(tmp_path / "textures", Changes())
    expected = np.arange(256).reshape(16, 16)
    for name in (store.channel(path, 0), store.channel_scaled(path, 1, 1.0)):
        with Image.open(tmp_path / name) as stored:
            np.testing.assert_array_equal(np.asarray(stored), expected)
    with Image.open(tmp_path / store.color(path)) as stored:
        np.testing.assert_array_equal(np.asarray(stored.convert("L")), expected)


def test_floating_point_tiffs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    path = tmp_path / "rough.tif"
    Image.fromarray(np.full((4, 4), 0.5, np.float32)).save(path)
    store = TextureStore(tmp_path / "textures", Changes())
    with pytest.raises(UnreadableImage, match="floating-point"):
        store.channel(path, 0)
