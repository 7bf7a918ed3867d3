"""Flow and occlusion: analytic scenes, and the check against depth and cameras with its mutants."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.channels import VIDEO_BANDS
from pbrnet.pipeline.dataset.agreement import flow_fault
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View, as_matrix, look
from tests.fixtures.render import diffuse, make_view, quad, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("variant")
FOCAL = 32 * 0.8
ROUNDED = 0.5 / 1024 + 1e-6  # pixels
X, Y, HIDDEN, OUTSIDE = VIDEO_BANDS["forward"]


def render_video(scene: RenderScene, view: View) -> Channels:
    return render_surfaces(scene, view, ["video"])["video"][0]


def opened(folder: Path, shapes: dict[str, str]) -> RenderScene:
    objects = {name: (name,) for name in shapes}
    return open_scene(write_scene(folder / "scene", "".join(shapes.values()), objects))


def board(name: str, centre: tuple[float, float, float], half: tuple[float, float]) -> str:
    return quad(name, centre, (0, -1, 0), half, diffuse())


def moved(
    view: View, eye: tuple[float, float, float], towards: tuple[float, float, float] = (0, 1, 0)
) -> View:
    """The view with a next frame from another camera."""
    return replace(view, pose_after=as_matrix(look(eye, towards)))


def test_flow_of_a_wall_beside_a_moving_camera(tmp_path: Path) -> None:
    scene = opened(tmp_path, {"wall": board("wall", (0, 4, 1.5), (9, 9))})
    frame = render_video(scene, moved(make_view(), (0.3, 0, 1.4)))
    # The camera goes right and down: what it sees goes left and up, by focal length / depth.
    np.testing.assert_allclose(frame[X], -FOCAL * 0.3 / 4, atol=ROUNDED)
    np.testing.assert_allclose(frame[Y], -FOCAL * 0.1 / 4, atol=ROUNDED)
    columns = np.arange(32) + 0.5 - FOCAL * 0.3 / 4
    np.testing.assert_array_equal(frame[OUTSIDE][5] > 0, columns < 0)
    assert not frame[HIDDEN].any()


def test_flow_towards_a_wall_spreads_from_the_middle(tmp_path: Path) -> None:
    scene = opened(tmp_path, {"wall": board("wall", (0, 4, 1.5), (9, 9))})
    frame = render_video(scene, moved(make_view(), (0, 1, 1.5)))
    x = np.arange(32) + 0.5 - 16
    np.testing.assert_allclose(frame[X], np.tile(x * (4 / 3 - 1), (24, 1)), atol=ROUNDED)


def test_a_board_hides_what_is_behind_it(tmp_path: Path) -> None:
    """The camera moves right: the board's image, nearer, moves left farther than the wall's."""
    shapes = {
        "board": board("board", (0, 2, 1.5), (0.5, 9)),
        "wall": board("wall", (0, 4, 1.5), (9, 9)),
    }
    scene = opened(tmp_path, shapes)
    frame = render_video(scene, moved(make_view(), (0.4, 0, 1.5)))
    x = np.arange(32) + 0.5 - 16  # pixels from the axis
    on_board = np.abs(x) < FOCAL * 0.5 / 2
    then = x - FOCAL * 0.4 / 4  # of the wall's points
    behind = ~on_board & (np.abs(then + FOCAL * 0.4 / 2) < FOCAL * 0.5 / 2)
    outside = np.where(on_board, x - FOCAL * 0.4 / 2, then) < -16
    np.testing.assert_array_equal(frame[HIDDEN][9] > 0, behind & ~outside)
    assert behind.sum() == 2 or behind.sum() == 3
    np.testing.assert_allclose(frame[X][9][on_board], -FOCAL * 0.4 / 2, atol=ROUNDED)


def test_what_shows_only_between_pixels_is_hidden(tmp_path: Path) -> None:
    """A slit of a fifth of a pixel: a ray passes it, but no pixel of the next frame shows the wall.

    The camera at x = 1.5 sees the wall beside the boards, the next one behind them, its places at
    a tenth of a pixel; there is the slit, between pixels' centres.
    """
    pixel = 2 / FOCAL  # metres at the boards' distance
    boards = {
        side: board(side, (0.1 * pixel + sign * (0.3 + 0.1 * pixel), 2, 1.5), (0.3, 9))
        for side, sign in (("left", -1), ("right", 1))
    }
    scene = opened(tmp_path, {**boards, "wall": board("wall", (0, 4, 1.5), (9, 9))})
    here = replace(make_view(), camera_to_world=as_matrix(look((1.5, 0, 1.5), (0, 1, 0))))
    frame = render_video(scene, moved(here, (0, 0, 1.5)))
    places = np.arange(32) + 0.5 + frame[X]
    wall = (render_inputs(scene, here)["Z"] > 3) & (frame[OUTSIDE] == 0)
    in_line = (wall & (np.abs(places - 16.1) < 0.01))[:-1]  # the last row lies on the border
    assert in_line.any() and frame[HIDDEN][:-1][in_line].all()
    assert not frame[HIDDEN][wall & (np.abs(places - 16) > 9)].any()


def test_the_back_of_a_thin_sheet_hides_its_front(tmp_path: Path) -> None:
    scene = opened(tmp_path, {"sheet": board("sheet", (0, 2, 1.5), (9, 9))})
    frame = render_video(scene, moved(make_view(), (0, 4, 1.5), (0, -1, 0)))
    assert (frame[HIDDEN] + frame[OUTSIDE] == 1).all() and frame[HIDDEN].any()


def test_the_sky_moves_as_the_camera_turns(tmp_path: Path) -> None:
    scene = opened(tmp_path, {"post": board("post", (1.0, 2, 1.5), (0.1, 9))})
    turn = 0.1
    view = make_view()
    frame = render_video(scene, moved(view, (0.9, 0, 1.5), (math.sin(turn), math.cos(turn), 0)))
    x = (np.arange(32) + 0.5 - 16) / FOCAL
    expected = FOCAL * np.tan(np.arctan(x) - turn) - FOCAL * x
    sky = render_inputs(scene, view)["valid"][12] == 0
    np.testing.assert_allclose(frame[X][12][sky], expected[sky], atol=ROUNDED)
    assert frame[HIDDEN][12][sky].any(), "the post covers other sky then"


def test_a_view_without_neighbours_has_no_flow(tmp_path: Path) -> None:
    scene = opened(tmp_path, {"wall": board("wall", (0, 4, 1.5), (9, 9))})
    frame = render_video(scene, make_view())
    for way in VIDEO_BANDS:
        x, y, hidden, outside = (frame[band] for band in VIDEO_BANDS[way])
        assert not x.any() and not y.any() and not hidden.any() and outside.all()


# The check of the dataset: a room with two boards, three frames.


class Film:
    """Frames 0, 1, 2 of a walk through a small room, with their inputs and flow."""

    def __init__(self, folder: Path) -> None:
        body, names = room_walls(diffuse())
        boards = {
            "near": board("near", (-0.4, 0.2, 1.5), (0.25, 0.6)),
            "far": board("far", (0.5, 1.2, 1.4), (0.3, 0.9)),
        }
        objects = {name: (name,) for name in (*names, *boards)}
        scene = open_scene(write_scene(folder / "room", body + "".join(boards.values()), objects))
        eyes = [(0.12 * n, -1.8 + 0.1 * n, 1.5) for n in range(3)]
        poses = [as_matrix(look(eye, (0.05 * n, 1, -0.1))) for n, eye in enumerate(eyes)]
        view = make_view(size=(64, 48))
        self.views = [
            replace(
                view,
                camera_to_world=pose,
                pose_before=poses[n - 1] if n else (),
                pose_after=poses[n + 1] if n < 2 else (),
            )
            for n, pose in enumerate(poses)
        ]
        self.scene = scene
        self.inputs = [render_inputs(scene, view) for view in self.views]
        self.video = [render_video(scene, view) for view in self.views]

    def fault(self, number: int, video: Channels) -> str | None:
        around = {"forward": number + 1, "backward": number - 1}
        known = {way: self.inputs[n] for way, n in around.items() if 0 <= n < 3}
        return flow_fault(video, self.inputs[number], self.views[number], known, CheckParams())


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, variant: str) -> Film:
    return Film(tmp_path_factory.mktemp("film"))


def test_rendered_flow_and_occlusion_agree_with_depth(film: Film) -> None:
    for number, video in enumerate(film.video):
        assert film.fault(number, video) is None
    assert film.video[1][HIDDEN].sum() > 30
    # Half floats keep the masks, and the flow is float32.
    stored = {
        name: values.astype(np.float32 if name[-1] in "XY" else np.float16)
        for name, values in film.video[1].items()
    }
    assert film.fault(1, stored) is None


def transposed(film: Film) -> Channels:
    pose = film.views[1].pose.copy()
    after = np.array(film.views[1].pose_after)
    after[:3, :3] = after[:3, :3].T
    assert not np.allclose(after[:3, :3], pose[:3, :3])
    return render_video(film.scene, replace(film.views[1], pose_after=as_matrix(after)))


def inverted(film: Film) -> Channels:
    frame = dict(film.video[1])
    frame[HIDDEN] = np.where(frame[OUTSIDE] > 0, 0, 1 - frame[HIDDEN])
    return frame


def swapped(film: Film) -> Channels:
    pairs = list(zip(*VIDEO_BANDS.values(), strict=True))
    names = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    return {names[name]: values for name, values in film.video[1].items()}


def with_band(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Film], Channels]:
    return lambda film: {**film.video[1], name: change(film.video[1][name])}


@pytest.mark.parametrize(
    ("mutant", "words"),
    [
        (lambda film: film.video[0], "is not there|flow is wrong"),
        (lambda film: film.video[2], "is not there|flow is wrong"),
        (transposed, "flow is wrong"),
        (swapped, "flow is wrong"),
        (inverted, "called hidden"),
        (with_band(HIDDEN, np.zeros_like), "called visible"),
        (with_band(HIDDEN, lambda band: np.roll(band, 6, axis=1)), "called|outside"),
        (with_band(OUTSIDE, np.zeros_like), "outside the image"),
        (with_band(X, lambda band: -band), "flow is wrong"),
        (with_band(X, lambda band: band + np.float32(0.02)), "by up to 0.02|by up to 0.0199"),
        (with_band(Y, lambda band: band.astype(np.float16) * np.float16(1.01)), "flow is wrong"),
    ],
    ids=[
        *("the frame before", "the frame after", "transposed pose", "time reversed"),
        *("occlusion inverted", "no occlusion", "occlusion shifted", "no outside"),
        *("x mirrored", "0.02 pixels off", "one per cent too long"),
    ],
)
def test_mutants_are_found(mutant: Callable[[Film], Channels], words: str, film: Film) -> None:
    fault = film.fault(1, mutant(film))
    assert fault is not None
    assert any(word in fault for word in words.split("|")), fault
