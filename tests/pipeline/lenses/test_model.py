"""Lens models: OpenCV's own figures, inversion, and where a lens ends."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.lenses.model import Lens, Projection
from pbrnet.pipeline.lenses.settings import lens_of
from pbrnet.pipeline.params import build_params
from pbrnet.pipeline.views import ImageParams, View, as_matrix
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import ParameterError

OPENCV = json.loads(Path(__file__).with_name("opencv.json").read_text())
K = tuple(map(tuple, OPENCV["K"]))
BARREL = (-0.28, 0.07, 0.0008, -0.0005)
BRANDT = (0.031, -0.012, 0.0041, -0.0009)
SIZE = (64, 48)


def lens(projection: Projection, distortion: tuple[float, ...] = (), focal: float = 30.0) -> Lens:
    """A small image whose middle is off its centre, and whose pixels are not square."""
    matrix = ((focal, 0.0, 33.0), (0.0, 1.02 * focal, 23.5), (0.0, 0.0, 1.0))
    return Lens(projection, *SIZE, matrix, distortion)


def centres(width: int = SIZE[0], height: int = SIZE[1]) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


@pytest.mark.parametrize("name", ["four", "five", "eight", "fisheye"])
def test_points_are_projected_as_by_opencv(name: str) -> None:
    reference = OPENCV[name]
    projection: Projection = "fisheye" if name == "fisheye" else "perspective"
    own = Lens(projection, 640, 480, K, tuple(reference["distortion"]))
    places, valid = own.project(np.array(reference["points"]))
    assert valid.all()
    np.testing.assert_allclose(places, reference["pixels"], atol=1e-8)


@pytest.mark.parametrize(
    ("projection", "distortion"),
    [
        ("perspective", ()),
        ("perspective", BARREL),
        ("perspective", (0.42, 0.051, -0.0004, 0.0007, 0.0019, 0.81, 0.17, 0.0081)),
        ("fisheye", ()),
        ("fisheye", BRANDT),
        ("orthographic", ()),
    ],
)
def test_rays_lead_back_to_their_pixels(
    projection: Projection, distortion: tuple[float, ...]
) -> None:
    own = lens(projection, distortion)
    rays = own.rays()
    assert rays.valid.all()
    np.testing.assert_allclose((rays.directions**2).sum(axis=-1), 1, atol=1e-14)
    for metres in (0.3, 7.0):
        places, valid = own.project(rays.origins + metres * rays.directions)
        assert valid.all()
        np.testing.assert_allclose(places, centres(), atol=1e-9)
    depth = np.full(own.rays().valid.shape, 2.5)
    places, _ = own.project(own.points(depth))
    np.testing.assert_allclose(places, centres(), atol=1e-9)


def test_an_equirectangular_image_shows_all_directions() -> None:
    own = Lens("equirectangular", 64, 32, ())
    places, valid = own.project(own.points(np.full((32, 64), 3.0)))
    assert valid.all()
    np.testing.assert_allclose(places, centres(64, 32), atol=1e-9)


def test_depth_is_along_the_axis_or_along_the_ray() -> None:
    depth = np.full((SIZE[1], SIZE[0]), 2.0)
    for projection in ("perspective", "orthographic"):
        points = lens(projection).points(depth)
        np.testing.assert_allclose(points[..., 2], 2, atol=1e-12)
    distorted = lens("perspective", BARREL).points(depth)
    np.testing.assert_allclose(distorted[..., 2], 2, atol=1e-12)
    for own in (lens("fisheye", BRANDT), Lens("equirectangular", 64, 32, ())):
        points = own.points(np.full((own.height, own.width), 2.0))
        np.testing.assert_allclose((points**2).sum(axis=-1), 4, atol=1e-12)


def test_a_fisheye_ends_110_degrees_from_its_axis() -> None:
    """Equidistant: the angle is proportional to the distance from the centre."""
    side = 440  # pixels for 240 degrees
    focal = side / math.radians(240)
    own = Lens("fisheye", side, side, ((focal, 0, 220.0), (0, focal, 220.0), (0, 0, 1)))
    rays = own.rays()
    away = np.sqrt(((centres(side, side) - 220) ** 2).sum(axis=-1))
    np.testing.assert_array_equal(rays.valid, away <= math.radians(110) * focal)
    angle = np.arccos(rays.directions[..., 2])
    np.testing.assert_allclose(angle[rays.valid], away[rays.valid] / focal, atol=1e-9)
    behind = np.array([[0.0, 0.1, -5.0], [0.0, 0.0, 0.0], [9.0, 0.0, -1.0]])
    assert own.project(behind)[1].tolist() == [False, False, True]


def test_an_image_that_folds_back_has_no_rays_beyond() -> None:
    """r - 0.3 r^3 is largest at r = 1.054, where it is 0.703."""
    own = lens("perspective", (-0.3, 0.0, 0.0, 0.0))
    assert own.plane.limit == pytest.approx(math.sqrt(1 / 0.9), rel=1e-9)
    rays = own.rays()
    away = np.sqrt((((centres() - (33, 23.5)) / (30, 30.6)) ** 2).sum(axis=-1))
    np.testing.assert_array_equal(rays.valid, away <= 0.702728)
    _, seen = own.project(np.array([[1.0, 0, 1], [1.2, 0, 1], [1.0, 0, -1]]))
    assert seen.tolist() == [True, False, False]


def test_straight_lines_bend_under_distortion_alone() -> None:
    """Points along a board's edge: their pixels lie on a line, or bulge away from the centre."""
    line = np.stack([np.linspace(-1, 1, 21), np.full(21, 0.6), np.full(21, 1.5)], axis=-1)
    for distortion, bulge in (((), 0.0), (BARREL, -1.0), ((0.2, 0.0, 0.0, 0.0), 1.0)):
        places, _ = lens("perspective", distortion).project(line)
        sagitta = places[[0, -1], 1].mean() - places[10, 1]
        assert abs(sagitta) < 1e-9 if not bulge else sagitta * bulge > 0.2


def test_orthographic_sizes_do_not_depend_on_distance() -> None:
    own = lens_of(ImageParams(200, 100, projection="orthographic"))
    ends = np.array([[-1.0, 0.5, 1.0], [1.0, 0.5, 1.0]])
    for metres in (0.5, 3.0):
        places, valid = own.project(ends + np.array([0, 0, metres]))
        assert valid.all()
        np.testing.assert_allclose(places, [[50, 75], [150, 75]], atol=1e-9)


def test_the_field_of_view_holds_with_distortion() -> None:
    for projection, half, distortion in (
        ("perspective", 0.7, [-0.2, 0.03, 0, 0]),
        ("fisheye", 1.9, [0.02, -0.01, 0.002, 0]),
        ("fisheye", 1.3, []),
    ):
        image = build_params(
            {
                "image": {
                    "projection": projection,
                    "half_fov_x": half,
                    "lens": {"distortion": distortion},
                }
            }
        ).image
        made = lens_of(image)
        view = View(
            "s", "v", made.width, made.height, made.K, as_matrix(np.eye(4)),
            projection=made.projection, distortion=made.distortion,
        )  # fmt: skip
        assert view.half_fov_x == pytest.approx(half, abs=1e-9)


def test_ranges_are_drawn_and_fixed_numbers_stay() -> None:
    image = build_params(
        {
            "image": {
                "lens": {"distortion": [[-0.3, -0.1], 0.02, 0, 0], "focal": [[90, 110]]},
            }
        }
    ).image
    draw = [lens_of(image, rng=np.random.default_rng(seed)) for seed in range(8)]
    assert len({own.distortion[0] for own in draw}) == 8
    assert all(-0.3 <= own.distortion[0] <= -0.1 and own.distortion[1] == 0.02 for own in draw)
    assert all(90 <= own.K[0][0] == own.K[1][1] <= 110 for own in draw)
    assert lens_of(image).distortion == (-0.2, 0.02, 0, 0)
    flat = {"width": 60, "projection": "orthographic", "lens": {"half_width": [2, 3]}}
    flat_image = build_params({"image": flat}).image
    assert 10 < lens_of(flat_image, rng=np.random.default_rng(1)).K[0][0] < 15
    assert lens_of(flat_image).K[0][0] == pytest.approx(12)


def test_plain_parameters_say_nothing_about_the_lens() -> None:
    assert "lens" not in plain(ImageParams(), brief=True)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ({"lens": {"distortion": [0.1]}}, "1 numbers; perspective images have one of 0, 4, 5, 8"),
        ({"projection": "orthographic", "lens": {"distortion": [0.1] * 4}}, "one of 0"),
        ({"lens": {"focal": [[3, 2]]}}, "a range is"),
        ({"projection": "orthographic", "lens": {"half_width": [3, 2]}}, "a range is"),
        ({"lens": {"focal": [1, 2, 3]}}, "0 or 1 or 2 numbers, not 3"),
        ({"half_fov_x": 1.5}, "from 0.05 to 1.4 with image.projection: persp"),
        ({"lens": {"camera": "cam1"}}, "needs lens.calibration"),
        ({"lens": {"distortion": [-0.6, 0, 0, 0]}, "half_fov_x": 1.2}, "folds the image back"),
        (
            {"projection": "equirectangular", "width": 64, "height": 32, "lens": {"focal": [3]}},
            "have no focal length and centre",
        ),
    ],
)
def test_impossible_lenses_are_refused(image: dict, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        build_params({"image": image})
