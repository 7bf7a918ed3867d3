"""Mutants: the faults of `mutants.toml`, each tried alone in a copy of the project, are found."""

import os
import random
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.costs import seed
from tests.fixtures.paths import ROOT

CHANGED = (
    "scenes",
    "pipeline",
    "model",
    "reader",
    "pbrnet",
    "benchmarks",
    "tests",
)  # copied; others are links
LEFT_OUT = (".git", ".venv", "build", "data", "models")

pytestmark = pytest.mark.timeout(1200)


@dataclass(frozen=True)
class Mutant:
    """A fault: in `file` `text`, which occurs once, becomes `instead`, and then `test` fails."""

    file: str
    text: str
    instead: str
    test: str


TABLE = tomllib.loads(Path(__file__).with_name("mutants.toml").read_text())["mutant"]
MUTANTS = [Mutant(**row) for row in TABLE]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project; times of files stay, and with them compiled modules."""
    folder = tmp_path_factory.mktemp("copy")
    for path in ROOT.iterdir():
        if path.name in CHANGED:
            shutil.copytree(path, folder / path.name, symlinks=True)
        elif path.is_file():
            shutil.copy2(path, folder)
        elif path.name not in LEFT_OUT:
            (folder / path.name).symlink_to(path)
    return folder


def tried(copy: Path, *tests: str) -> tuple[int, str]:
    """Run tests in the copy: the exit code and what pytest said."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
    )
    return done.returncode, done.stdout + done.stderr


def check_that_it_is_found(mutant: Mutant, copy: Path) -> None:
    """Check that a test fails for a fault, and not for want of what it needs."""
    file = copy / mutant.file
    file.write_text(file.read_text().replace(mutant.text, mutant.instead))
    try:
        code, said = tried(copy, mutant.test)
    finally:
        shutil.copy2(ROOT / mutant.file, file)
    assert code == 1 and "\nFAILED " in said, said


def test_each_mutant_is_one_change_and_names_a_test() -> None:
    assert len(MUTANTS) >= 20
    for mutant in MUTANTS:
        assert mutant.file.partition("/")[0] in CHANGED, f"{mutant.file} would be changed in place"
        assert (ROOT / mutant.file).read_text().count(mutant.text) == 1, mutant
        file, *names = mutant.test.split("::")
        for name in names:
            assert re.search(rf"\b(def|class) {name}\b", (ROOT / file).read_text()), mutant


@pytest.mark.slow
def test_a_mutant_drawn_at_random_is_found(copy: Path) -> None:
    check_that_it_is_found(random.Random(seed()).choice(MUTANTS), copy)


@pytest.mark.check
def test_the_named_tests_pass_without_a_mutant(copy: Path) -> None:
    code, said = tried(copy, *dict.fromkeys(mutant.test for mutant in MUTANTS))
    assert code == 0 and "skipped" not in said.splitlines()[-1], said


@pytest.mark.check
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda one: one.file)
def test_a_mutant_is_found(mutant: Mutant, copy: Path) -> None:
    check_that_it_is_found(mutant, copy)
