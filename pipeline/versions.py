"""Versions of the code: of the whole package, and of the modules that determine an output.

Workers that run other code than the command must not do its work. Outputs whose fingerprint
contains a `source_revision` are made again when a module that they depend on changes.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from scenes.errors import MachineError
from scenes.files import digest_bytes, digest_file

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("pipeline", "scenes")
PACKED = _ROOT / "weights"  # pretrained networks: a checkout's, or an installation's


@lru_cache(maxsize=1)
def code_version() -> str:
    """Return a short digest of the sources of `pipeline` and `scenes`, by name and content."""
    sources = (path for package in _PACKAGES for path in (_ROOT / package).rglob("*.py"))
    return _digest(_ROOT, sorted(sources))[:12]


def require_code(wanted: str) -> None:
    """Raise `MachineError` unless this process runs the code version `wanted`."""
    if code_version() != wanted:
        raise MachineError(
            f"a worker runs pbrnet {code_version()}, this command is {wanted}: install the same "
            "version on all workers and restart them"
        )


@lru_cache
def source_revision(*modules: str, root: Path = _ROOT) -> str:
    """Return a digest of the sources of these modules and of all that they import.

    `modules` are dotted names; imports are followed within the project below `root`, also those
    inside functions. Raises `FileNotFoundError` if a module does not exist.
    """
    return _digest(root, import_closure(root, modules))


def import_closure(root: Path, modules: tuple[str, ...]) -> list[Path]:
    """Return the sorted source files of the modules and of all that they import below `root`."""
    found: set[Path] = set()
    pending = [root / Path(*module.split(".")).with_suffix(".py") for module in modules]
    while pending:
        path = pending.pop()
        if path not in found:
            found.add(path)
            pending += _imported(root, path)
    return sorted(found)


def _imported(root: Path, path: Path) -> Iterator[Path]:
    """Yield the modules below `root` that a module imports by absolute import."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            file = (root / Path(*name.split("."))).with_suffix(".py")
            if file.is_file():
                yield file


def _digest(root: Path, sources: list[Path]) -> str:
    parts = []
    for path in sources:
        parts += [path.relative_to(root).as_posix().encode(), digest_file(path).encode()]
    return digest_bytes(*parts)
