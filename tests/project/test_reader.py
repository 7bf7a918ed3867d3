"""The reader of one file: rows as they are stored, from folders and stores, for every library."""

import ast
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from torch.utils.data import DataLoader, Dataset, IterableDataset

from pbrnet.pipeline.channels import RADIANCE, dataset_channels
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.tonemap import Exposure, tonemap
from pbrnet.reader import TASKS
from tests.fixtures.dataset import make_data, rows_of, small_params
from tests.fixtures.paths import ROOT

SAMPLE = ROOT / "examples" / "sample"
FILE = ROOT / "reader" / "pbrnet_reader.py"
RADIANCES = {channel.name for channel in dataset_channels() if channel.unit == RADIANCE}


@pytest.fixture(scope="module")
def reader() -> Iterator[Any]:
    """The module under its own name, as users import it."""
    sys.path.insert(0, str(FILE.parent))
    import pbrnet_reader

    yield pbrnet_reader
    sys.path.remove(str(FILE.parent))
    del sys.modules["pbrnet_reader"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A packed dataset of several shards and row groups."""
    params = small_params(row_group=2, shard_mb=1)
    data = make_data(tmp_path_factory.mktemp("reader"), params)
    pack_dataset(data, params)
    return data / "dataset"


def names_of(rows: Any) -> list[tuple[str, str]]:
    return [(row["scene_id"], row["view_id"]) for row in rows]


def test_the_file_needs_numpy_and_pyarrow_alone(folder: Path) -> None:
    names = {
        (node.module or "" if isinstance(node, ast.ImportFrom) else alias.name).partition(".")[0]
        for node in ast.parse(FILE.read_text()).body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert names - sys.stdlib_module_names == {"numpy", "pyarrow"}
    assert (folder / "pbrnet_reader.py").read_bytes() == FILE.read_bytes()


def test_rows_are_those_that_the_dataset_stores(reader: Any) -> None:
    shard = SAMPLE / "test-00000-of-00001.parquet"
    true = rows_of(pq.read_table(shard))
    found = list(reader.read(SAMPLE, split="test"))
    assert len(true) == len(found) > 0
    for one, other in zip(true, found, strict=True):
        assert one.keys() == other.keys()
        for name, value in one.items():
            if name.startswith("preview"):
                assert other[name] == value["bytes"]
            elif isinstance(value, np.ndarray):
                np.testing.assert_array_equal(value, other[name])
                assert value.dtype == other[name].dtype
            else:
                assert other[name] == value


def test_radiance_comes_in_the_unit_of_the_renderer(reader: Any) -> None:
    stored = reader.Rows(SAMPLE, split="test")
    rows = reader.Rows(SAMPLE, split="test", renderer_units=True)
    scaled = set()
    for one, other in zip(stored, rows, strict=True):
        assert other["radiance_scale"] == 1
        for name in one:
            if isinstance(one[name], np.ndarray) and not np.array_equal(one[name], other[name]):
                true = one[name].astype(np.float32) * np.float32(one["radiance_scale"])
                np.testing.assert_array_equal(other[name], true)
                scaled.add(name)
    assert scaled == RADIANCES | {"lights"}
    row = rows[0]
    display = reader.reinhard(row["color"], row["exposure_color"], row["white_color"])
    true = tonemap(row["color"], Exposure(row["exposure_color"], row["white_color"]))
    np.testing.assert_allclose(display, true, atol=1e-5)


@pytest.mark.parametrize("task", TASKS)
def test_a_task_reads_its_columns_alone(task: str, reader: Any) -> None:
    row = next(reader.read(SAMPLE, task))
    assert list(row) == reader.TASKS[task].split()


@pytest.mark.parametrize("columns", [*TASKS, None])
def test_torch_batches_any_columns(columns: str | None, reader: Any) -> None:
    split = "all" if columns else "validation"
    batches = list(DataLoader(reader.TorchStream(SAMPLE, columns, split), batch_size=4))
    rows = list(reader.read(SAMPLE, columns, split))
    assert len(batches) == len(rows) / 4 and batches[0].keys() == rows[0].keys()
    for name in batches[0].keys() & {"trajectory", "frame", "material_names", "light_names"}:
        found = [value for batch in batches for value in batch[name]]
        fillers = {"trajectory": "", "frame": -1}
        true = [fillers[name] if row[name] is None else row[name] for row in rows]
        assert found == ([json.dumps(one) for one in true] if "names" in name else true)


@pytest.mark.parametrize("workers", [0, 1, 3])
@pytest.mark.parametrize("seed", [None, 7])
def test_each_row_comes_once_with_any_number_of_workers(
    workers: int, seed: int | None, folder: Path, reader: Any
) -> None:
    columns = ["scene_id", "view_id", "color"]
    every = names_of(reader.Rows(folder, columns, "all"))
    stream = reader.TorchStream(folder, columns, "all", seed=seed)
    assert isinstance(stream, IterableDataset) and len(stream) == len(every) == 12
    passes = []
    for epoch in (0, 1, 0):
        stream.set_epoch(epoch)
        loader = DataLoader(stream, batch_size=None, num_workers=workers)
        passes.append(names_of(loader))
    assert [sorted(one) for one in passes] == [sorted(every)] * 3
    assert passes[0] == passes[2]
    assert (passes[0] == passes[1]) == (seed is None)
    if workers == 0 and seed is None:
        assert passes[0] == every


def test_passes_without_workers_differ_by_themselves(folder: Path, reader: Any) -> None:
    stream = reader.Stream(folder, ["scene_id", "view_id"], "all", seed=0, buffer=3)
    first, second = names_of(stream), names_of(stream)
    assert first != second and sorted(first) == sorted(second)


def test_torch_draws_rows_by_number_in_fresh_processes(folder: Path, reader: Any) -> None:
    rows = reader.TorchDataset(folder, ["depth", "K"], "all", renderer_units=True)
    assert isinstance(rows, Dataset)
    loader = DataLoader(rows, 4, shuffle=True, num_workers=1, multiprocessing_context="spawn")
    batches = list(loader)
    assert [tuple(batch["depth"].shape) for batch in batches] == [(4, 24, 32)] * 3
    true = np.sort([row["depth"].sum() for row in rows])
    found = np.sort(np.concatenate([batch["depth"].sum((1, 2)) for batch in batches]))
    np.testing.assert_allclose(found, true, rtol=1e-6)
    assert np.array_equal(rows[-1]["depth"], rows[11]["depth"])
    with pytest.raises(IndexError):
        rows[12]


class Hub(MemoryFileSystem):
    """Stand-in for the hub's file system."""

    protocol = "hf"

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return str(super()._strip_protocol(path.replace("hf://", "memory://")))


@pytest.mark.parametrize("place", ["", "/data"])  # the second is that of `push_to_hub`
def test_rows_come_from_a_hub_and_other_stores(
    place: str, folder: Path, reader: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules["fsspec.registry"]._registry, "hf", Hub)
    store = MemoryFileSystem()
    for path in folder.glob("*.parquet"):
        store.pipe(f"/datasets/owner/views{place}/{path.name}", path.read_bytes())
    true = [row["depth"] for row in reader.read(folder, ["depth"], "test")]
    try:
        for source in ("owner/views", f"memory://datasets/owner/views{place}"):
            rows = [row["depth"] for row in reader.read(source, ["depth"], "test")]
            np.testing.assert_array_equal(rows, true)
    finally:
        store.rm("/datasets", recursive=True)


@pytest.mark.parametrize(
    ("source", "columns", "split", "words"),
    [
        ("nowhere", None, "train", "no such folder"),
        (SAMPLE.parent, None, "train", "no train shards"),
        (SAMPLE, None, "trian", "no trian shards; splits: test, train, validation"),
        (SAMPLE, "colour", "train", "colour is no task"),
        (SAMPLE, ["colour"], "train", "no column colour"),
    ],
)
def test_faults_are_named(
    source: Path | str, columns: Any, split: str, words: str, reader: Any
) -> None:
    with pytest.raises((FileNotFoundError, KeyError), match=words):
        reader.read(source, columns, split)


def test_a_missing_shard_is_noticed(tmp_path: Path, reader: Any) -> None:
    shard = SAMPLE / "test-00000-of-00001.parquet"
    (tmp_path / "test-00000-of-00002.parquet").symlink_to(shard)
    with pytest.raises(FileNotFoundError, match="missing"):
        reader.read(tmp_path, split="test")


def test_a_copy_without_units_is_not_scaled_wrongly(tmp_path: Path, reader: Any) -> None:
    table = pq.read_table(SAMPLE / "test-00000-of-00001.parquet", columns=["color"])
    copy = tmp_path / "data" / "test-00000-of-00001.parquet"
    copy.parent.mkdir()
    pq.write_table(pa.table({"color": table["color"]}), copy)
    assert next(reader.read(tmp_path, split="test"))["color"].shape == (72, 96, 3)
    with pytest.raises(ValueError, match="units"):
        reader.read(tmp_path, split="test", renderer_units=True)


@pytest.mark.slow
def test_the_distribution_is_the_one_file(tmp_path: Path) -> None:
    command = [sys.executable, "-c", BUILD, str(tmp_path)]
    subprocess.run(command, cwd=FILE.parent, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("pbrnet_reader-*-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        plain = [name for name in archive.namelist() if ".dist-info/" not in name]
        assert plain == ["pbrnet_reader.py"]
        assert archive.read("pbrnet_reader.py") == FILE.read_bytes()
    program = "\n".join(
        [
            "import sys; sys.modules['pbrnet'] = None",
            "from pbrnet_reader import read",
            f"for row in read({str(SAMPLE)!r}, columns=['color', 'depth']):",
            "    print(row['color'].shape)",
        ]
    )
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    ran = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert set(ran.stdout.split("\n")) == {"(72, 96, 3)", ""}


# Of a copy: setuptools leaves build folders in the sources.
BUILD = """
import os, shutil, sys, tempfile
from setuptools import build_meta
with tempfile.TemporaryDirectory() as copy:
    shutil.copytree(".", copy, dirs_exist_ok=True)
    os.chdir(copy)
    build_meta.build_wheel(sys.argv[1])
"""
