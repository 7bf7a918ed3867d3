"""Imports between the project's modules, read from their source text."""

import ast
from collections.abc import Collection, Iterator
from functools import lru_cache
from pathlib import Path

from pbrnet.scenes.installation import IMPORT_FOLDER

ROOT = IMPORT_FOLDER
LAYERS = ("scenes", "pipeline", "model")  # each imports only itself and those before it


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return the files of all modules of the layers by dotted name, packages by their own."""
    found = {}
    for layer in LAYERS:
        for path in sorted((root / "pbrnet" / layer).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def imported_files(path: Path, root: Path = ROOT) -> Iterator[Path]:
    """Yield the files below `root` that a module imports by absolute imports, inside functions too.

    A package that is imported as a whole is its `__init__.py`.
    """
    for module, names in _imports(path.read_bytes()):
        inside = [f"{module}.{name}" for name in names]
        found = [name for name in inside if _file(name, root)]
        for name in found if inside and len(found) == len(inside) else [module, *found]:
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


@lru_cache(maxsize=1024)
def _imports(source: bytes) -> list[tuple[str, tuple[str, ...]]]:
    """Return the modules that a source text imports when it runs, each with the names taken."""
    found: list[tuple[str, tuple[str, ...]]] = []
    pending: list[ast.AST] = [ast.parse(source)]
    while pending:  # statements only: most nodes are expressions, which import nothing
        node = pending.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            pending += node.orelse
            continue
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            pending += getattr(node, block, ())
        if isinstance(node, ast.Import):
            found += [(alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.module, tuple(alias.name for alias in node.names)))
    return found


def _file(name: str, root: Path) -> Path | None:
    base = root / Path(*name.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None
