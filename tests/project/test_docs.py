"""Documentation agrees with the code: generated parts, links, names of files."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.fixtures.paths import ROOT

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
LINK = re.compile(r"\]\(([^)\s]+)\)")
TOCTREE = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)
CODE = re.compile(r"`((?:scenes|pipeline|model|tests|benchmarks|examples|params|docs)/[\w./-]+)`")
NAME_IN = re.compile(r"`(\w+)(?:\.(\w+))?`,? (?:in |of |\()`(\w+/[\w./-]+\.(?:py|toml|yaml))`")


def slug(heading: str) -> str:
    """Anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def anchors(page: Path) -> set[str]:
    lines = page.read_text().splitlines()
    return {slug(line.lstrip("#")) for line in lines if line.startswith("#")}


def test_no_docstring_begins_with_a_question_word() -> None:
    """PEP 257: a docstring's first line names the thing."""
    words = ("What ", "Which ", "Where ", "How ", "When ", "Whether ")
    folders = ("scenes", "pipeline", "model", "tests", "benchmarks", "docs", "examples")
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    found = [
        f"{path.relative_to(ROOT)}: {getattr(node, 'name', 'module')}"
        for path in paths
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, DOCUMENTED) and (ast.get_docstring(node) or "").startswith(words)
    ]
    assert found == []


def test_version_and_date_are_those_of_the_changelog() -> None:
    heading = re.search(r"^## \[([\d.]+)\] - (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    found = [project["version"], citation["version"], citation["date-released"]]
    assert heading and found == [heading[1], *heading.groups()]


def test_generated_parts_are_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, "docs/generate.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for link in LINK.findall(page.read_text()):
        path, _, anchor = link.partition("#")
        if link.startswith("http"):
            continue
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            broken.append(link)
    assert not broken


def test_the_site_lists_every_page_once() -> None:
    trees = TOCTREE.findall((ROOT / "docs" / "index.md").read_text())
    listed = [line for tree in trees for line in tree.splitlines() if re.match(r"\w", line)]
    assert sorted(listed) == sorted(
        {page.stem for page in PAGES if page.parent != ROOT} - {"index"}
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_files_exist(page: Path) -> None:
    names = [
        name
        for name in CODE.findall(page.read_text())
        if not {"NAME", "FORMAT.py", "NAME.py"} & {*name.split("/")}
    ]  # but for the placeholders of recipes
    assert [name for name in names if not (ROOT / name).exists()] == []


def test_names_are_in_the_files_named_beside_them() -> None:
    found = [match for page in PAGES for match in NAME_IN.findall(page.read_text())]
    assert len(found) >= 20
    for *names, file in found:
        text = (ROOT / file).read_text()
        assert all(re.search(rf"\b{name}\b", text) for name in names), (names, file)


def test_the_readme_reaches_its_first_link_within_two_screens() -> None:
    text = (ROOT / "README.md").read_text()
    before = text[: text.index("](docs/results.md)")]
    assert before.count("\n") <= 80
