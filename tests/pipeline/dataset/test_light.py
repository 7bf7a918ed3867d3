"""Parts of the light in the dataset: columns that add up to colour, and views that do not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.channels import ALBEDO, RGB, light_bands
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Channels, frame_path, read_frame
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.light import adding_up
from pbrnet.pipeline.passes.settings import LightParams
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.errors import InputError
from tests.fixtures.dataset import images_of, make_data, small_params, write_view

PARTS = ("direct", "indirect", "diffuse", "specular", "irradiance", "residual")


NAMES = ["sky", "", "lamp", ""]


def lit(
    folder: Path,
    scale: float = 1.0,
    change: Callable[[Channels, dict[str, Any]], object] = id,
    groups: int = 0,
) -> tuple[Path, Params, list[View]]:
    """A data folder of three scenes with a view each; `change` is applied to the first light frame.

    Radiance is multiplied by `scale`. With `groups` the frames have light groups.
    """
    params = replace(small_params(), channels=("light",), light=LightParams(groups))
    data = make_data(folder, params, scenes=3, views=1)
    cameras = [load_cameras(path) for path in sorted((data / "cameras").iterdir())]
    views = [view for file in cameras for view in file.views]
    random = np.random.default_rng(3)
    for view in views:
        made = read_frame(frame_path(data, "color", view))
        shape = (view.height, view.width)
        bright = scale * np.where(np.arange(view.width) < 4, 100, 1)  # an edge
        color = {band: made.channels[band].astype(np.float32) * bright for band in RGB}
        path = write_view(data, "color", color, view)
        frame = read_frame(path)
        inputs = read_frame(frame_path(data, "inputs", view))
        channels: Channels = {}
        for band, albedo in zip(RGB, ALBEDO, strict=True):
            light = frame.channels[band].astype(np.float32)
            channels[f"direct.{band}"] = 0.7 * light * random.random(shape)
            channels[f"diffuse.{band}"] = 0.9 * light
            reflectance = inputs.channels[albedo].astype(np.float32)
            channels[f"irradiance.{band}"] = 0.9 * light / reflectance * random.uniform(0, 9, shape)
        noise = {f"noise_{part}": 0.25 for part in PARTS[:-1]}
        meta: dict[str, Any] = {"color_digest": frame.meta["digest"], "noise": None, **noise}
        meta["radiance_scale"] = frame.radiance_scale
        if groups:
            images = np.zeros((len(NAMES), *shape, 3), dtype=np.float32)
            images[0], images[2] = (random.random((*shape, 3)) for _ in range(2))
            for number, image in enumerate(adding_up(images, frame.rgb, frame.radiance_scale)):
                named = zip(light_bands(number), np.moveaxis(image, -1, 0), strict=True)
                channels |= dict(named)
            meta |= {"light_names": NAMES, "noise_lights": [0.5] * len(NAMES)}
        if view is views[0] and change is not id:
            change(channels, meta)
        write_view(data, "light", channels, view, **meta)
    return data, params, views


def table_of(data: Path) -> Any:
    return pq.read_table(next((data / "dataset").glob("train-*.parquet")))


@pytest.mark.parametrize("scale", [1.0, 2e-5, 1e-6], ids=["day", "night", "cellar"])
def test_the_parts_add_up_to_colour_in_the_dataset(scale: float, tmp_path: Path) -> None:
    """Within 0.1 % also where half floats are subnormal."""
    data, params, views = lit(tmp_path, scale)
    assert pack_dataset(data, params).total == 3
    table = table_of(data)
    images = {}
    for name in (*PARTS, "color", "reflectance"):
        images[name] = np.array(images_of(table, name), np.float64)
        assert images[name].shape[1:] == (24, 32, 3)
    tolerance = 1e-3 * images["color"]
    for one, other in (("direct", "indirect"), ("diffuse", "specular")):
        assert (abs(images[one] + images[other] - images["color"]) <= tolerance).all()
        assert images[one].min() >= 0 and images[other].min() >= 0
    gap = images["reflectance"] * images["irradiance"] + images["residual"] - images["color"]
    assert (abs(gap) <= tolerance).all() and images["residual"].min() < 0
    types = {name: images_of(table, name)[0].dtype.name for name in PARTS}
    assert types == dict.fromkeys(PARTS[:4], "float16") | dict.fromkeys(PARTS[4:], "float32")
    assert table["noise_specular"].to_pylist() == [0.25] * len(table)
    drawn = inspect_path(frame_path(data, "light", views[0]))
    assert "irradiance.R" in drawn.text and drawn.draw().size
    assert "| `residual` | float32 | 24 x 32 x 3 |" in (data / "dataset" / "README.md").read_text()


@pytest.mark.parametrize("scale", [1.0, 1e-6], ids=["day", "cellar"])
def test_light_groups_add_up_to_colour_in_the_dataset(scale: float, tmp_path: Path) -> None:
    data, params, views = lit(tmp_path, scale, groups=1)
    assert pack_dataset(data, params).total == 3
    table = table_of(data)
    assert table["light_names"].to_pylist()[0] == NAMES
    assert table["noise_lights"].to_pylist()[0] == [0.5] * 4
    images = {name: np.array(images_of(table, name), np.float64) for name in ("lights", "color")}
    assert images["lights"].shape[1:] == (4, 24, 32, 3) and images["lights"].min() >= 0
    gap = abs(images["lights"].sum(axis=1) - images["color"])
    assert (gap <= 1e-3 * images["color"]).all()
    assert images["lights"][:, 0].mean() > 0 == images["lights"][:, 1].max()
    drawn = inspect_path(frame_path(data, "light", views[0]))
    assert "light02.R" in drawn.text and drawn.draw().size


def test_views_with_other_light_groups_are_rejected(tmp_path: Path) -> None:
    def darker(channels: Channels, meta: dict[str, Any]) -> None:
        channels["light00.R"] = 0.9 * channels["light00.R"]

    data, params, _ = lit(tmp_path, change=darker, groups=1)
    assert pack_dataset(data, params).total == 2
    line = (data / "dataset" / "rejected.csv").read_text().splitlines()[1]
    assert line.startswith("home-0000,000,light,") and "light groups: 7" in line
    with pytest.raises(InputError, match="the number of light groups differs"):
        pack_dataset(data, replace(params, light=LightParams(2)))


def brighter(channels: Channels, meta: dict[str, Any]) -> None:
    channels["diffuse.G"] = np.array(channels["diffuse.G"])
    channels["diffuse.G"][0, 0] *= 1.2


def negative(channels: Channels, meta: dict[str, Any]) -> None:
    channels["irradiance.R"] = -channels["irradiance.R"]


def overflowing(channels: Channels, meta: dict[str, Any]) -> None:
    channels["irradiance.R"] = channels["irradiance.R"] + 1e12


@pytest.mark.parametrize(
    ("change", "reason", "words"),
    [
        (brighter, "light", "diffuse: 1 pixels brighter"),
        (overflowing, "light", "reflectance x irradiance + residual: 7"),
        (lambda channels, meta: meta.update(color_digest="other"), "light", "another image"),
        (negative, "negative", "irradiance: down to"),
    ],
)
def test_views_whose_light_does_not_add_up_are_rejected(
    change: Callable[[Channels, dict[str, Any]], object], reason: str, words: str, tmp_path: Path
) -> None:
    data, params, _ = lit(tmp_path, change=change)
    assert pack_dataset(data, params).total == 2
    line = (data / "dataset" / "rejected.csv").read_text().splitlines()[1]
    assert line.startswith(f"home-0000,000,{reason},") and words in line
