"""Equirectangular views: geometry in closed form, and every set of channels that they have."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.model.data.reader import Dataset
from pbrnet.pipeline.cameras.view_sampling import sample_cameras
from pbrnet.pipeline.channels import BUMPED, DIRECT, NORMAL, RGB, TRACED
from pbrnet.pipeline.dataset.agreement import label_fault, material_fault, world_points
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Channels, Frame
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.environment import render_environment, settings
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.settings import EnvironmentParams
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import ImageParams, View
from pbrnet.scenes.checked import build
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError, ParameterError
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.light import room
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth, view_params
from tests.fixtures.render import make_view
from tests.fixtures.stages import write_room
from tests.fixtures.traces import render

WIDTH, HEIGHT = 48, 24
IMAGE = ImageParams(WIDTH, HEIGHT, projection="equirectangular")
# Tilted and rolled: a transposed rotation, or a mirrored axis, is another one.
FLAT = make_view((0.3, -0.4, 1.4), (1, 0.6, -0.5), (WIDTH, HEIGHT), up=(0.3, 0, 1))
VIEW = replace(FLAT, K=(), projection="equirectangular")
TRUTH = plain_truth(spp=4, block_spp=2, max_depth=4, rr_depth=100)
PARAMS = pbrs_params(image=IMAGE, channels=("light",), groundtruth=TRUTH)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory, wavefront: str) -> RenderScene:
    return open_scene(room(tmp_path_factory.mktemp("panorama") / "home"))


def test_surfaces_lie_along_the_documented_directions(home: RenderScene) -> None:
    """Row, column and depth give a point of the box room; all walls are seen."""
    inputs = render_inputs(home, VIEW)
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    azimuth, elevation = 2 * np.pi * column / WIDTH - np.pi, np.pi / 2 - np.pi * row / HEIGHT
    right, down, ahead = VIEW.pose[:3, :3].T
    across = np.cos(elevation) * np.sin(azimuth)
    along = np.cos(elevation) * np.cos(azimuth)
    turned = across[..., None] * right - np.sin(elevation)[..., None] * down
    rays = turned + along[..., None] * ahead
    points = VIEW.eye + rays * inputs["Z"][..., None]
    walls = inputs["object"] == 1
    low, high = np.array([-2, -2, 0]), np.array([2, 2, 3])
    off = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=-1)
    assert walls.mean() > 0.8 and off[walls].max() < 1e-5
    np.testing.assert_allclose(world_points(inputs["Z"], VIEW), points, atol=1e-9)
    for axis, edge in ((0, -2), (0, 2), (1, -2), (2, 0), (2, 3)):
        assert (np.abs(points[walls][:, axis] - edge) < 1e-5).any()


def panorama(home: RenderScene, spp: int) -> Channels:
    """Channels of the environment of `FLAT`."""
    own = settings(TRUTH, EnvironmentParams(WIDTH, spp))
    return render_environment(home, FLAT, own, 1)["environment"][0]


def test_its_geometry_is_that_of_its_environment(home: RenderScene) -> None:
    inputs = render_inputs(home, VIEW)
    around = panorama(home, 1)
    np.testing.assert_array_equal(inputs["Z"], around["distance.Z"])
    for band in NORMAL:
        np.testing.assert_array_equal(inputs[band], around[band])


def test_its_light_is_that_of_its_environment_and_adds_up(home: RenderScene) -> None:
    """Without roulette both are the same paths; the neutral twin is traced along with them."""
    made = render(TRACED, home, VIEW, PARAMS, 1)
    around = panorama(home, 4)
    color = np.stack([made["color"][0][band] for band in RGB])
    np.testing.assert_allclose(color, np.stack([around[band] for band in RGB]), rtol=1e-3)
    assert made["shading"][0]["R"].std() > 0
    direct = np.stack([made["light"][0][band] for band in DIRECT])
    assert (direct <= color * 1.001 + 1e-3).all() and 0.1 < direct.sum() / color.sum() < 0.9


def test_materials_and_labels_pass_the_checks_of_the_dataset(home: RenderScene) -> None:
    made = render_surfaces(home, VIEW, ("inputs", "materials", "labels"))
    inputs, (materials, names), (labels, tables) = made["inputs"][0], *list(made.values())[1:]
    assert material_fault(Frame(materials, names), inputs) is None
    assert label_fault(Frame(labels, tables), Frame(materials, names), inputs, VIEW) is None
    assert {entry["truncation"] for entry in tables["instances"]} == {0}
    np.testing.assert_array_equal(materials[BUMPED[0]], inputs[NORMAL[0]])


def test_sampled_panoramas_stand_level_and_differ(tmp_path: Path, wavefront: str) -> None:
    write_room(tmp_path / "living")
    scene = open_scene(load_scene(tmp_path / "living"))
    params = replace(PARAMS, cameras=pbrs_cameras(views_per_room=6))
    views = sample_cameras(scene, view_params(params), 0).views
    assert views and all(view.K == () and view.pose[2, 2] == 0 for view in views)
    assert [view.width for view in views] == [WIDTH] * len(views)
    with pytest.raises(InputError, match="is equirectangular; this needs a perspective view"):
        _ = views[0].intrinsics


def test_the_dataset_says_what_its_rows_are(tmp_path: Path) -> None:
    params = replace(small_params(), image=ImageParams(32, 16, projection="equirectangular"))
    data = make_data(tmp_path, params, scenes=3, views=2)
    assert pack_dataset(data, params).total == 6
    shard = next((data / "dataset").glob("train-*.parquet"))
    table = pq.read_table(shard)
    assert table["K"].null_count == len(table) > 0
    assert set(table["projection"].to_pylist()) == {"equirectangular"}
    field = table.schema.field("depth")
    assert json.loads(field.metadata[b"shape"]) == [16, 32]
    assert b"not z-depth" in field.metadata[b"description"]
    with pytest.raises(InputError, match="the networks take perspective ones"):
        Dataset(data / "dataset", "train")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": {"width": 64, "height": 48}}, "the width is twice the height"),
        ({"channels": ["all"]}, "channels: all needs image.projection: perspective"),
        ({"channels": ["video"]}, "channels: video needs"),
        ({"cameras": {"stereo_baseline": 0.1}}, "cameras.stereo_baseline: not with"),
        ({"groundtruth": {"joint": False}}, "groundtruth.joint: false needs"),
    ],
)
def test_what_panoramas_cannot_have_is_refused(changes: dict[str, object], message: str) -> None:
    image = {"width": 64, "height": 32}
    cameras = {"framing": "paper", "pitch": [], "roll": []}
    given: dict[str, Any] = {"image": image, **changes}
    given["cameras"] = {**cameras, **given.get("cameras", {})}
    given["image"] = {**given["image"], "projection": "equirectangular"}
    with pytest.raises(ParameterError, match=message):
        build(Params, given)


def test_views_without_k_say_so() -> None:
    with pytest.raises(ValueError, match="twice as wide as high and has no K"):
        replace(VIEW, K=FLAT.K).verify("view")
    with pytest.raises(ValueError, match="K: must be 3x3"):
        replace(FLAT, K=()).verify("view")
    assert build(View, {**_plain(VIEW)}, "view") == VIEW


def _plain(view: View) -> dict[str, object]:
    pose = [list(row) for row in view.camera_to_world]
    size = {"width": view.width, "height": view.height}
    names = {"scene_id": view.scene_id, "view_id": view.view_id}
    return {**names, **size, "K": [], "camera_to_world": pose, "projection": view.projection}
