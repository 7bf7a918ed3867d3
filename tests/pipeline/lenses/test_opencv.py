"""Depth reprojected by OpenCV's own functions."""

import cv2
import numpy as np
import pytest

from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from tests.fixtures.light import room
from tests.pipeline.lenses.test_views import HEIGHT, LENSES, WIDTH, through


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory, wavefront: str) -> RenderScene:
    return open_scene(room(tmp_path_factory.mktemp("opencv") / "home"))


@pytest.mark.parametrize("name", ["distorted", "fisheye"])
def test_opencv_puts_depth_into_its_pixels(home: RenderScene, name: str) -> None:
    view = through(LENSES[name])
    inputs = render_inputs(home, view)
    points = view.lens.points(inputs["Z"])
    # OpenCV divides by z in fisheyes, too, and so knows no points 90 degrees from the axis or more.
    seen = (inputs["valid"] > 0) & (points[..., 2] > 0.01)
    points = points[seen].reshape(-1, 1, 3)
    shifted = np.array(view.K) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    project = cv2.fisheye.projectPoints if name == "fisheye" else cv2.projectPoints
    found, _ = project(points, np.zeros(3), np.zeros(3), shifted, np.array(view.distortion))
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    error = np.abs(found.reshape(-1, 2) - np.stack([columns, rows], axis=-1)[seen])
    assert seen.mean() > 0.7 and error.max() < 0.001
