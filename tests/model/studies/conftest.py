"""The command of the studies, in the workplace of a test module."""

from functools import partial

import pytest

from pbrnet.model.training.train import Folders
from tests.fixtures.command import Run


@pytest.fixture
def run(folders: Folders, pbrnet_run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """`pbrnet study` in the module's workplace: exit code, output, errors."""
    monkeypatch.chdir(folders.data.parent)
    return partial(pbrnet_run, "study")
