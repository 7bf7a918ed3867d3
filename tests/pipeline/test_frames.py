"""Frames are self-describing, complete or absent, and damage is found."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from pbrnet.pipeline import frames
from pbrnet.pipeline.channels import HALF_MAX, radiance_halves, scale_for
from pbrnet.pipeline.views import (
    CameraFile,
    ImageParams,
    View,
    as_matrix,
    intrinsics_of,
    load_cameras,
    look,
    save_cameras,
)
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import write_json

IMAGE = ImageParams(width=32, height=24)


@pytest.fixture
def view() -> View:
    pose = look((1.0, 2.0, 1.5), (0.3, 1.0, -0.2))
    return View("home", "v0", 32, 24, as_matrix(intrinsics_of(IMAGE)), as_matrix(pose))


def some_color(seed: int = 0) -> frames.Channels:
    rng = np.random.default_rng(seed)
    return {band: rng.lognormal(size=(24, 32)) for band in frames.RGB}


def test_a_frame_comes_back_as_it_was_written(tmp_path: Path, view: View) -> None:
    path = frames.frame_path(tmp_path, "color", view)
    channels = some_color()
    frames.write_frame(path, "color", channels, view, fingerprint="f", spp=4)
    frame = frames.read_frame(path)
    for band in frames.RGB:
        stored = (channels[band] / frame.radiance_scale).astype(np.float16)
        np.testing.assert_array_equal(
            frame.channels[band], stored * np.float32(frame.radiance_scale)
        )
    assert frame.meta["spp"] == 4
    assert not {"seen", "score"} & frame.meta["view"].keys(), "camera files hold these"
    assert frame.meta["view"]["view_id"] == "v0"
    assert frames.holds(path, ["f"])
    assert not frames.holds(path, ["g"])


def test_the_standard_attribute_is_the_inverse_pose(tmp_path: Path, view: View) -> None:
    path = tmp_path / "a.exr"
    frames.write_frame(path, "color", some_color(), view, fingerprint="f")
    with OpenEXR.File(str(path), header_only=True) as file:
        matrix = np.array(file.header()["worldToCamera"])
    np.testing.assert_allclose(matrix @ view.pose, np.eye(4), atol=1e-6)


def test_equal_pixels_give_equal_bytes(tmp_path: Path, view: View) -> None:
    for name in ("a.exr", "b.exr"):
        frames.write_frame(tmp_path / name, "color", some_color(), view, fingerprint="f")
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_values_beyond_half_are_clamped_and_counted(tmp_path: Path, view: View) -> None:
    channels = some_color()
    channels["R"][0, :3] = 1e9
    frames.write_frame(tmp_path / "a.exr", "color", channels, view, fingerprint="f")
    frame = frames.read_frame(tmp_path / "a.exr")
    assert frame.meta["clamped"] == 3
    assert frame.channels["R"][0, 0] == HALF_MAX * frame.radiance_scale


def subnormal(values: frames.Channels) -> float:
    """Share of half floats below the normal ones, of those that are not 0."""
    halves = np.stack([abs(values[band].astype(np.float16)) for band in frames.RGB])
    return float((halves[halves > 0] < 2.0**-14).mean())


def test_a_room_at_night_keeps_its_precision(tmp_path: Path, view: View) -> None:
    """Radiance from 1e-6 to 1e-2: most would be subnormal; one multiplication restores all."""
    rng = np.random.default_rng(0)
    night = {band: (10.0 ** rng.uniform(-6, -2, (24, 32))) for band in frames.RGB}
    night["R"][0, 0] = 0
    path = tmp_path / "a.exr"
    frames.write_frame(path, "color", night, view, fingerprint="f")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        stored = {name: channel.pixels for name, channel in file.channels().items()}
        scale = file.header()["radianceScale"]
    frame = frames.read_frame(path)
    assert scale == frame.meta["radiance_scale"] and np.log2(scale) % 1 == 0
    assert subnormal(night) > 0.4 and subnormal(stored) == 0
    for band in frames.RGB:
        assert stored[band].dtype == np.float16
        np.testing.assert_array_equal(frame.channels[band], stored[band] * np.float32(scale))
        assert (abs(frame.channels[band] - night[band]) <= night[band] * 2.0**-11).all()
    assert frame.channels["R"][0, 0] == 0


def test_highlights_fit_and_leave_precision_to_the_rest() -> None:
    dim = np.full((8, 8), 3e-5)
    assert 0.1 < (dim / scale_for([dim])).mean() < 0.4
    dim[0, 0] = 100.0  # a bare bulb, all in all 2^28 above what half floats still resolve
    scale = scale_for([dim])
    assert 2.0**14 <= 100 / scale <= 2.0**15
    for value in (100.0, 100.0 * 2.0**-28):
        assert abs(float(np.float16(value / scale)) * scale - value) <= value * 2.0**-11
    day = np.full((8, 8), 0.2)
    day[0, 0] = 1e9  # the sun is clamped rather than all else lost
    assert 0.2 / scale_for([day]) >= 2.0**-9 and scale_for([np.zeros((8, 8))]) == 1
    assert scale_for([day[1:]]) == scale_for([day[1:].astype(np.float16)]) == 1


def test_only_radiance_has_a_unit(tmp_path: Path, view: View) -> None:
    assert radiance_halves("color") == frames.RGB
    assert len(radiance_halves("light", 2)) == 12 and not radiance_halves("environment")
    assert not radiance_halves("inputs") and not radiance_halves("illumination")


def test_frames_without_a_unit_are_in_the_renderers(tmp_path: Path, view: View) -> None:
    path = tmp_path / "a.exr"
    old = {band: values.astype(np.float16) for band, values in some_color().items()}
    frames.write_pixels(path, dict(old), view, {"kind": "color", "fingerprint": "f"})
    frame = frames.read_frame(path)
    assert frame.radiance_scale == 1
    for band in frames.RGB:
        np.testing.assert_array_equal(frame.channels[band], old[band])


@pytest.mark.parametrize("scale", [0.0, -1.0, 0.3, True, "1", None, 2.0**200])
def test_impossible_units_are_refused(tmp_path: Path, view: View, scale: object) -> None:
    path = tmp_path / "a.exr"
    old = {band: values.astype(np.float16) for band, values in some_color().items()}
    frames.write_pixels(path, dict(old), view, {"kind": "color"})
    meta = frames.read_meta(path) | {"radiance_scale": scale}
    with OpenEXR.File({"pbrnet": json.dumps(meta)}, old) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="radiance_scale"):
        frames.read_frame(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_is_never_written(tmp_path: Path, view: View, bad: float) -> None:
    channels = some_color()
    channels["G"][3, 4] = bad
    with pytest.raises(ValueError, match="NaN or infinity"):
        frames.write_frame(tmp_path / "a.exr", "color", channels, view, fingerprint="f")
    assert list(tmp_path.iterdir()) == []


def test_damage_is_found(tmp_path: Path, view: View) -> None:
    path = tmp_path / "a.exr"
    frames.write_frame(path, "color", some_color(), view, fingerprint="f")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"a\.exr"):
        frames.read_frame(path)
    path.write_bytes(b"not an image")
    with pytest.raises(InputError, match="not a readable EXR"):
        frames.read_frame(path)
    with pytest.raises(InputError, match="no such frame"):
        frames.read_frame(tmp_path / "b.exr")


def test_changed_pixels_are_found(tmp_path: Path, view: View) -> None:
    path = tmp_path / "a.exr"
    frames.write_frame(path, "color", some_color(), view, fingerprint="f")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        pixels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
        header = {"pbrnet": file.header()["pbrnet"]}
    pixels["R"][0, 0] += 1
    with OpenEXR.File(header, pixels) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="checksum"):
        frames.read_frame(path)


def test_a_foreign_exr_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    with OpenEXR.File({}, {"R": np.zeros((4, 4), np.float32)}) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="not a pbrnet frame"):
        frames.read_frame(path)


def test_a_full_disk_leaves_no_half_frame(small_disk: Path, view: View) -> None:
    rng = np.random.default_rng(0)
    big = {band: rng.random((800, 800)) for band in frames.RGB}
    with pytest.raises(MachineError):
        frames.write_frame(small_disk / "a.exr", "color", big, view, fingerprint="f")
    assert list(small_disk.iterdir()) == []


def test_projection_of_known_points(view: View) -> None:
    """The principal axis meets the image centre; one focal length to the right is x/z = 1."""
    ahead = view.pose @ np.array([0.0, 0.0, 5.0, 1.0])
    local = np.linalg.inv(view.pose) @ ahead
    pixel = view.intrinsics @ (local[:3] / local[2])
    np.testing.assert_allclose(pixel[:2], (16, 12), atol=1e-9)
    assert view.pose[2, 1] < 0  # the camera's y axis points down in the Z-up world


def test_bad_camera_files_are_refused(tmp_path: Path, view: View) -> None:
    path = tmp_path / "home.json"
    write_json(path, {"scene_id": "home", "views": [{"scene_id": "home"}]})
    with pytest.raises(InputError, match=r"views\[0\]\.view_id"):
        load_cameras(path)
    data = plain(CameraFile("home", (view, view)))
    write_json(path, data)
    with pytest.raises(InputError, match="same view_id"):
        load_cameras(path)
    data["views"] = data["views"][:1]
    data["views"][0]["camera_to_world"][0][0] += 0.5
    write_json(path, data)
    with pytest.raises(InputError, match="rotation"):
        load_cameras(path)


@pytest.mark.parametrize("name", ["../../x", "/etc/x", "", ".hidden", "-option", "a/b", "x" * 129])
def test_no_name_in_a_camera_file_leads_out_of_its_folder(
    tmp_path: Path, view: View, name: str
) -> None:
    path = tmp_path / "cameras.json"
    save_cameras(path, CameraFile("room", (replace(view, view_id=name),)))
    with pytest.raises(InputError, match="cannot be a view's id"):
        load_cameras(path)
