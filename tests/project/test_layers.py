"""Layers: contracts cover every source, folders are small, functions take sections."""

import ast
import tomllib

import pytest

from pbrnet.scenes.registry import SOURCES
from tests.fixtures.paths import ROOT
from tests.project.imports import modules

MOST = 16  # modules in a folder
WHOLE = 30  # functions that take all parameters

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


def test_functions_take_the_sections_that_they_read() -> None:
    whole = [
        f"{name}.{function.name}"
        for name, path in MODULES.items()
        for function in ast.walk(ast.parse(path.read_bytes()))
        if isinstance(function, ast.FunctionDef)
        and any(
            one.annotation is not None and "Params" in ast.unparse(one.annotation).split(" | ")
            for one in (*function.args.args, *function.args.kwonlyargs)
        )
    ]
    assert len(whole) <= WHOLE, sorted(whole)
