"""Panoramas of the environment in the dataset: columns, and views that are rejected."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.dataset.checks import check_light, check_surfaces
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import Channels, Frame, frame_path
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.views import View, load_cameras
from tests.fixtures.dataset import (
    box_environment,
    box_frames,
    make_data,
    make_view,
    rows_of,
    small_params,
    write_view,
)

WANTED = replace(small_params(), channels=("environment",))


def surrounded(folder: Path) -> tuple[Path, Params, list[View]]:
    """A data folder of three scenes with one view each, with panoramas of the environment."""
    data = make_data(folder, WANTED, scenes=3, views=1)
    cameras = [load_cameras(path) for path in sorted((data / "cameras").iterdir())]
    views = [view for file in cameras for view in file.views]
    for view in views:
        write_view(data, "environment", box_environment(view, WANTED), view, spp=64, noise=0.25)
    return data, WANTED, views


def test_panoramas_are_columns(tmp_path: Path) -> None:
    data, params, views = surrounded(tmp_path)
    assert pack_dataset(data, params).total == 3
    shard = next((data / "dataset").glob("train-*.parquet"))
    table = pq.read_table(shard)
    row = rows_of(table)[0]
    assert row["environment"].dtype == np.float32 and row["environment"].shape == (24, 48, 3)
    light = row["environment"] * row["radiance_scale"]
    assert (light[:2] == 120000).all() and (light[2:] == 0.25).all()
    assert row["environment_normal"].dtype == np.float16
    view = next(v for v in views if v.scene_id == row["scene_id"])
    depth = box_environment(view, params)["distance.Z"]
    np.testing.assert_array_equal(row["environment_depth"], depth)
    assert (row["environment_spp"], row["noise_environment"]) == (64, 0.25)
    assert "`environment_depth`" in (data / "dataset" / "README.md").read_text()
    assert "environment_normal" in inspect_path(shard).text
    drawn = inspect_path(frame_path(data, "environment", views[0]))
    assert "distance.Z" in drawn.text and drawn.draw().size


def test_other_columns_do_not_depend_on_them(tmp_path: Path) -> None:
    data, params, _ = surrounded(tmp_path)
    pack_dataset(data, params)
    (shard,) = (data / "dataset").glob("train-*.parquet")
    more = pq.read_table(shard)
    pack_dataset(data, replace(params, channels=("paper",)))
    (shard,) = (data / "dataset").glob("train-*.parquet")
    paper = pq.read_table(shard)
    assert not [name for name in paper.column_names if "environment" in name]
    assert more.select(paper.column_names).equals(paper)


def changed(bands: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Channels], None]:
    def spoil(channels: Channels) -> None:
        for band in [band for band in channels if band in bands.split()]:
            channels[band] = change(np.array(channels[band]))

    return spoil


GEOMETRY = "distance.Z N.X N.Y N.Z"


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (changed("", np.copy), None),
        (changed(GEOMETRY, lambda values: values[:, ::-1]), "inconsistent"),
        (changed(GEOMETRY, lambda values: values[::-1]), "inconsistent"),
        (changed(GEOMETRY, lambda values: np.roll(values, 12, axis=1)), "inconsistent"),
        (changed("distance.Z", lambda values: values * 1.2), "inconsistent"),
        (changed("N.X", lambda values: values + 0.2), "inconsistent"),
        (changed("N.X N.Y N.Z", np.zeros_like), "inconsistent"),
        (changed("distance.Z", np.zeros_like), "inconsistent"),
        (changed("G", lambda values: values - 1), "negative"),
        (changed("B", lambda values: values / 0), "not_finite"),
        (changed(f"R G B {GEOMETRY}", lambda values: values[:, :46]), "size"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_wrong_panoramas_reject_a_view(spoil: Callable[[Channels], None], reason: str) -> None:
    view = make_view(WANTED, "home-0000", 1)
    meta = {"view": {"scene_id": view.scene_id, "view_id": view.view_id}}
    meta["view"] |= {"camera_to_world": view.camera_to_world, "K": view.K}
    panorama = box_environment(view, WANTED)
    spoil(panorama)
    frames = {kind: Frame(pixels, meta) for kind, pixels in box_frames(view, WANTED).items()}
    frames["environment"] = Frame(panorama, meta)
    sizes, limits = {kind: WANTED.size_of(kind) for kind in frames}, CheckParams()
    found = check_surfaces(view, frames, sizes["inputs"], limits, {})
    found = found or check_light(view, frames, sizes, limits, 0)
    assert (found.reason if found else None) == reason
