"""Layers of the project, derived from its imports: one direction, no circles, small folders."""

from __future__ import annotations

import ast
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.fixtures.paths import ROOT

LAYERS = ("scenes", "pipeline", "model")  # each may import those before it
SOURCES = ("mitsuba", "models", "procedural", "sweethome")  # scene sources, in `scenes`
MOST = 16  # modules and packages in a folder

MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for layer in LAYERS
    for path in sorted((ROOT / layer).rglob("*.py"))
}
PACKAGES = sorted(name for name, path in MODULES.items() if path.name == "__init__.py")


def imports(path: Path, modules: dict[str, Path]) -> set[str]:
    """Names of the project's modules that a file imports, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                within = f"{node.module}.{name.name}"
                found.add(within if within in modules else node.module)
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return {name for name in found if name in modules}


EDGES = {(name, other) for name, path in MODULES.items() for other in imports(path, MODULES)}


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
    return sorted((a, b) for a, b in edges if level[a.split(".")[0]] < level[b.split(".")[0]])


def across(edges: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Imports of a scene source by another."""
    places = [(a, b, child("scenes", a), child("scenes", b)) for a, b in edges]
    return sorted((a, b) for a, b, x, y in places if x != y and {x, y} <= set(SOURCES))


def test_imports_run_one_way() -> None:
    assert len(EDGES) > 500
    assert upward(EDGES) == []
    assert upward({("scenes.contract", "pipeline.views")})


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
    assert across({("scenes.models.gltf", "scenes.mitsuba.shapes")})


@pytest.mark.parametrize("package", PACKAGES)
def test_a_folder_can_be_taken_in_at_a_glance(package: str) -> None:
    parts = {part for name in MODULES if (part := child(package, name))}
    modules = [part for part in parts if f"{package}.{part}" not in PACKAGES]
    assert len(modules) <= MOST, sorted(modules)
