"""Views through lenses: channels of analytic scenes, flow, labels and traced light."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.cameras.camera_files import make_cameras
from pbrnet.pipeline.cameras.view_sampling import named_lens, sample_cameras
from pbrnet.pipeline.channels import NORMAL, RGB, VIDEO_BANDS
from pbrnet.pipeline.dataset.agreement import flow_fault, label_fault, world_points
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import Frame
from pbrnet.pipeline.lenses.model import Lens, world_rays
from pbrnet.pipeline.params import build_params
from pbrnet.pipeline.passes.groundtruth import render_both, render_color, render_truth
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.passes.video import reproject
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View, as_matrix, camera_model, look
from pbrnet.scenes.contract import load_scene
from tests.fixtures.light import room
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth, view_params
from tests.fixtures.render import diffuse, glow, quad, room_walls, write_scene
from tests.fixtures.stages import write_room

WIDTH, HEIGHT = 40, 30
TRUTH = plain_truth(spp=16, block_spp=8, max_depth=4, rr_depth=100)
LENSES = {
    "distorted": Lens(
        "perspective",
        WIDTH,
        HEIGHT,
        ((28.0, 0, 20.5), (0, 27.0, 14.5), (0, 0, 1)),
        (-0.2, 0.03, 0.001, -0.002, 0.0),
    ),
    "fisheye": Lens(
        "fisheye",
        WIDTH,
        HEIGHT,
        ((11.0, 0, 20), (0, 11.0, 15), (0, 0, 1)),
        (0.02, -0.004, 0.001, 0.0),
    ),
    "orthographic": Lens("orthographic", WIDTH, HEIGHT, ((20.0, 0, 20), (0, 20.0, 15), (0, 0, 1))),
}


def through(lens: Lens, eye: tuple = (0.3, -0.4, 1.4), towards: tuple = (1, 0.6, -0.2)) -> View:
    """A view that is tilted and rolled, so that a transposed rotation is another one."""
    pose = as_matrix(look(eye, towards, (0.2, 0, 1)))
    return View("test", "v", camera_to_world=pose, **camera_model(lens))


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory, wavefront: str) -> RenderScene:
    return open_scene(room(tmp_path_factory.mktemp("lenses") / "home"))


@pytest.mark.parametrize("name", LENSES)
def test_surfaces_lie_along_the_rays_of_the_lens(home: RenderScene, name: str) -> None:
    """Depth and lens give points of the box room, and these project to their pixels."""
    view = through(LENSES[name])
    inputs = render_inputs(home, view)
    points = world_points(inputs["Z"], view)
    seen = inputs["valid"] > 0
    low, high = np.array([-2, -2, 0]), np.array([2, 2, 3])
    walls = (inputs["object"] == 1) & seen
    off = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=-1)
    assert walls.mean() > 0.3 and off[walls].max() < 1e-5
    local = (points - view.eye) @ view.pose[:3, :3]
    places, valid = view.lens.project(local)
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    assert valid[seen].all()
    assert np.abs(places - np.stack([columns, rows], axis=-1))[seen].max() < 1e-3
    normals = np.stack([inputs[band] for band in NORMAL], axis=-1)
    directions = view.lens.rays().directions
    assert ((normals * directions).sum(axis=-1)[seen] < 0).all()


@pytest.mark.parametrize("name", LENSES)
def test_labels_and_flow_pass_the_checks_of_the_dataset(home: RenderScene, name: str) -> None:
    view = through(LENSES[name])
    after = look((0.33, -0.42, 1.42), (1, 0.55, -0.17), (0.2, 0, 1))
    view = replace(view, pose_after=as_matrix(after), trajectory="walk-00", frame=0)
    made = render_surfaces(home, view, ("inputs", "labels", "video"))
    inputs, (labels, tables), video = made["inputs"][0], made["labels"], made["video"][0]
    assert label_fault(Frame(labels, tables), None, inputs, view) is None
    there = render_inputs(home, replace(view, camera_to_world=as_matrix(after)))
    assert flow_fault(video, inputs, view, {"forward": there}, CheckParams()) is None
    columns, _, hidden, outside = (video[band] for band in VIDEO_BANDS["forward"])
    assert 0 < (outside > 0).mean() < 0.3 and np.abs(columns).max() > 0.1
    # What is visible there has the depth that the other view sees.
    found = reproject(inputs["Z"], view, after)
    clear = ~(hidden > 0).ravel() & found.inside & (inputs["valid"].ravel() > 0)
    column, row = np.floor(found.places[clear]).astype(int).T
    apart = np.abs(there["Z"][row, column] - found.depth[clear]) / found.depth[clear]
    assert (apart < 0.1).mean() > 0.9


def test_pixels_beyond_the_lens_show_nothing(home: RenderScene) -> None:
    """A fisheye of 220 degrees is a disc in a square image."""
    focal = 16 / math.radians(110)
    lens = Lens("fisheye", 32, 32, ((focal, 0, 16), (0, focal, 16), (0, 0, 1)))
    view = replace(through(lens), pose_before=through(lens).camera_to_world)
    made = render_surfaces(home, view, ("inputs", "labels", "video"))
    beyond = ~lens.rays().valid
    assert 0.15 < beyond.mean() < 0.25
    for channels in (made["inputs"][0], made["labels"][0]):
        for band, values in channels.items():
            assert not values[beyond].any(), band
    for way in ("forward", "backward"):
        assert (made["video"][0][VIDEO_BANDS[way][3]][beyond] == 1).all()
    entries = made["labels"][1]["instances"]
    assert sum(entry["pixels"] for entry in entries) <= (~beyond).sum()
    assert max(entry["pixels_alone"] for entry in entries) <= (~beyond).sum()
    color, _ = render_color(home, view, TRUTH, 1)
    assert not color["R"][beyond].any() and color["R"][~beyond].mean() > 0


def furnace(folder: Path) -> RenderScene:
    """A closed room whose walls reflect one half and emit one half: radiance 1 everywhere."""
    inside = diffuse(0.5) + '<emitter type="area"><rgb name="radiance" value="0.5"/></emitter>'
    body, shapes = room_walls(inside)
    return open_scene(write_scene(folder, body, {"walls": shapes}))


@pytest.mark.parametrize("name", LENSES)
def test_a_white_furnace_is_white_through_every_lens(
    tmp_path: Path, name: str, wavefront: str
) -> None:
    scene = furnace(tmp_path / "furnace")
    view = through(LENSES[name], eye=(0, 0, 1.5), towards=(0, 1, 0))
    truth = replace(TRUTH, spp=64, block_spp=64, max_depth=24)
    color, _ = render_color(scene, view, truth, 1)
    image = np.stack([color[band] for band in RGB])
    inside = render_inputs(scene, view)["valid"] > 0
    assert image[:, inside].mean() == pytest.approx(1, abs=0.01)


def test_a_disc_has_the_solid_angle_of_its_pixels(tmp_path: Path, wavefront: str) -> None:
    """A square lamp seen by a fisheye: its radiance times the pixels' solid angles is its own."""
    half, metres = 0.5, 1.0
    lamp = quad("lamp", (0, metres, 1.5), (0, -1, 0), (half, half), glow(1.0))
    scene = open_scene(write_scene(tmp_path / "lamp", lamp, {"lamp": ("lamp",)}))
    lens = Lens(
        "fisheye", 64, 64, ((20.0, 0, 32), (0, 20.0, 32), (0, 0, 1)), (0.05, -0.01, 0.0, 0.0)
    )
    view = through(lens, eye=(0, 0, 1.5), towards=(0, 1, 0))
    color, _ = render_color(scene, replace(view), replace(TRUTH, spp=64, block_spp=64), 1)
    edges = np.stack(np.meshgrid(np.arange(65.0), np.arange(65.0)), axis=-1)
    corners = lens.rays(edges).directions
    a, b, c, d = (corners[i : 64 + i, j : 64 + j] for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    angle = _triangles(a, b, c) + _triangles(a, c, d)
    expected = 4 * math.asin(half**2 / (half**2 + metres**2))  # of a square on its axis
    assert float((color["R"] * angle).sum()) == pytest.approx(expected, rel=0.004)


def _triangles(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Solid angles of spherical triangles (Van Oosterom and Strackee 1983)."""
    above = np.abs((a * np.cross(b, c)).sum(-1))
    below = 1 + (a * b).sum(-1) + (b * c).sum(-1) + (c * a).sum(-1)
    return 2 * np.arctan2(above, below)


def test_an_orthographic_image_has_sizes_in_metres(tmp_path: Path, wavefront: str) -> None:
    """Two boards of 0.5 m at 1 m and at 3 m cover 10 pixels each at 20 pixels per metre."""
    boards = [
        quad(name, (x, y, 1.5), (0, -1, 0), (0.25, 0.25), diffuse())
        for name, x, y in (("near", -0.5, 1.0), ("far", 0.5, 3.0))
    ]
    objects = {name: (name,) for name in ("near", "far")}
    scene = open_scene(write_scene(tmp_path / "boards", "".join(boards), objects))
    view = through(LENSES["orthographic"], eye=(0, 0, 1.5), towards=(0, 1, 0))
    view = replace(view, camera_to_world=as_matrix(look((0, 0, 1.5), (0, 1, 0))))
    inputs = render_inputs(scene, view)
    for number, metres in ((1, 1.0), (2, 3.0)):
        here = inputs["object"] == number
        assert here.sum() == 100
        np.testing.assert_allclose(inputs["Z"][here], metres, atol=1e-6)
    assert [np.nonzero(inputs["object"] == number)[1].min() for number in (1, 2)] == [5, 25]


def test_a_lens_without_distortion_sees_what_mitsubas_camera_sees(home: RenderScene) -> None:
    """The same pinhole by rays made here, forced by pixels that are hardly not square."""
    matrix = ((28.0, 0, 20), (0, 28.0, 15), (0, 0, 1))
    plain = through(Lens("perspective", WIDTH, HEIGHT, matrix))
    other = replace(plain, K=((28.0, 0, 20), (0, 28.001, 15), (0, 0, 1)))
    assert plain.lens.is_pinhole and not other.lens.is_pinhole
    truth = replace(TRUTH, spp=256, block_spp=64)
    one, two = (render_both(home, view, truth, 0.5, 1) for view in (plain, other))
    for first, second in ((one.color, two.color), (one.shading, two.shading)):
        means = [np.stack([image[0][band] for band in RGB]).mean() for image in (first, second)]
        assert means[0] == pytest.approx(means[1], rel=0.02)
    error = np.abs(one.color[0]["R"] - two.color[0]["R"]).mean() / one.color[0]["R"].mean()
    assert error < 0.2


def test_colour_alone_and_with_shading_agree_through_a_lens(home: RenderScene) -> None:
    view = through(LENSES["fisheye"])
    truth = replace(TRUTH, spp=64, block_spp=64)
    alone, _ = render_truth(home, view, truth, 1)
    joint = render_both(home, view, truth, 0.5, 1).color[0]
    assert alone["R"].mean() == pytest.approx(joint["R"].mean(), rel=0.05)


def test_sampled_views_have_the_lens(tmp_path: Path, wavefront: str) -> None:
    write_room(tmp_path / "living")
    scene = open_scene(load_scene(tmp_path / "living"))
    lens = {"distortion": [[0.0, 0.05], 0.0, 0.0, 0.0]}
    image = {"width": WIDTH, "height": HEIGHT, "projection": "fisheye", "half_fov_x": 1.4}
    own = build_params({"image": {**image, "lens": lens}}).image
    params = pbrs_params(image=own, cameras=pbrs_cameras(views_per_room=4))
    views = sample_cameras(scene, view_params(params), 0).views
    again = sample_cameras(scene, view_params(params), 0).views
    assert len(views) > 1 and views == again
    assert len({view.distortion for view in views}) == len({view.sector for view in views})
    for view in views:
        view.verify("view")
        assert view.projection == "fisheye" and view.half_fov_x == pytest.approx(1.4, abs=1e-6)


def test_orthographic_views_begin_in_their_room(tmp_path: Path, wavefront: str) -> None:
    write_room(tmp_path / "living")
    scene = open_scene(load_scene(tmp_path / "living"))
    image = {"width": WIDTH, "height": HEIGHT, "projection": "orthographic"}
    own = build_params({"image": {**image, "lens": {"half_width": 1.2}}}).image
    chosen = pbrs_cameras(views_per_room=6, max_near=0.1, near=0.05)
    params = pbrs_params(image=own, cameras=chosen)
    views = sample_cameras(scene, view_params(params), 0).views
    assert len(views) > 1
    (living,) = scene.scene.rooms
    low = [*np.min(living.floor, axis=0), living.floor_z]
    high = [*np.max(living.floor, axis=0), living.ceiling_z]
    for view in views:
        starts = world_rays(view.lens, view.pose)[0]
        assert ((starts < low) | (starts > high)).any(axis=1).mean() < 0.15


def test_a_stored_field_of_view_is_that_of_a_pinhole() -> None:
    for image, half in (({}, 0.4), ({"projection": "fisheye", "half_fov_x": 1.7}, 1.7)):
        own = build_params({"image": image}).image
        lens = named_lens(view_params(pbrs_params(image=own)), 0.4, 0, "home", "stored-a")
        assert through(lens).half_fov_x == pytest.approx(half)


def test_walks_pairs_and_sets_share_a_lens(tmp_path: Path, wavefront: str) -> None:
    write_room(tmp_path / "living")
    scene = open_scene(load_scene(tmp_path / "living"))
    lens = {"distortion": [[0.0, 0.05], 0.0, 0.0, 0.0]}
    image = {"width": WIDTH, "height": HEIGHT, "projection": "fisheye", "half_fov_x": 1.2}
    own = build_params({"image": {**image, "lens": lens}}).image
    linked = {"walks": 1, "stereo_baseline": 0.05, "overlap_views": 2, "overlap": 0.05}
    params = pbrs_params(image=own, cameras=pbrs_cameras(**linked, candidates=4, views_per_room=1))
    views = {view.view_id: view for view in make_cameras(scene, view_params(params), 0).views}
    pairs = [(views[view.stereo_partner], view) for view in views.values() if view.stereo_partner]
    walk = [view for view in views.values() if view.trajectory == "walk-00"]
    sets = [view for view in views.values() if view.view_set]
    assert len(pairs) > 10 and len(walk) == 24 and len(sets) >= 2
    assert all(one.lens == other.lens for one, other in pairs)
    assert len({view.lens for view in walk}) == 1
    assert len({view.lens for view in sets}) == 1 and sets[0].set_overlap > 0.05
