"""The newest Mitsuba with the Dr.Jit it asks for: may the pair in pyproject.toml be raised?"""

import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.fixtures.paths import ROOT

TESTS = ("tests/pipeline/pathtrace/test_integrator.py", "tests/pipeline/render")


@pytest.mark.check
@pytest.mark.xfail(reason="pyproject.toml pins the pair that is known to work", strict=False)
def test_the_renderer_s_tests_pass_with_the_newest_pair(tmp_path: Path) -> None:
    venv.create(tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python"
    (library,) = (tmp_path / "venv").glob("lib/python*/site-packages")
    places = [place for place in sys.path if place.endswith("-packages")]
    (library / "others.pth").write_text("\n".join(places))
    command = [sys.executable, "-m", "pip", "--quiet", "--python", python, "install"]
    subprocess.run([*command, "--upgrade", "--target", library, "mitsuba"], check=True)
    subprocess.run([python, "-m", "pytest", "-q", "-x", *TESTS], cwd=ROOT, check=True)
