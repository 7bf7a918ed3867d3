"""Stored textures: what Mitsuba can open."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

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
