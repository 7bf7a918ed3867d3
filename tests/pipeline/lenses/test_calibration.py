"""Calibration files: four kinds, pixels' corners, other image sizes, and what is refused."""

import json
from pathlib import Path

import pytest

from pbrnet.pipeline.lenses.calibration import opencv_text, read_calibration
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.lenses.settings import lens_of
from pbrnet.pipeline.params import build_params
from pbrnet.scenes.errors import ParameterError

FOCAL, CENTRE = (610.5, 608.25), (319.0, 241.5)  # of 640 x 480, from the first pixel's centre
FOUR = (-0.28, 0.07, 0.0008, -0.0005)

OPENCV = """%YAML:1.0
---
calibration_time: "Mon 2 Feb"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 610.5, 0., 319., 0., 608.25,
       241.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28, 0.07, 0.0008, -5.0e-04, 0. ]
"""
XML = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>
  610.5 0. 319. 0. 608.25 241.5 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt><data>
  -0.28 0.07 0.0008 -0.0005</data></distortion_coefficients>
</opencv_storage>
"""
ROS = """image_width: 640
image_height: 480
camera_name: left
camera_matrix: {rows: 3, cols: 3, data: [610.5, 0, 319, 0, 608.25, 241.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.07, 0.0008, -0.0005, 0.0]}
"""
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [610.5, 608.25, 319.0, 241.5]
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0008, -0.0005]
  resolution: [640, 480]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  camera_model: pinhole
  intrinsics: [400.0, 401.0, 320.0, 240.0]
  distortion_model: equidistant
  distortion_coeffs: [0.03, -0.01, 0.004, -0.001]
  resolution: [640, 480]
cam2:
  camera_model: omni
  intrinsics: [1.2, 400.0, 401.0, 320.0, 240.0]
"""
NERFSTUDIO = {
    "camera_model": "OPENCV",
    "fl_x": 610.5,
    "fl_y": 608.25,
    "cx": 319.5,
    "cy": 242.0,
    "w": 640,
    "h": 480,
    **dict(zip(("k1", "k2", "p1", "p2"), FOUR, strict=True)),
    "frames": [{"file_path": "images/a.png", "transform_matrix": []}],
}
FILES = {
    "a.yaml": OPENCV,
    "a.xml": XML,
    "ros.yaml": ROS,
    "camchain.yaml": KALIBR,
    "transforms.json": json.dumps(NERFSTUDIO),
}


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", FILES)
def test_all_kinds_of_files_say_the_same(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name, FILES[name])
    image = {"width": 320, "height": 240, "lens": {"calibration": str(path)}}
    params = build_params({"image": image})
    lens = lens_of(params.image)
    assert lens.distortion == FOUR
    (focal_x, _, x), (_, focal_y, y), _ = lens.K
    assert (focal_x, focal_y) == pytest.approx((FOCAL[0] / 2, FOCAL[1] / 2))
    assert (x, y) == pytest.approx(((CENTRE[0] + 0.5) / 2, (CENTRE[1] + 0.5) / 2))
    assert params.image.lens.calibration == "", "parameters hold numbers only"


def test_a_fisheye_of_kalibr_needs_that_projection(tmp_path: Path) -> None:
    path = str(written(tmp_path, "camchain.yaml", KALIBR))
    lens = {"calibration": path, "camera": "cam1"}
    image = {"width": 640, "height": 480, "projection": "fisheye", "lens": lens}
    found = lens_of(build_params({"image": image}).image)
    assert found.projection == "fisheye" and found.distortion == (0.03, -0.01, 0.004, -0.001)
    with pytest.raises(ParameterError, match=r"set image\.projection: fisheye"):
        build_params({"image": {**image, "projection": "perspective"}})


def test_a_fisheye_of_instant_ngp_is_no_pinhole(tmp_path: Path) -> None:
    text = json.dumps({**NERFSTUDIO, "camera_model": None, "is_fisheye": True})
    text = text.replace('"camera_model": null, ', "")
    assert read_calibration(written(tmp_path, "t.json", text)).projection == "fisheye"


def test_what_is_written_for_opencv_is_read_back(tmp_path: Path) -> None:
    matrix = ((210.5, 0.0, 160.25), (0.0, 209.0, 121.75), (0.0, 0.0, 1.0))
    for lens in (
        Lens("perspective", 320, 240, matrix, (0.4, 0.05, -0.001, 0.002, 0.003, 0.8, 0.1, 0.01)),
        Lens("fisheye", 320, 240, matrix, (0.03, -0.01, 0.004, -0.001)),
    ):
        found = read_calibration(written(tmp_path, "opencv.yaml", opencv_text(lens)))
        assert found.projection in (None, lens.projection)
        assert found.distortion == lens.distortion and found.size == (320, 240)
        assert (*found.focal, *found.centre) == (210.5, 209.0, 160.25, 121.75)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", KALIBR.replace("cam0", "x").replace("cam1", "y"), "omni' projects through"),
        ("a.yaml", KALIBR.replace("radtan", "fov"), "'fov' is not one of radtan"),
        ("a.yaml", "a: 1\n", "neither camera_matrix"),
        ("a.yaml", "- 1\n", "not a mapping"),
        ("a.yaml", OPENCV.replace("610.5, 0.,", "610.5, 3.,"), "skew 3; lenses have none"),
        ("a.yaml", OPENCV.replace("610.5", ".nan"), "else than finite numbers"),
        ("a.yaml", OPENCV.replace("0., 0., 1.", "1."), "camera_matrix: 7 numbers"),
        ("a.yaml", OPENCV.replace("480", "400"), "another aspect"),
        ("a.xml", "<opencv_storage><a>", "not valid XML"),
        ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "not valid XML"),
        ("a.json", '{"camera_model": "OPENCV", "fl_x": 3}', "fl_x, cx and cy are needed"),
        ("a.json", '{"camera_model": "FULL_OPENCV"}', "'FULL_OPENCV' is not one of OPENCV"),
    ],
)
def test_files_that_are_no_lens_are_refused(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    if "omni" in message:
        text = "cam2" + text.split("cam2")[1]
    path = written(tmp_path, name, text)
    with pytest.raises(ParameterError, match=message) as caught:
        build_params({"image": {"lens": {"calibration": str(path)}}})
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_a_thin_prism_is_refused(tmp_path: Path) -> None:
    text = OPENCV.replace("0. ]\n", "0., 0, 0, 0, 0.01, 0, 0, 0 ]\n")
    with pytest.raises(ParameterError, match="those from the ninth on"):
        read_calibration(written(tmp_path, "a.yaml", text))
