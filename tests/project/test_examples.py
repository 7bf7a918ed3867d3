"""The example scripts run as they are, without this package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.dataset.pack import pack_dataset
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.paths import ROOT

EXAMPLES = ROOT / "examples" / "consume"
FOREIGN = pytest.mark.check  # libraries that this project does not install


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A packed dataset."""
    params = small_params(row_group=2)
    data = make_data(tmp_path_factory.mktemp("examples"), params)
    pack_dataset(data, params)
    return data / "dataset"


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("with_pyarrow.py", ["(24, 32) (24, 32, 3) float16 float64"] * 6),
        ("with_datasets.py", ["home-0000 00"] * 3 + ["home-0001 00"] * 3),
        ("with_torch.py", ["shading (2, 24, 32, 3) color torch.float32"] * 3),
        pytest.param("with_polars.py", ["home-0002 (24, 32, 3) (3, 3)"] * 3, marks=FOREIGN),
        pytest.param("with_duckdb.py", ["home-0002 (24, 32, 3) (3, 3)"] * 3, marks=FOREIGN),
    ],
)
def test_the_script_reads_the_dataset(
    script: str, expected: list[str], folder: Path, tmp_path: Path
) -> None:
    pytest.importorskip(script.removeprefix("with_").removesuffix(".py"))
    source = (EXAMPLES / script).read_text()
    for package in ("pipeline", "scenes", "model"):
        assert f"import {package}" not in source and f"from {package}" not in source
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")}
    ran = subprocess.run(
        [sys.executable, EXAMPLES / script, folder],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    lines = [line for line in ran.stdout.splitlines() if line.strip()]
    assert len(lines) == len(expected), "each row once, also with two workers"
    assert all(line.startswith(words) for line, words in zip(lines, expected, strict=True)), lines
