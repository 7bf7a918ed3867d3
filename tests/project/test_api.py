"""`import pbrnet` offers what docs/api.md lists and imports it late."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import pbrnet
from tests.fixtures.paths import ROOT

PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


def test_the_page_lists_every_name_and_each_can_be_imported() -> None:
    table = PAGE.split("## Read a dataset")[0]
    listed = set(re.findall(r"`(\w+)[(`]", table)) & set(dir(pbrnet))
    assert listed >= set(pbrnet.__all__)
    for name in pbrnet.__all__:
        assert getattr(pbrnet, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = pbrnet.nothing


def test_type_checkers_see_what_is_imported_late() -> None:
    text = Path(pbrnet.__file__).read_text(encoding="utf-8")
    typed = re.findall(r"from pbrnet\.([\w.]+) import (\w+) as \2", text)
    assert {(name, module) for module, name in typed} == set(pbrnet._HOMES.items())


def test_the_import_takes_nothing_along() -> None:
    code = "import sys, pbrnet; print([m for m in ('numpy', 'torch', 'yaml') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == "[]", done.stderr
