"""Layers of the project, derived from its imports: one direction, no circles, small folders."""

from __future__ import annotations

from collections import defaultdict
from graphlib import CycleError, TopologicalSorter

import pytest

from pbrnet.pipeline.imports import LAYERS, imported_files, modules
from pbrnet.scenes import import_options

SOURCES = {options.__module__.split(".")[2] for options in import_options.SOURCES} | {"procedural"}
MOST = 16  # modules and packages in a folder

MODULES = modules()
NAMES = {path: name for name, path in MODULES.items()}
PACKAGES = sorted(name for name, path in MODULES.items() if path.name == "__init__.py")
EDGES = {
    (name, NAMES[one])
    for name, path in MODULES.items()
    for one in imported_files(path)
    if one in NAMES  # not `pbrnet/__init__.py`
}


def child(package: str, module: str) -> str | None:
    """The part of a package that a module lies in; None outside of it."""
    if not module.startswith(f"{package}."):
        return None
    return module.removeprefix(f"{package}.").split(".")[0]


def circle(package: str, edges: set[tuple[str, str]]) -> list[str]:
    """Parts of a package that import each other in a circle; none if empty."""
    graph: dict[str, set[str]] = defaultdict(set)
    for importer, imported in edges:
        one, other = child(package, importer), child(package, imported)
        if one and other and one != other:
            graph[one].add(other)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def upward(edges: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Imports of a layer above one's own."""
    level = {layer: number for number, layer in enumerate(LAYERS)}
    return sorted((a, b) for a, b in edges if level[a.split(".")[1]] < level[b.split(".")[1]])


def across(edges: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Imports of a scene source by another."""
    places = [(a, b, child("pbrnet.scenes", a), child("pbrnet.scenes", b)) for a, b in edges]
    return sorted((a, b) for a, b, x, y in places if x != y and {x, y} <= SOURCES)


def test_imports_run_one_way() -> None:
    assert len(EDGES) > 500
    assert upward(EDGES) == []
    assert upward({("pbrnet.scenes.contract", "pbrnet.pipeline.views")})


@pytest.mark.parametrize("package", PACKAGES)
def test_the_parts_of_a_package_import_each_other_in_one_direction(package: str) -> None:
    assert circle(package, EDGES) == []
    parts = {part for name in MODULES if (part := child(package, name))}
    if len(parts) > 1:
        one, other = sorted(parts)[:2]
        pair = (f"{package}.{one}", f"{package}.{other}")
        assert circle(package, {pair, pair[::-1]})


def test_no_scene_source_imports_another() -> None:
    assert across(EDGES) == []
    assert across({("pbrnet.scenes.models.gltf", "pbrnet.scenes.mitsuba.shapes")})


@pytest.mark.parametrize("package", PACKAGES)
def test_a_folder_can_be_taken_in_at_a_glance(package: str) -> None:
    parts = {part for name in MODULES if (part := child(package, name))}
    modules = [part for part in parts if f"{package}.{part}" not in PACKAGES]
    assert len(modules) <= MOST, sorted(modules)
