"""Materials and labels in the dataset: columns, tables of names, and views that are rejected."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Channels, frame_path
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.views import View, load_cameras
from tests.fixtures.dataset import (
    ROOM,
    box_labels,
    box_materials,
    make_data,
    rows_of,
    small_params,
    write_view,
)

NAMES = ["plaster", "oak"]


def write_labels(
    data: Path,
    view: View,
    change: Callable[[Channels, dict[str, Any]], object] | None = None,
    **more: object,
) -> None:
    channels, instances = box_labels(view)
    if change:
        change(channels, instances[0])
    tables = {"instances": instances, "light_sources": [], "material_names": NAMES, **more}
    write_view(data, "labels", channels, view, **tables)


def labelled(folder: Path) -> tuple[Path, Params, list[View]]:
    """A data folder of three scenes with one view each, with materials and labels."""
    params = replace(small_params(), channels=("materials", "labels"))
    data = make_data(folder, params, scenes=3, views=1)
    cameras = [load_cameras(path) for path in sorted((data / "cameras").iterdir())]
    views = [view for file in cameras for view in file.views]
    for view in views:
        channels = box_materials(view, params)
        write_view(data, "materials", channels, view, material_names=NAMES)
        write_labels(data, view)
    return data, params, views


def test_materials_are_columns_with_a_table_of_names(tmp_path: Path) -> None:
    data, params, views = labelled(tmp_path)
    assert pack_dataset(data, params).total == 3
    shard = next((data / "dataset").glob("train-*.parquet"))
    table = pq.read_table(shard)
    assert table["material_names"].to_pylist()[0] == NAMES
    row = rows_of(table)[0]
    assert (row["material"] == 1).all() and row["material"].dtype == np.int32
    assert row["emission"].dtype == np.uint8
    assert (row["roughness"] == 0.75).all()
    features = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    assert features["material_names"]["length"] == -1
    card = (data / "dataset" / "README.md").read_text()
    assert "| `material_names` | list of string |" in card
    assert "roughness" in inspect_path(shard).text
    drawn = inspect_path(frame_path(data, "materials", views[0]))
    assert "bumped.X" in drawn.text and drawn.draw().size


def test_labels_are_columns_with_tables_of_their_meaning(tmp_path: Path) -> None:
    data, params, _ = labelled(tmp_path)
    assert pack_dataset(data, params).total == 3
    shard = next((data / "dataset").glob("train-*.parquet"))
    table = pq.read_table(shard)
    row = rows_of(table)[0]
    classes = json.loads(table.schema.metadata[b"classes"])
    assert classes == json.loads((data / "dataset" / "classes.json").read_text())
    assert {classes["category"][i] for i in row["category"].flat} == {"floor"}
    assert {classes["nyu40"][i] for i in row["nyu40"].flat} == {"floor"}
    assert {classes["nyu13"][i] for i in row["nyu13"].flat} == {"floor"}
    assert json.loads(row["instances"])[0]["object"] == "floor"
    layout = json.loads(row["layout"])
    assert layout["room"] == "room-0"
    living = layout["rooms"][0]
    assert living["floor"] == [[0, 0], [4, 0], [4, 5], [0, 5]]
    assert (living["floor_z"], living["ceiling_z"]) == (0, ROOM[2])
    assert [opening["id"] for opening in living["openings"]] == ["window"]
    assert row["light_sources"] == "[]" and row["material_names"] == NAMES
    assert table.column_names.count("material") == 1
    sums = (data / "dataset" / "SHA256SUMS").read_text()
    assert "classes.json" in sums


def test_labels_alone_have_the_materials_numbers_too(tmp_path: Path) -> None:
    data, params, _ = labelled(tmp_path)
    pack_dataset(data, replace(params, channels=("labels",)))
    names = pq.read_table(next((data / "dataset").glob("train-*.parquet"))).column_names
    assert {"material", "material_names"} <= set(names) and "roughness" not in names


def spoil(name: str, channels: Channels) -> Channels:
    changed = {band: np.array(values) for band, values in channels.items()}
    if name == "hole":
        changed["material"][0, 0] = 0
    elif name == "nameless":
        changed["material"][0, 0] = 3
    elif name == "too rough":
        changed["roughness"][0, 0] = 1.5
    elif name == "negative":
        changed["metalness"][0, 0] = -0.5
    elif name == "unknown":
        changed["material_known"][0, 0] = 0
    elif name == "long":
        changed["bumped.X"][0, 0] = 1.5
    return changed


@pytest.mark.parametrize(
    ("fault", "reason", "words"),
    [
        ("hole", "mislabelled", "1 pixels"),
        ("nameless", "mislabelled", "without a name"),
        ("too rough", "mislabelled", "roughness: up to 1.5"),
        ("negative", "negative", "metalness"),
        ("unknown", "mislabelled", "roughness: not 0"),
        ("long", "mislabelled", "not of unit length"),
    ],
)
def test_views_whose_materials_are_wrong_are_rejected(
    fault: str, reason: str, words: str, tmp_path: Path
) -> None:
    data, params, views = labelled(tmp_path)
    spoilt = spoil(fault, box_materials(views[0], params))
    write_view(data, "materials", spoilt, views[0], material_names=NAMES)
    assert pack_dataset(data, params).total == 2
    line = (data / "dataset" / "rejected.csv").read_text().splitlines()[1]
    assert line.startswith(f"home-0000,000,{reason},") and words in line


def put(band: str, value: int) -> Callable[[Channels, dict[str, Any]], object]:
    """A change of the first pixel of a band."""
    return lambda channels, entry: channels[band].__setitem__((0, 0), value)


def state(**values: object) -> Callable[[Channels, dict[str, Any]], object]:
    """A change of the description of the instance."""
    return lambda channels, entry: entry.update(values)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("instance", 2), "1 pixels of another object"),
        (put("category", 9), "NYU40 class is not that of the category"),
        (put("category", 999), "category without a name"),
        (put("nyu13", 12), "class of 13"),
        (put("material", 2), "other materials"),
        (state(pixels=767), "767 pixels are described, 768"),
        (state(pixels_alone=767), "767 pixels alone"),
        (state(visible_fraction=0.5), "visible fraction"),
        (state(category=1), "another category"),
        (state(centre=[1.99, 2.5, 1.3]), "outside its box"),
        (state(half_sizes=[2.0, 2.5, 1.29]), "outside its box"),
        (state(axes=[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), "outside its box"),
        (state(instance=2), "not those of the image"),
        (state(pixels_alone=0), "0 pixels alone"),
        (state(centre="here"), "cannot be read"),
    ],
)
def test_views_whose_labels_are_wrong_are_rejected(
    change: Callable[[Channels, dict[str, Any]], object], words: str, tmp_path: Path
) -> None:
    data, params, views = labelled(tmp_path)
    write_labels(data, views[0], change)
    assert pack_dataset(data, params).total == 2
    line = (data / "dataset" / "rejected.csv").read_text().splitlines()[1]
    assert line.startswith("home-0000,000,mislabelled,") and words in line


@pytest.mark.parametrize("table", ["instances", "light_sources", "material_names"])
def test_a_label_frame_without_a_table_is_rejected(table: str, tmp_path: Path) -> None:
    data, params, views = labelled(tmp_path)
    write_labels(data, views[0], **{table: None})
    assert pack_dataset(data, params).total == 2
    assert "mislabelled" in (data / "dataset" / "rejected.csv").read_text()
