"""Statistics of diversity, against views whose values are known."""

import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.dataset.diversity import (
    QUANTITIES,
    count_lights,
    dataset_figures,
    view_figures,
)
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.scenes.errors import InputError
from tests.fixtures.command import printed, refused
from tests.fixtures.dataset import make_data, small_params


def test_figures_of_a_view_are_what_is_in_it() -> None:
    reflectance = np.zeros((4, 6, 3))
    reflectance[:, :3] = (0.8, 0.4, 0.4)  # saturation one half
    reflectance[:, 3:] = 0.5
    valid = np.ones((4, 6), np.uint8)
    valid[0] = 0
    color = np.full((4, 6, 3), 0.01)
    color[:, ::2] = 1.0
    intensity = np.zeros((180, 360), np.float32)
    intensity[:90] = 3.0  # the upper half of the sphere
    found = view_figures(
        {
            "objects": 5,
            "depth": np.where(valid, 2.5, 99.0),
            "valid": valid,
            "color": color,
            "reflectance": reflectance,
            "intensity": intensity,
        }
    )
    assert found["objects"] == 5
    assert found["depth"] == pytest.approx(2.5)
    assert found["luminance"] == pytest.approx(math.sqrt(0.01), rel=1e-6)
    assert found["saturation"] == pytest.approx(0.25)
    assert (found["lights"], found["lit"]) == (1, pytest.approx(0.5))


def test_lights_that_touch_across_the_seam_are_one() -> None:
    shining = np.zeros((10, 20), bool)
    shining[2, 0] = shining[3, 19] = True  # touch by their corners, behind the camera
    shining[7, 0] = True  # touches nothing
    shining[7, 9:11] = True
    assert count_lights(shining) == 3
    assert count_lights(np.zeros((10, 20), bool)) == 0
    assert count_lights(np.ones((10, 20), bool)) == 1
    poles = np.zeros((10, 20), bool)
    poles[0, 0] = poles[9, 19] = True  # top and bottom do not meet
    assert count_lights(poles) == 2


def test_diversity_of_a_dataset_counts_every_view_once(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=3)
    pack_dataset(data, params)
    figures = dataset_figures(sorted((data / "dataset").glob("*.parquet")))
    assert list(figures) == ["procedural"]
    for quantity in QUANTITIES:
        assert figures["procedural"][quantity.name].shape == (9,)
    assert set(figures["procedural"]["objects"]) == {0.0}
    assert set(figures["procedural"]["lights"]) == {2.0}

    picture = tmp_path / "diversity.png"
    told = printed("inspect", data / "dataset", "--diversity", "--out", picture)
    assert "9 views" in told and "saturation" in told
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_diversity_says_what_it_cannot_read(tmp_path: Path) -> None:
    assert "not a dataset folder" in refused("inspect", tmp_path, "--diversity")
    params = small_params()
    data = make_data(tmp_path, params, scenes=3)
    pack_dataset(data, params)
    shard = next((data / "dataset").glob("train-*.parquet"))
    pq.write_table(pq.read_table(shard).drop_columns(["objects"]), shard)
    with pytest.raises(InputError, match="'objects'"):
        dataset_figures([shard])
