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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A packed dataset."""
    params = small_params()
    data = make_data(tmp_path_factory.mktemp("examples"), params)
    pack_dataset(data, params)
    return data / "dataset"


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("with_pyarrow.py", "color (4, 24, 32, 3) float32"),
        ("with_datasets.py", "home-0000 000 (24, 32, 3) depth (24, 32)"),
        ("with_torch.py", "shading (2, 24, 32, 3) color (2, 24, 32, 3) torch.float32"),
    ],
)
def test_the_script_reads_the_dataset(
    script: str, expected: str, folder: Path, tmp_path: Path
) -> None:
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
    assert expected in ran.stdout
