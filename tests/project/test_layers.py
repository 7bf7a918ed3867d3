"""Layers: contracts cover every source, folders are small, functions take sections."""

import ast
import tomllib

import pytest

from pbrnet.scenes.registry import SOURCES
from tests.fixtures.paths import ROOT
from tests.project.imports import modules

MOST = 16  # modules in a folder
WHOLE = 28  # functions that take all parameters
HELD = 8  # fields that hold them, or functions of them

MODULES = modules()
PACKAGES = sorted(name for name, path in MODULES.items() if path.name == "__init__.py")


def test_the_contract_of_scene_sources_lists_all_of_them() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (listed,) = (one["modules"] for one in contracts["contracts"] if "modules" in one)
    sources = {options.__module__.rpartition(".")[0] for options in SOURCES.values()}
    assert set(listed) == sources | {"pbrnet.scenes.procedural"}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_folder_can_be_taken_in_at_a_glance(package: str) -> None:
    found = [name for name in MODULES if name.rpartition(".")[0] == package]
    plain = [name for name in found if name not in PACKAGES]
    assert len(plain) <= MOST, sorted(plain)


def is_whole(annotation: ast.expr | None) -> bool:
    """True if an annotation names all parameters."""
    names = ast.walk(annotation) if annotation else ()
    return any(isinstance(one, ast.Name) and one.id == "Params" for one in names)


def test_functions_and_classes_take_the_sections_that_they_read() -> None:
    functions, held = [], []
    for name, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                if any(is_whole(one.annotation) for one in given):
                    functions.append(f"{name}.{node.name}")
            fields = node.body if isinstance(node, ast.ClassDef) else ()
            held += [
                f"{name}.{ast.unparse(one.target)}"
                for one in fields
                if isinstance(one, ast.AnnAssign) and is_whole(one.annotation)
            ]
    assert len(functions) <= WHOLE, sorted(functions)
    assert len(held) <= HELD, sorted(held)
