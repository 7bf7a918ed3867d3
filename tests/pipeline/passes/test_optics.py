"""Lens and shutter in frames: colour alone changes, fingerprints tell, rows say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.dataset.checks import check_light, load_frames
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.frames import frame_path, read_frame, write_frame
from pbrnet.pipeline.lenses.settings import OpticsParams
from pbrnet.pipeline.params import Params, build_params
from pbrnet.pipeline.passes.registry import TRACE_OF, settings_of
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.optics import optics_of
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import as_matrix, look
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import load_scene, save_scene
from pbrnet.scenes.errors import InputError, ParameterError
from tests.fixtures.dataset import make_data, small_params, write_view
from tests.fixtures.params import pbrs_params, plain_truth
from tests.fixtures.render import diffuse, glow, make_view, quad, room_walls, write_scene
from tests.fixtures.stages import views_in
from tests.fixtures.traces import frame_fingerprint, render

SHARP = pbrs_params(
    groundtruth=replace(plain_truth(spp=4, block_spp=2, max_depth=3), denoise="oidn"),
    noisy=NoisyParams(spp=2),
)
LENS = replace(SHARP, optics=OpticsParams(f_number=2.0, sensor_width=36.0))
MOVING = replace(SHARP, optics=OpticsParams(exposure=0.5, readout=0.25, frame_rate=25.0))
VIEW = replace(
    make_view((0.2, -1.6, 1.5), (0, 1, 0), (32, 24)),
    trajectory="walk-00",
    frame=1,
    pose_before=as_matrix(look((0.1, -1.6, 1.5), (0, 1, 0))),
    pose_after=as_matrix(look((0.3, -1.6, 1.5), (0.1, 1, 0))),
)
OTHER = replace(VIEW, pose_after=as_matrix(look((0.4, -1.6, 1.5), (0, 1, 0))))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    """A room of grey walls with a lamp, its north wall 3.6 m before the camera."""
    walls, _ = room_walls(diffuse("0.6,0.5,0.4"))
    lamp = quad("lamp", (-0.5, 0.5, 2.9), (0, 0, -1), (0.4, 0.4), glow("8,6,4"), (0, 1, 0))
    return open_scene(write_scene(tmp_path_factory.mktemp("optics") / "room", walls + lamp))


def test_without_options_settings_and_fingerprints_are_those_of_before() -> None:
    for kind, own in settings_of(SHARP, ["shading", "color", "light", "noisy"]).items():
        assert "optics" not in plain(own, brief=True), kind
    unused = replace(SHARP, optics=OpticsParams(blades=6, focus_distance=2.0))
    assert settings_of(unused, ["color"]) == settings_of(SHARP, ["color"])


@pytest.mark.parametrize("params", [LENS, MOVING])
def test_colour_alone_depends_on_lens_and_shutter(params: Params) -> None:
    sharp: tuple[Kind, ...] = ("inputs", "labels", "shading", "environment")
    for kind in sharp:
        assert fingerprints(kind, params, VIEW) == fingerprints(kind, SHARP, VIEW)
    of_lens: tuple[Kind, ...] = ("color", "noisy")
    for kind in of_lens:
        assert fingerprints(kind, params, VIEW) != fingerprints(kind, SHARP, VIEW)
        assert fingerprints(kind, SHARP, OTHER) == fingerprints(kind, SHARP, VIEW)
        moves = fingerprints(kind, params, OTHER) != fingerprints(kind, params, VIEW)
        assert moves == params.optics.moves
    settings = settings_of(params, ["color", "shading"])
    assert not TRACE_OF["color"].together(settings["color"])
    assert TRACE_OF["color"].together(settings["shading"])


def fingerprints(kind: Kind, params: Params, view: Any) -> str:
    return frame_fingerprint(kind, view, params, "scene", "renderer")


@pytest.mark.usefixtures("wavefront")
def test_frames_through_a_lens(room: RenderScene) -> None:
    sharp = render(["shading", "color"], room, VIEW, SHARP, 5)
    blurred = render(["shading", "color"], room, VIEW, LENS, 5)
    for band in "RGB":
        np.testing.assert_array_equal(sharp["shading"][0][band], blurred["shading"][0][band])
    stats = blurred["color"][1]
    assert stats["f_number"] == 2.0 and "exposure_time" not in stats
    assert stats["focus_distance"] == pytest.approx(3.6, abs=1e-3)
    assert stats["spp"] == 4 and 0 < stats["residual_noise"] < 1
    means = [np.mean([image["color"][0][band] for band in "RGB"]) for image in (sharp, blurred)]
    assert means[1] == pytest.approx(means[0], rel=0.1) and means[0] != means[1]
    again = render(["color"], room, VIEW, LENS, 5)["color"]
    assert all((again[0][band] == blurred["color"][0][band]).all() for band in "RGB")


@pytest.mark.usefixtures("wavefront")
def test_noisy_frames_have_the_colour_of_the_lens_and_sharp_shading(room: RenderScene) -> None:
    sharp, moving = (render(["noisy"], room, VIEW, each, 5)["noisy"] for each in (SHARP, MOVING))
    np.testing.assert_array_equal(sharp[0]["shading.R"], moving[0]["shading.R"])
    assert (sharp[0]["R"] != moving[0]["R"]).any() and (moving[0]["half.R"] != moving[0]["R"]).any()
    assert moving[1]["exposure_time"] == 0.5 / 25 and moving[1]["readout_time"] == 0.25 / 25


@pytest.mark.usefixtures("wavefront")
def test_the_aperture_follows_from_k_and_the_sensor(room: RenderScene) -> None:
    lens = optics_of(room, VIEW, LENS.optics).aperture
    assert lens is not None
    focal = VIEW.K[0][0] / VIEW.width * 36.0  # millimetres
    assert 2 * lens.radius * 2.0 == pytest.approx(focal / 1000)
    assert lens.focus == pytest.approx(3.6, abs=1e-3)
    near = optics_of(room, VIEW, replace(LENS.optics, focus_distance=0.7)).aperture
    assert near is not None and near.focus == 0.7
    whole = optics_of(room, VIEW, replace(LENS.optics, autofocus="median")).aperture
    assert whole is not None and 2 < whole.focus <= 3.6 + 1e-3


@pytest.mark.usefixtures("wavefront")
def test_the_subject_is_the_largest_piece_near_the_middle(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse("0.6,0.5,0.4"))
    body, near = walls, VIEW.pose[:3, 3]
    things = {"vase": (-0.25, 1.0, 0.2), "shelf": (1.3, 2.0, 0.5), "door": (0.0, 3.0, 0.6)}
    for name, (x, y, half) in things.items():  # metres right of and ahead of the camera
        body += quad(name, (near[0] + x, near[1] + y, 1.5), (0, -1, 0), (half, half), up=(0, 0, 1))
    scene = write_scene(tmp_path / "room", body, {name: (name,) for name in things})
    fixed = tuple(replace(one, is_structure=one.id == "door") for one in scene.objects)
    save_scene(scene.folder, replace(scene, objects=fixed))
    params = replace(LENS.optics, autofocus="subject")
    opened = open_scene(load_scene(scene.folder))
    lens = optics_of(opened, VIEW, params).aperture
    assert lens is not None and lens.focus == pytest.approx(1.0, abs=1e-3)
    right = replace(VIEW, camera_to_world=as_matrix(look((1.1, -1.6, 1.5), (0, 1, 0))))
    lens = optics_of(opened, right, params).aperture
    assert lens is not None and lens.focus == pytest.approx(2.0, abs=1e-3)


def test_the_scalar_variant_says_what_it_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrator, "available", lambda: False)
    nothing: Any = None
    with pytest.raises(InputError, match="optics: needs a variant other than scalar_rgb"):
        render(["color"], nothing, VIEW, LENS, 0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"optics": {"f_number": -1.4}}, r"optics.f_number: -1.4 is not allowed"),
        ({"optics": {"f_number": float("nan")}}, "expected a finite number"),
        ({"optics": {"f_number": 0.1}}, "optics.f_number: 0.1; 0, or at least 0.5"),
        ({"optics": {"focus_distance": 0.01}}, "focus_distance: 0.01; 0, or at least 0.05"),
        ({"optics": {"blades": 2}}, "optics.blades: 2; 0, or at least 3"),
        ({"optics": {"exposure": 1.5}}, "must be from 0 to 1"),
        ({"optics": {"f_number": 2}, "channels": ["paper", "light"]}, "light holds parts of sharp"),
        (
            {"optics": {"f_number": 2}, "image": {"projection": "orthographic"}},
            "orthographic views have no focal length",
        ),
    ],
)
def test_impossible_options_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        build_params(given)


def test_a_frame_of_other_neighbours_is_stale(tmp_path: Path) -> None:
    rgb = {band: np.full((24, 32), 0.5, np.float32) for band in "RGB"}
    path = frame_path(tmp_path, "color", VIEW)
    write_frame(path, "color", rgb, VIEW, fingerprint="f", exposure_time=0.02)
    frames = load_frames(tmp_path, VIEW, {}, ["color"])
    assert isinstance(frames, dict)
    for view, reason in ((VIEW, "size"), (OTHER, "stale")):
        found = check_light(view, frames, {"color": (8, 8)}, CheckParams(), 0)
        assert found is not None and found.reason == reason, found


def test_rows_say_how_colour_was_exposed(tmp_path: Path) -> None:
    optics = OpticsParams(f_number=2.8, exposure=0.5, frame_rate=50.0)
    params = replace(small_params(), optics=optics)
    data = make_data(tmp_path, params, scenes=3, views=2)
    facts = {"f_number": 2.8, "focus_distance": 1.5, "exposure_time": 0.01, "readout_time": 0.0}
    for path in data.glob("color/*/*.exr"):
        frame = read_frame(path)
        view = frame.meta["view"]
        made = next(v for v in views_in(data) if v.name == (view["scene_id"], view["view_id"]))
        write_view(data, "color", {band: frame.channels[band] for band in "RGB"}, made, **facts)
    assert pack_dataset(data, params).total == 6
    table = pq.read_table(next((data / "dataset").glob("train-*.parquet")))
    for name, value in facts.items():
        assert table[name].to_pylist() == [np.float32(value)] * len(table)
    assert facts.keys() <= DatasetRows(data / "dataset").rows[0].values.keys()
    assert pack_dataset(make_data(tmp_path / "plain", small_params()), small_params()).total
    plain_table = pq.read_schema(next((tmp_path / "plain/dataset").glob("train-*.parquet")))
    assert not set(facts) & set(plain_table.names)
