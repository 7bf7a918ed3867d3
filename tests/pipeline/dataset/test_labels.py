"""Materials and labels in the dataset: columns, tables of names, and views that are rejected."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.dataset.pack import pack_dataset
from pipeline.frames import Channels, frame_path
from pipeline.inspection.describe import inspect_path
from pipeline.params import Params
from pipeline.views import View, load_cameras
from tests.fixtures.dataset import box_materials, make_data, small_params, write_view

NAMES = ["plaster", "oak"]


def labelled(folder: Path, **meta: object) -> tuple[Path, Params, list[View]]:
    """A data folder of three scenes with one view each, and materials."""
    params = replace(small_params(), channels=("materials",))
    data = make_data(folder, params, scenes=3, views=1)
    cameras = [load_cameras(path) for path in sorted((data / "cameras").iterdir())]
    views = [view for file in cameras for view in file.views]
    for view in views:
        channels = box_materials(view, params)
        write_view(data, "materials", channels, view, **{"material_names": NAMES, **meta})
    return data, params, views


def test_materials_are_columns_with_a_table_of_names(tmp_path: Path) -> None:
    data, params, views = labelled(tmp_path)
    assert pack_dataset(data, params).total == 3
    shard = next((data / "dataset").glob("train-*.parquet"))
    table = pq.read_table(shard)
    assert table["material_names"].to_pylist()[0] == NAMES
    assert set(table["material"].to_pylist()[0]) == {1}
    assert str(table.schema.field("material").type.value_type) == "int32"
    assert str(table.schema.field("emission").type.value_type) == "uint8"
    assert set(table["roughness"].to_pylist()[0]) == {0.75}
    features = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    assert features["material_names"]["length"] == -1
    card = (data / "dataset" / "README.md").read_text()
    assert "| `material_names` | list of string |" in card
    assert "roughness" in inspect_path(shard).text
    drawn = inspect_path(frame_path(data, "materials", views[0]))
    assert "bumped.X" in drawn.text and drawn.draw().size


def test_paper_leaves_the_dataset_as_it_was(tmp_path: Path) -> None:
    data, params, _ = labelled(tmp_path)
    with_more = {path.name: path for path in (data / "dataset").glob("*")}
    assert not with_more
    pack_dataset(data, replace(params, channels=("paper",)))
    names = pq.read_table(next((data / "dataset").glob("train-*.parquet"))).column_names
    assert names[-1] == "visibility" and "roughness" not in names


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
