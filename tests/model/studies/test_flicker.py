"""The flicker study: what it says of things whose motion is known."""

import json
from pathlib import Path

import numpy as np
import pytest

from pbrnet.model.data.reader import Example
from pbrnet.model.studies.flicker.study import FlickerConfig, flicker, move_cameras, reproject
from pbrnet.pipeline.params import Params
from tests.fixtures.command import printed, refused
from tests.fixtures.model import made_example
from tests.fixtures.predict import box_camera, box_room
from tests.fixtures.predictor import untrained_models
from tests.fixtures.study import report_in

WIDTH, HEIGHT = 64, 48
VIEW = box_camera("v0", (WIDTH, HEIGHT), (2.0, 1.0, 1.5), (0, 1, 0))


def plane(depth: float) -> Example:
    """A wall that faces the camera, `depth` metres ahead."""
    whole = np.full((HEIGHT, WIDTH), depth, np.float32)
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    return made_example(VIEW.intrinsics, depth=whole, normal=rgb, reflectance=rgb, valid=whole > 0)


def picture(seed: int = 0) -> np.ndarray:
    """Noise: wrong by any fraction of a pixel, it differs."""
    return np.random.default_rng(seed).random((HEIGHT, WIDTH, 3), np.float32)


@pytest.mark.parametrize("pixels", [1, 5])
def test_a_plane_that_faces_the_camera_shifts_by_focal_length_over_depth(pixels: int) -> None:
    """A step to the right of `pixels` x depth / focal moves the picture left by whole pixels."""
    depth = 2.5
    step = pixels * depth / VIEW.intrinsics[0, 0]
    first, second = move_cameras(VIEW, FlickerConfig("truck", 2, step))
    before = picture()
    after = np.roll(before, -pixels, axis=1)
    after[:, -pixels:] = 7.0  # comes into view: must not be looked at
    found = reproject(plane(depth), plane(depth), first.pose, second.pose)
    places, seen = found
    assert seen.sum() == HEIGHT * (WIDTH - pixels) and not seen[:, -pixels:].any()
    assert flicker([before, after], [found]).mean == 0
    wrong = flicker([before, before], [found]).mean
    assert wrong == pytest.approx(1 / 3, abs=0.02)  # of two independent numbers from [0, 1]
    assert np.allclose(places[1][seen] - np.nonzero(seen)[1], pixels)


def test_a_static_camera_gives_nothing() -> None:
    first, second = move_cameras(VIEW, FlickerConfig("still", 2, 1.0))
    found = reproject(plane(2), plane(2), first.pose, second.pose)
    assert found[1].all()
    assert flicker([picture(), picture()], [found]).mean == 0
    assert flicker([picture(), picture() + 0.25], [found]).mean == pytest.approx(0.25)


def test_a_dolly_magnifies_about_the_centre() -> None:
    """1 m nearer to a wall 4 m away: what is now at x from the centre was at 3/4 x."""
    first, second = move_cameras(VIEW, FlickerConfig("dolly", 2, 1.0))
    (_, columns), seen = reproject(plane(4), plane(3), first.pose, second.pose)
    now = np.arange(WIDTH) + 0.5 - WIDTH / 2
    assert seen.all()
    assert np.allclose(columns[0] + 0.5 - WIDTH / 2, 0.75 * now)


def test_a_pan_turns_right_and_has_no_parallax() -> None:
    first, second = move_cameras(VIEW, FlickerConfig("pan", 2, 10.0))
    assert first.eye == pytest.approx(second.eye)
    assert second.pose[:3, 2] @ first.pose[:3, 0] == pytest.approx(np.sin(np.radians(10)))
    # the new centre was 10 degrees to the right, whatever its depth
    for depth in (1.0, 50.0):
        (_, columns), _ = reproject(plane(depth), plane(depth), first.pose, second.pose)
        middle = 0.5 * (columns[24, 31] + columns[24, 32]) + 0.5 - WIDTH / 2
        assert middle == pytest.approx(np.tan(np.radians(10)) * VIEW.intrinsics[0, 0], rel=1e-3)


def test_what_was_hidden_before_is_not_compared() -> None:
    """A box 1 m away before a wall at 3 m: where depths differ, nothing is seen in both."""
    before, after = plane(3), plane(3)
    box = before["depth"].copy()
    box[10:20, 10:20] = 1
    _, seen = reproject(before.having(depth=box), after, VIEW.pose, VIEW.pose)
    assert not seen[10:20, 10:20].any() and seen[:, 25:].all()
    holes = before["valid"].copy()
    holes[30:] = False
    _, seen = reproject(before.having(valid=holes), after, VIEW.pose, VIEW.pose)
    assert not seen[30:].any() and seen[:29].all()


@pytest.fixture()
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A grey box with a lamp, a camera, and networks, in the working folder."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text(
        "groundtruth: {spp: 16, block_spp: 16}\nillumination: {width: 32}\n"
    )
    folder = box_room(Path("data"), VIEW, lamp=(2, 4, 2.2))
    untrained_models(Path("models"), ("shading", "composition", "unet", "hybrid"), levels=2)
    return folder


@pytest.mark.slow
def test_the_command_measures_networks_beside_the_renderer(room: Path) -> None:
    words = ["study", "flicker", str(room), "--view", "v0", "--frames", "3", "--size", "40x30"]
    printed(*words, "--method", "pbrnet", "--method", "unet")
    result = json.loads(Path("metrics/studies/flicker.json").read_text())
    assert list(result["methods"]) == ["pbrnet", "renderer", "renderer_one_exposure", "unet"]
    assert all(len(one["pairs"]) == 2 for one in result["methods"].values())
    assert 0.8 < result["visible"] < 1
    assert 0 < result["methods"]["renderer"]["mean"] < 0.2
    assert Path("metrics/studies/flicker.png").is_file()
    chosen = ["--method", "pbrnet", "--method", "hybrid"]
    printed(*words, "--move", "still", *chosen)
    result = json.loads(Path("metrics/studies/flicker.json").read_text())
    assert result["methods"]["pbrnet"]["mean"] == 0 and result["visible"] == 1
    assert result["methods"]["renderer"]["mean"] > 0  # its noise
    drawn = ("radiosity", "denoised", "hybrid")  # from random numbers of each frame's own
    transport, samples, corrected = (result["methods"][name]["mean"] for name in drawn)
    assert 0 < transport < samples and corrected > 0


def test_the_report_shows_it_and_notes_a_damaged_one(room: Path, tmp_path: Path) -> None:
    words = ["study", "flicker", str(room), "--view", "v0", "--frames", "2", "--size", "40x30"]
    printed(*words, "--move", "pan", "--method", "product")
    path = Path("metrics/studies/flicker.json")
    result = json.loads(path.read_text())
    times = result["methods"]["product"]["mean"] / result["methods"]["renderer"]["mean"]
    page, _ = report_in(tmp_path, Params())
    assert (
        "Temporal stability along a camera move" in page and "a turn of 0.5° to the right" in page
    )
    assert (
        f'<td class="n">{times:.2f}</td>' in page
        and f"{result['methods']['product']['mean']:.4f}<small>" in page
    )
    assert page.count('alt="First, middle and last frame') == 1
    path.write_text(json.dumps(result | {"move": "loop"}))
    path.with_suffix(".png").write_bytes(b"no picture")
    page, notes = report_in(tmp_path, Params())
    assert any("flicker.json.move: 'loop' is not one of" in note for note in notes)
    assert "Temporal stability" not in page


def test_a_wall_in_the_way_is_said(room: Path) -> None:
    words = ["study", "flicker", str(room), "--view", "v0", "--step", "2", "--frames", "3"]
    assert "an obstacle is 4.00 m away" in refused(*words)
