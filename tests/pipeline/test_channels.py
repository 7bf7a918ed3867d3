"""Table of channels: a new entry appears in frames, columns, checks, card and inspect."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline import channels
from pbrnet.pipeline.channels import (
    CHANNELS,
    IRRADIANCE,
    KINDS,
    RGB,
    Channel,
    channels_of,
    dataset_channels,
    layout,
)
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Frame, frame_path, read_frame
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.inspection.drawings import draw_frame
from pbrnet.pipeline.passes import inputs
from pbrnet.pipeline.passes.inputs import RENDERERS, VisibleSurfaces, render_inputs
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.arrays import AnyArray
from tests.fixtures.dataset import box_frames, images_of, make_data, small_params, write_view
from tests.fixtures.render import diffuse, make_view, quad, write_scene

GRAIN = Channel(
    "grain",
    "inputs",
    ("grain",),
    np.float16,
    "Grain of the surface, 0 to 1; 0: no surface.",
    nonnegative=True,
)


def test_a_band_belongs_to_one_channel_of_its_frame() -> None:
    for kind in KINDS:
        bands = [band for channel in channels_of(kind) for band in channel.bands]
        assert bands and len(set(bands)) == len(bands)
        assert list(layout(kind)) == bands
    columns = [channel.name for channel in dataset_channels(KINDS)]
    assert len(set(columns)) == len(columns)
    assert {channel.name for channel in CHANNELS if channel.in_dataset} == set(columns)


def test_frames_have_the_layouts_that_the_design_fixes() -> None:
    assert layout("shading") == layout("color") == dict.fromkeys(RGB, np.float16)
    single = {band for kind in KINDS for band, dtype in layout(kind).items() if dtype is np.float32}
    flow = {f"{way}.{axis}" for way in ("forward", "backward") for axis in "XY"}
    light = set(IRRADIANCE)  # whose product with reflectance takes part in an identity
    assert single == {"Z", "intensity.Y", "distance.Z"} | flow | light | set(RGB), (
        "a sun or a bare bulb overflows half"
    )


def test_every_input_channel_has_a_renderer() -> None:
    assert list(RENDERERS) == [channel.name for channel in channels_of("inputs")]


def constant_grain(surfaces: VisibleSurfaces) -> AnyArray:
    return np.where(surfaces.valid, 0.25, 0)


@pytest.fixture
def grain(monkeypatch: pytest.MonkeyPatch) -> Channel:
    """One more channel and its renderer."""
    monkeypatch.setattr(channels, "CHANNELS", (*CHANNELS, GRAIN))
    monkeypatch.setitem(inputs.RENDERERS, "grain", constant_grain)
    return GRAIN


def test_a_new_channel_is_rendered_into_its_frame(grain: Channel, tmp_path: Path) -> None:
    set_variant()
    body = quad("p", (0, 2, 1.5), (0, -1, 0), (1, 1), diffuse())
    got = render_inputs(open_scene(write_scene(tmp_path / "s", body)), make_view())
    assert got["grain"].shape == (24, 32)
    np.testing.assert_array_equal(got["grain"], 0.25 * got["valid"])


def test_a_new_channel_is_packed_checked_described_and_drawn(
    grain: Channel, tmp_path: Path
) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=3, views=1)
    cameras = [load_cameras(data / "cameras" / f"home-{index:04d}.json") for index in range(3)]
    views = [view for file in cameras for view in file.views]
    values = (np.float16(0.25), np.float16(0.5), np.float16(-0.5))  # the last is impossible
    for view, value in zip(views, values, strict=True):
        frame = box_frames(view, params)["inputs"]
        planes = {**frame, "grain": np.full(frame["Z"].shape, value)}
        write_view(data, "inputs", planes, view)
    summary = pack_dataset(data, params)
    assert summary.total == 2
    rejected = (data / "dataset" / "rejected.csv").read_text().splitlines()[1:]
    assert rejected == ["home-0002,000,negative,grain: down to -0.5"]
    tables = [pq.read_table(path) for path in sorted((data / "dataset").glob("*.parquet"))]
    grains = [image for table in tables for image in images_of(table, "grain")]
    assert sorted({float(value) for image in grains for value in image.flat}) == [0.25, 0.5]
    field = tables[0].schema.field("grain")
    assert field.metadata[b"shape"] == b"[24, 32]"
    card = (data / "dataset" / "README.md").read_text()
    croissant = (data / "dataset" / "croissant.json").read_text()
    for text in (card, croissant):
        assert "Grain of the surface, 0 to 1; 0: no surface." in text
    path = frame_path(data, "inputs", views[0])
    assert "grain" in inspect_path(path).text
    frame = read_frame(path)
    others = {name: values for name, values in frame.channels.items() if name != "grain"}
    without, drawn = (draw_frame(Frame(held, frame.meta)) for held in (others, frame.channels))
    assert not np.array_equal(without, drawn), "one more picture"
