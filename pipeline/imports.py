"""Imports between the project's modules, read from their source text."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("scenes", "pipeline", "model")  # each imports only itself and those before it


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return the files of all modules of the layers by dotted name, packages by their own."""
    found = {}
    for layer in LAYERS:
        for path in sorted((root / layer).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def imported_files(path: Path, root: Path = ROOT) -> Iterator[Path]:
    """Yield the files below `root` that a module imports by absolute imports, inside functions too.

    A package that is imported as a whole is its `__init__.py`.
    """
    for node in ast.walk(ast.parse(path.read_bytes())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            found = [name for name in inside if _file(name, root)]
            names = found if len(found) == len(inside) else [node.module, *found]
        for name in names:
            file = _file(name, root)
            if file:
                yield file


def import_closure(
    paths: Collection[Path], root: Path = ROOT, left_out: Collection[Path] = ()
) -> list[Path]:
    """Return the sorted files of modules and of all that they import, directly or indirectly.

    `left_out` are files and folders that are neither in the result nor followed. Raises
    `FileNotFoundError` if one of `paths` does not exist.
    """
    found: set[Path] = set()
    pending = list(paths)
    while pending:
        path = pending.pop()
        if path not in found and not set(left_out) & {path, *path.parents}:
            found.add(path)
            pending += imported_files(path, root)
    return sorted(found)


def _file(name: str, root: Path) -> Path | None:
    base = root / Path(*name.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None
