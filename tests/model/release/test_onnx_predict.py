"""The example programs run exported files without torch and without this package."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.model.data.display import DEFAULT_WHITE
from pbrnet.model.evaluation.predict import from_frames
from pbrnet.pipeline.images import read_picture
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap
from tests.fixtures.model import box_dataset
from tests.fixtures.predict import box_frames
from tests.model.release.conftest import ExportedFile, run_example

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("method", ["pbrnet", pytest.param("plus", marks=pytest.mark.check)])
def test_onnx_predict_draws_a_view_from_its_frames(
    method: str, exported: Callable[..., ExportedFile], tmp_path: Path
) -> None:
    made = exported(method)
    box_frames(tmp_path / "data", width=37, height=23, panorama=20)
    kinds = ("inputs", "illumination", "transport", "materials")
    frames = [tmp_path / "data" / kind / "box" / "v0.exr" for kind in kinds]
    run_example("onnx_predict.py", tmp_path, made.path, "picture.png", *frames)
    wanted = from_frames(
        dict(zip(("inputs", "illumination", "transport", "materials"), frames, strict=True))
    )
    predicted = made.networks.predict(method, wanted.load(made.networks.card))
    expected = predicted.color
    if predicted.linear is not None:
        own = exposure_of(predicted.linear, ToneParams())
        expected = tonemap(predicted.linear, Exposure(own.scale, DEFAULT_WHITE))
    drawn = read_picture((tmp_path / "picture.png").read_bytes()) / 255
    assert np.abs(drawn - expected).max() < 1 / 255 + 2e-3


def test_with_onnx_draws_a_view_of_the_dataset(
    exported: Callable[..., ExportedFile], tmp_path: Path
) -> None:
    box_dataset(tmp_path, 0, 0, 2, width=64, height=48, panorama=64)
    run_example("consume/with_onnx.py", tmp_path, exported("pbrnet").path, tmp_path / "dataset")
    with Image.open(tmp_path / "picture.png") as image:
        assert image.size == (128, 48)
