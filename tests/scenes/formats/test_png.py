"""PNG files of textures hold the pixels that they were given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenes.formats.png import write_png
from scenes.image_files import open_image


@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (90, 33, 3), (2, 1, 3)])
def test_pixels_survive(tmp_path: Path, shape: tuple[int, ...]) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    write_png(tmp_path / "image.png", pixels)
    np.testing.assert_array_equal(np.asarray(open_image(tmp_path / "image.png")), pixels)
