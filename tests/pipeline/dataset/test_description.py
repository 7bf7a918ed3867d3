"""The dataset's card, Croissant file and citation say what is true of the data."""

import io
import json
import logging
import os
import re
import subprocess
import sys
import tomllib
import venv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from PIL import Image
from scipy import ndimage

from pbrnet.pipeline.dataset.columns import dataset_columns
from pbrnet.pipeline.dataset.description.facts import DatasetFacts, citation_file, view_facts
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.reader import chosen_columns
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


PROGRAMS = {
    "import read": ["(24, 32, 3) float32"] * 6,
    "TorchStream": ["torch.Size([2, 24, 32, 3]) torch.float32"] * 6,
    "load_dataset": ["(24, 32, 3) float64", "(24, 32)"],
    "to_pandas": ["6 (24, 32, 3)"],
    "np.load": ["(24, 32, 3)"],
    "polars": ["(24, 32, 3) (3, 3)"],
    "duckdb": ["(24, 32, 3)"],
}
FOREIGN = ("polars", "duckdb")  # that this project does not install


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with NumPy, pyarrow and the foreign libraries alone."""
    folder = tmp_path_factory.mktemp("bare")
    venv.create(folder, with_pip=True)
    command = [
        folder / "bin" / "python",
        "-m",
        "pip",
        "install",
        "-q",
        "numpy",
        "pyarrow",
        *FOREIGN,
    ]
    if subprocess.run(command).returncode:
        pytest.skip("no package index")
    return folder / "bin" / "python"


@pytest.mark.parametrize(
    "program", [pytest.param(p, marks=pytest.mark.check if p in FOREIGN else ()) for p in PROGRAMS]
)
def test_a_program_of_the_card_runs(
    program: str, folder: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Elsewhere, without this package, with what lies in the dataset's folder."""
    python = request.getfixturevalue("bare") if program in FOREIGN else sys.executable
    codes = re.findall(r"```python\n(.*?)```", (folder / "README.md").read_text(), re.S)
    assert len(codes) == len(PROGRAMS)
    (code,) = (code for code in codes if program in code)
    code = "import sys; sys.modules['pbrnet'] = None\n" + code.replace("FOLDER", str(folder))
    environment = {
        **os.environ,
        "PYTHONPATH": str(folder),
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(tmp_path / "cache"),
    }
    ran = subprocess.run(
        [python, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines() == PROGRAMS[program]


def test_a_task_is_a_configuration_that_loads_its_columns_alone(folder: Path) -> None:
    front = yaml.safe_load((folder / "README.md").read_text().split("---\n")[1])
    configs = {one.pop("config_name"): one for one in front["configs"]}
    assert list(configs) == ["default", "depth", "intrinsic"], "it has no labels, light, video"
    names = table_of(folder).column_names
    assert "columns" not in configs["default"]
    for task in ("depth", "intrinsic"):
        chosen = set(chosen_columns(task, names))
        assert configs[task]["columns"] == [name for name in names if name in chosen]
        assert configs[task]["data_files"] == configs["default"]["data_files"]


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
    names = [column.name for column in dataset_columns(small_params())]
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


FORMULA = """
    white = 0.18 * 2^3.6
    A     = exp(mean(log(L(B))))       B: means over blocks of 8 x 8 pixels, without black ones
    gain  = 0.16 / A * 2^clip(0.25 * log2(A / 0.00064), -1.6, 0.4)
    gain  = gain / clip(q, 1, 2^0.6)   q: quantile 0.95 of L(r) * gain / white
    I     = sqrt(mean((gain * B)^2))   over the B with all bands of gain * B below white
    g     = clip((L(I) / max(I, L(I) / 1000))^0.75, 0.25, 4)
    g     = g * L(I) / L(g * I)
    t     = min(gain * L(r) / white, 1)^(1 / 2.2)
    r     = r * ((t + clip(t - blur(t), -0.1, 0.1)) / t)^2.2   where 0 < t < 1
    x     = min(gain * g * r, white)^1.35
    m, k  = white^1.35, 0.18^1.35
    h     = 0.82 * m * k / (0.18 * m - k)
    y     = (1 + h / m) * x / (x + h)
"""


def test_previews_follow_from_the_cards_formula(folder: Path) -> None:
    text = (folder / "README.md").read_text()
    assert FORMULA in text and "Gaussian `blur` of\n0.8 pixels" in text
    row = rows_of(table_of(folder))[0]
    r = row["color"].astype(np.float64) * row["radiance_scale"]
    blocks = r.reshape(3, 8, 4, 8, 3).mean(axis=(1, 3)).reshape(-1, 3)
    white = 0.18 * 2**3.6
    average = np.exp(np.log(blocks @ LUMINANCE).mean())
    gain = 0.16 / average * 2 ** np.clip(0.25 * np.log2(average / 0.00064), -1.6, 0.4)
    gain /= np.clip(np.quantile(r @ LUMINANCE * gain / white, 0.95), 1, 2**0.6)
    lit = gain * blocks
    light = np.sqrt((lit[(lit < white).all(axis=1)] ** 2).mean(axis=0))
    level = light @ LUMINANCE
    g = np.clip((level / np.maximum(light, level / 1000)) ** 0.75, 0.25, 4)
    g *= level / (g * light @ LUMINANCE)
    t = np.minimum(gain * (r @ LUMINANCE) / white, 1) ** (1 / 2.2)
    sharp = t + np.clip(t - ndimage.gaussian_filter(t, 0.8, mode="nearest"), -0.1, 0.1)
    r *= np.where((t > 0) & (t < 1), sharp / t, 1)[..., None] ** 2.2
    x = np.minimum(gain * g * r, white) ** 1.35
    m, k = white**1.35, 0.18**1.35
    h = 0.82 * m * k / (0.18 * m - k)
    y = (1 + h / m) * x / (x + h)
    display = np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055)
    with Image.open(io.BytesIO(row["preview"]["bytes"])) as picture:
        np.testing.assert_allclose(255 * display, np.asarray(picture), atol=0.6)


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


def test_a_citation_names_single_known_licences() -> None:
    made = yaml.safe_load(citation_file(["CC-BY-4.0", "MIT AND CC0-1.0", "unknown"]))
    assert made["license"] == ["CC-BY-4.0", "CC0-1.0", "MIT"]
    assert yaml.safe_load(citation_file(["MIT"]))["license"] == "MIT"
    assert "license" not in yaml.safe_load(citation_file(["unknown"]))
