"""Frames, cameras, shards and ledgers from elsewhere end in one sentence."""

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.cameras.settings import CameraParams
from pbrnet.pipeline.costs.ledger import Ledger, ledger_path, read_ledger
from pbrnet.pipeline.dataset.columns import arrow_schema, dataset_columns
from pbrnet.pipeline.dataset.parquet import (
    check_rows,
    check_types,
    image_cell,
    image_type,
    images_of,
    open_parquet,
)
from pbrnet.pipeline.frames import check_frame, read_frame, read_meta, view_of
from pbrnet.pipeline.lenses.settings import LensParams, OpticsParams
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import LightParams, NoisyParams
from pbrnet.pipeline.views import ImageParams, load_cameras
from pbrnet.scenes.errors import InputError
from tests.fixtures.dataset import add_scene, small_params


@pytest.fixture
def data(tmp_path: Path) -> Path:
    add_scene(tmp_path, small_params(), "home-0000", 1)
    return tmp_path


@pytest.mark.parametrize("text", ["[]", "3", "null", "[" * 50_000, "7" * 5000, '{"a": "\\ud800"}'])
def test_an_attribute_that_is_no_object(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.exr"
    with OpenEXR.File({"pbrnet": text}, {"Z": np.zeros((4, 4), np.float32)}) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="'pbrnet' attribute"):
        read_meta(path)


def test_a_frame_is_whole(data: Path) -> None:
    path = data / "inputs/home-0000/000.exr"
    frame = read_frame(path)
    assert view_of(frame.meta, path).view_id == "000"
    check_frame(frame, path, ("Z", "valid"), (32, 24))
    with pytest.raises(InputError, match="without the channel 'R'"):
        check_frame(frame, path, ("R",), None)
    with pytest.raises(InputError, match="32 x 24 pixels, expected 16 x 12"):
        check_frame(frame, path, (), (16, 12))
    frame.channels["Z"][0, 0] = np.nan
    with pytest.raises(InputError, match="NaN"):
        check_frame(frame, path, ("Z",), (32, 24))
    with pytest.raises(InputError, match="view"):
        view_of({"view": [1]}, path)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("width", 200_000, "200,000 x 24 pixels"),
        ("height", 0, "pixels"),
        ("width", 10**39, "pixels"),
        ("K", [[1, 2], [3]], "3x3"),
        ("camera_to_world", [[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "beyond"),
    ],
)
def test_impossible_views(data: Path, key: str, value: Any, words: str) -> None:
    path = data / "cameras/home-0000.json"
    content = json.loads(path.read_text())
    content["views"][0][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        load_cameras(path)


def test_columns_of_another_type() -> None:
    schema = pa.schema([("scene_id", pa.int64()), ("view_id", pa.large_string())])
    check_types(Path("a"), schema, ["view_id", "absent"])
    with pytest.raises(InputError, match="'scene_id' holds int64"):
        check_types(Path("a"), schema, ["scene_id"])
    good = pa.field("depth", pa.binary(), metadata={"shape": "[2, 3]", "dtype": "float32"})
    assert image_type(Path("a"), good) == (np.float32, (2, 3))
    for shape in ("x", "[]", "[1e9, 2]", "[-2, -3]", "[" * 9999, f"[{'9' * 5000}]"):
        with pytest.raises(InputError, match="depth"):
            image_type(Path("a"), good.with_metadata({"shape": shape, "dtype": "float32"}))
    for dtype in ("object", "float128", ""):
        with pytest.raises(InputError, match="type of its images"):
            image_type(Path("a"), good.with_metadata({"shape": "[2, 3]", "dtype": dtype}))
    older = schema.with_metadata({"pbrnet": "1"})
    with pytest.raises(InputError, match=r"format 1.* format 2.*pbrnet dataset"):
        check_types(Path("a"), older, ["view_id"])


@pytest.mark.parametrize("lens", [{}, {"projection": "fisheye"}, {"lens": LensParams((0.1,) * 5)}])
def test_every_column_is_of_one_type(lens: dict[str, Any]) -> None:
    params = Params(
        channels=("all",),
        image=ImageParams(**lens),
        cameras=CameraParams(walks=1),
        optics=OpticsParams(f_number=2.0, exposure=0.1),
        light=LightParams(2),
        noisy=NoisyParams(1),
    )
    schema = arrow_schema(dataset_columns(params))
    check_types(Path("a"), schema, schema.names)
    for field in schema:
        if b"encoding" not in field.metadata:
            foreign = pa.schema([field.with_type(pa.bool_())])
            with pytest.raises(InputError, match=f"'{field.name}' holds bool"):
                check_types(Path("a"), foreign, [field.name])


def test_cells_that_are_no_images() -> None:
    image = np.arange(6, dtype=np.float32).reshape(2, 3)
    field = pa.field("depth", pa.binary(), metadata={"shape": "[2, 3]", "dtype": "float32"})

    def read(cell: bytes | None) -> np.ndarray:
        table = pa.Table.from_arrays([pa.array([cell], pa.binary())], schema=pa.schema([field]))
        return images_of(Path("a"), table, "depth")[0]

    good = image_cell(image)
    np.testing.assert_array_equal(read(good), image)
    assert good[-24:] == image.view(np.uint8).reshape(6, 4).T.tobytes(), "bytes of a kind together"
    stream = io.BytesIO()  # as another program may write it: a longer header, version 2
    np.lib.format.write_array(stream, np.load(io.BytesIO(good)), version=(2, 0))
    np.testing.assert_array_equal(read(stream.getvalue()), image)
    bombs = [
        good.replace(b"(4, 2, 3)", b"(4, 2, 9)"),
        good.replace(b"(4, 2, 3)", b"(4, 2<<60"),
        good.replace(b"|u1", b"|O8"),
        good.replace(b"float32", b"float16"),
        image_cell(image.T),
        image_cell(image.astype(np.float64)),
    ]
    for cell in (None, b"", b"x" * 200, good[:-1], good + b"x", good[:40], *bombs):
        with pytest.raises(InputError, match="depth"):
            read(cell)


@pytest.mark.parametrize("value", [None, -1.0, float("nan"), 1e308])
def test_ledgers_with_impossible_costs(tmp_path: Path, value: float | None) -> None:
    ledger = Ledger(tmp_path)
    ledger.add(("color", "a", "000"), seconds=1.0)
    ledger.save()
    table = pq.read_table(ledger_path(tmp_path))
    place = table.column_names.index("seconds")
    changed = pa.array([value], pa.float64())
    table = table.set_column(place, table.schema.field("seconds"), changed)
    pq.write_table(table, ledger_path(tmp_path))
    with pytest.raises(InputError, match="seconds"):
        read_ledger(tmp_path)


EYE = np.eye(4)
IMPOSSIBLE_ROWS = {
    "K of zeros": ("K", np.zeros((3, 3)), "focal lengths"),
    "K of NaN": ("K", np.full((3, 3), np.nan), "NaN"),
    "huge K": ("K", np.diag([1e308, 1e308, 1]), "beyond"),
    "K with another last row": ("K", np.diag([20, 20, 2]), "last row"),
    "stretched pose": ("camera_to_world", np.diag([2, 1, 1, 1]), "not a rotation"),
    "mirrored pose": ("camera_to_world", np.diag([-1, 1, 1, 1]), "not a rotation"),
    "pose without a last row": ("camera_to_world", np.diag([1, 1, 1, 0]), "not a rotation"),
    "pose of infinity": ("camera_to_world", EYE * np.inf, "NaN or numbers beyond"),
    "exposure 0": ("exposure_color", 0.0, "not above 0"),
    "infinite exposure": ("exposure_shading", np.inf, "not above 0 and finite"),
    "white of NaN": ("white_color", np.nan, "not above 0"),
    "id of two lines": ("scene_id", "a\nb", "cannot be a scene's id"),
    "id that climbs": ("view_id", "../a", "cannot be a view's id"),
    "trajectory that climbs": ("trajectory", "../a", "cannot be a trajectory's name"),
    "no id": ("view_id", None, "without 'view_id'"),
}
SOUND = {
    "scene_id": "a",
    "view_id": "0",
    "K": np.diag([20, 20, 1]),
    "camera_to_world": EYE,
} | dict.fromkeys(("exposure_color", "exposure_shading", "white_color"), 1.0)


@pytest.mark.parametrize("case", IMPOSSIBLE_ROWS)
def test_rows_that_no_view_has(tmp_path: Path, case: str) -> None:
    name, value, words = IMPOSSIBLE_ROWS[case]
    sound = {key: v.tolist() if hasattr(v, "tolist") else v for key, v in SOUND.items()}
    value = value.tolist() if hasattr(value, "tolist") else value
    sides = {"K": 3, "camera_to_world": 4}
    kinds = dict.fromkeys((*sound, "trajectory"), pa.float64())
    kinds |= {key: pa.list_(pa.list_(pa.float64(), n), n) for key, n in sides.items()}
    kinds |= dict.fromkeys(("scene_id", "view_id", "trajectory"), pa.string())
    schema = pa.schema(kinds.items())
    path = tmp_path / "a.parquet"
    for rows in ([sound], [sound, {**sound, name: value}]):
        pq.write_table(pa.Table.from_pylist(rows, schema=schema), path)
        with open_parquet(path) as file:
            if len(rows) == 1:
                check_rows(path, file)
                continue
            with pytest.raises(InputError, match=re.escape(words)):
                check_rows(path, file)


def test_a_shard_without_rows_or_with_a_column_twice(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"scene_id": pa.array([], pa.string())}), path)
    with open_parquet(path) as file, pytest.raises(InputError, match="no rows"):
        check_rows(path, file)
    pq.write_table(pa.Table.from_arrays([pa.array(["a"])] * 2, names=["split"] * 2), path)
    with pytest.raises(InputError, match="2 columns are called 'split'"):
        open_parquet(path)
