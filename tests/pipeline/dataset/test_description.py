"""The dataset's card, Croissant file and citation say what is true of the data."""

import io
import json
import logging
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from PIL import Image

from pbrnet.pipeline.dataset.columns import dataset_columns
from pbrnet.pipeline.dataset.description.facts import DatasetFacts, view_facts
from pbrnet.pipeline.dataset.pack import pack_dataset
from tests.fixtures.dataset import box_frames as frames_of
from tests.fixtures.dataset import make_data, make_view, rows_of, small_params, write_view
from tests.fixtures.paths import ROOT

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A packed dataset whose truth is denoised."""
    params = small_params()
    data = make_data(tmp_path_factory.mktemp("described"), params)
    for scene in range(4):
        for number in range(3):
            view = make_view(params, f"home-{scene:04d}", number)
            image = frames_of(view, params)["color"]
            told = {"denoiser": "oidn 2.5", "residual_noise": 0.03125}
            write_view(data, "color", image, view, **told)
    pack_dataset(data, params)
    return data / "dataset"


def table_of(folder: Path) -> Any:
    return pq.read_table(folder / "train-00000-of-00001.parquet")


def run_card(folder: Path, libraries: tuple[str, ...], home: Path) -> list[str]:
    """Run the card's programs for some libraries; return the last line of each.

    In the dataset's folder, beside README.md and the CSV files, and without this package.
    """
    first, *others = re.findall(r"```python\n(.*?)```", (folder / "README.md").read_text(), re.S)
    chosen = [one for one in others if re.search(rf"(import|from|,) ({'|'.join(libraries)})", one)]
    assert len(chosen) == len(libraries)
    program = "\nprint('next')\n".join([first, *chosen])
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(home)}
    ran = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    return [part.strip().splitlines()[-1] for part in ran.stdout.split("next\n")[1:]]


def test_the_programs_of_the_card_run(folder: Path, tmp_path: Path) -> None:
    lines = run_card(folder, ("datasets", "pyarrow.dataset", "torch"), tmp_path)
    assert lines == ["(24, 32, 3) float64", "(24, 32, 3)", "torch.Size([24, 32, 3])"]


@pytest.mark.check
def test_the_programs_of_the_card_run_with_other_libraries(folder: Path, tmp_path: Path) -> None:
    for library in ("polars", "duckdb"):
        pytest.importorskip(library)
    assert run_card(folder, ("polars", "duckdb"), tmp_path) == ["(24, 32, 3)"] * 2


def test_shards_hold_only_what_every_reader_knows(folder: Path) -> None:
    """No half floats, no byte stream split: DuckDB reads neither together."""
    for shard in folder.glob("*.parquet"):
        file = pq.ParquetFile(shard)
        group = file.metadata.row_group(0)
        for index in range(group.num_columns):
            column = group.column(index)
            types = ("BYTE_ARRAY", "INT32", "INT64", "FLOAT", "DOUBLE")
            assert column.physical_type in types, column.path_in_schema
            assert set(column.encodings) <= {"PLAIN", "RLE", "RLE_DICTIONARY"}
            assert column.compression in ("LZ4", "ZSTD", "UNCOMPRESSED")
        assert group.total_byte_size < 286 << 20


def test_previews_come_first(folder: Path) -> None:
    table = table_of(folder)
    names = [column.name for column in dataset_columns((32, 24), (32, 16), shadows=True)]
    first = table.column_names[:8]
    assert table.column_names == names and all(name.startswith("preview") for name in first)
    features = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    row = table.slice(0, 1).to_pylist()[0]
    pictures = {}
    for name in first:
        assert features[name] == {"_type": "Image"}
        with Image.open(io.BytesIO(row[name]["bytes"])) as picture:
            assert picture.mode == "RGB" and picture.format in ("PNG", "JPEG")
            pictures[name] = np.asarray(picture).astype(float)
            suffix = Path(row[name]["path"]).suffix
            assert suffix == {"PNG": ".png", "JPEG": ".jpg"}[picture.format]
    brightness = [pictures[f"preview{end}"].mean() for end in ("_dark", "", "_bright")]
    assert brightness == sorted(brightness) and brightness[2] > 1.5 * brightness[0]


def test_exposures_follow_from_the_cards_formula(folder: Path) -> None:
    row = rows_of(table_of(folder))[0]
    text = (folder / "README.md").read_text()
    for name in ("color", "shading"):
        light = row[name].astype(np.float64) @ LUMINANCE * row["radiance_scale"]
        blocks = light.reshape(3, 8, 4, 8).mean(axis=(1, 3))
        key = float(re.search(r"exposure = ([\d.]+) / exp", text)[1])  # type: ignore[index]
        burn = float(re.search(r"\* exposure \* ([\d.]+)", text)[1])  # type: ignore[index]
        exposure = key / np.exp(np.log(blocks[blocks > 0]).mean())
        assert row[f"exposure_{name}"] == pytest.approx(exposure, rel=1e-3)
        white = light.max() * exposure * burn
        assert row[f"white_{name}"] == pytest.approx(white, rel=1e-3)


def test_the_card_says_that_the_truth_is_denoised(folder: Path) -> None:
    row = rows_of(table_of(folder))[0]
    assert (row["denoiser"], row["residual_noise_color"]) == ("oidn 2.5", 0.03125)
    text = (folder / "README.md").read_text()
    assert "**Both are denoised**" in text
    assert "median 3.1%, 95 % of the views below 3.1%" in text


def facts_of(row: dict[str, Any]) -> DatasetFacts:
    return DatasetFacts((view_facts(row, 0.5),))


def test_the_card_tells_where_colour_is_the_product(folder: Path) -> None:
    row = rows_of(table_of(folder))[0]
    assert set(facts_of(row).product.values()) == {"100 %"}, "the box room has no other light"
    assert facts_of(row).matt_product == {}
    row["color"] = row["color"].copy()
    row["color"][:12] *= np.float16(1.2)  # half of the pixels a fifth brighter
    row["color"][:6] *= np.float16(2)  # a quarter far brighter
    assert facts_of(row).product == {"5 %": "50 %", "10 %": "50 %", "25 %": "75 %"}
    row["valid"] = row["valid"].copy()
    row["valid"][:6] = 0
    assert facts_of(row).product["5 %"] == "67 %" and facts_of(row).without_surface == "25 %"
    ones = np.ones((24, 32))
    rough = np.where(np.arange(24)[:, None] < 18, 0.8, 0.2) * ones
    row |= {"roughness": rough, "metalness": 0 * ones, "emission": 0 * ones}
    row["material_known"] = ones
    assert facts_of(row).matt == "67 %"
    assert facts_of(row).matt_product == {"5 %": "50 %", "10 %": "50 %", "25 %": "100 %"}
    text = (folder / "README.md").read_text()
    assert "is an approximation" in text and "5 % on 100 %" in text


def test_croissant_is_valid_without_warnings(folder: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    told: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            told.append(record.getMessage())

    listener, loggers = Listener(logging.WARNING), [logging.getLogger(), logging.getLogger("absl")]
    for logger in loggers:
        logger.addHandler(listener)
    try:
        read = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
        row = next(iter(read.records("views")))
    finally:
        for logger in loggers:
            logger.removeHandler(listener)
    issues = read.metadata.ctx.issues
    assert (issues.errors, issues.warnings, told) == (set(), set(), [])
    planes = np.load(io.BytesIO(row["views/color"]))
    image = np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]
    first = rows_of(pq.read_table(min(folder.glob("*.parquet"))))[0]
    np.testing.assert_array_equal(image, first["color"])
    assert np.shape(row["views/K"]) == (3, 3)
    described = json.loads((folder / "croissant.json").read_text())
    for name in ("dataCollection", "dataBiases", "dataLimitations", "dataUseCases"):
        assert described[f"rai:{name}"]
    assert "personalSensitiveInformation" in str(described.keys())


def test_citations_name_the_same_version(folder: Path) -> None:
    cited = yaml.safe_load((folder / "CITATION.cff").read_text())
    described = json.loads((folder / "croissant.json").read_text())
    assert cited["cff-version"] == "1.2.0" and cited["type"] == "dataset"
    assert cited["version"] == described["version"]
    assert f"version = {{{cited['version']}}}" in (folder / "README.md").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    own = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (own["version"], own["license"]) == (project["version"], project["license"])
