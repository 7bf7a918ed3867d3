"""Registry of the studies: folders, commands and report sections agree with it."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import click
import pytest
from click.testing import CliRunner
from markupsafe import Markup

from pbrnet.model.figures.section import Section
from pbrnet.model.report.page import Places, write_report
from pbrnet.model.studies.commands import study
from pbrnet.model.studies.registry import STUDIES, study_command
from pbrnet.model.studies.trials.words import COMPARISONS
from pbrnet.pipeline.params import Params
from tests.fixtures.paths import ROOT

SHARED = {"trials"}  # packages that are not studies


def test_every_study_is_a_module_of_words_or_a_folder() -> None:
    folders = {path.parent.name for path in (ROOT / "model" / "studies").glob("*/__init__.py")}
    assert folders == set(STUDIES) - set(COMPARISONS) | SHARED
    for name in STUDIES:
        command = study_command(name)
        assert command.name == name and command.help and command.epilog


def test_the_group_lists_its_studies_without_torch() -> None:
    code = (
        "import sys; from click.testing import CliRunner;"
        "from pbrnet.model.studies.commands import study;"
        "import pbrnet.model.report.page;"
        "print(CliRunner().invoke(study, ['--help']).output); assert 'torch' not in sys.modules"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    words = " ".join(ran.stdout.split())  # of lines that are broken
    assert all(line in words for line in STUDIES.values())


def test_one_line_adds_a_study_to_command_line_and_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @click.command("example")
    def command() -> None:
        click.echo("measured")

    parts: dict[str, Any] = {
        "command": command,
        "report_section": lambda _records: Section(
            "study-example", "Example", Markup('<section id="study-example"></section>')
        ),
    }
    for module, name in (("command", "command"), ("results", "report_section")):
        made = ModuleType(f"pbrnet.model.studies.example.{module}")
        setattr(made, name, parts[name])
        monkeypatch.setitem(sys.modules, made.__name__, made)
    monkeypatch.setitem(STUDIES, "example", "An example.")
    assert "An example." in CliRunner().invoke(study, ["--help"]).output
    assert CliRunner().invoke(study, ["example"]).output == "measured\n"
    write_report(Places(tmp_path), Params(), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert '<section id="study-example">' in page and 'href="#study-example">Example' in page
