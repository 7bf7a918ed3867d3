"""Record of the files that an import looks for, and the check that all are still the same."""

from __future__ import annotations

import os
from itertools import islice
from pathlib import Path
from typing import Any

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, digest_folder

_MAX_FILES = 50_000  # of a folder that is searched by name


class OpenedFiles:
    """Looks files up for an import and records what it found.

    Paths in the record are relative to `folder`, the folder of the imported file.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self._files: dict[str, str | None] = {}  # path -> digest, None if absent
        self._folders: dict[str, str] = {}  # path -> digest of all that is inside
        self._names: dict[str, list[str]] = {}  # lower-case name -> paths below the folder
        self._stems: dict[str, list[str]] = {}  # lower-case stem -> paths in the folder
        self._listing: list[Path] | None = None

    def is_file(self, path: Path) -> bool:
        """Return whether `path` is a file, and record its digest or its absence."""
        name = self._relative(path)
        if name not in self._files:
            self._files[name] = _digest(path)
        return self._files[name] is not None

    def add_folder(self, path: Path) -> None:
        """Record everything inside a folder."""
        self._folders[self._relative(path)] = digest_folder(path)

    def with_name(self, name: str) -> list[Path]:
        """Return and record the files below the folder called `name`, in any case; sorted."""
        if self._listing is None:
            self._listing = _files_below(self.folder)
        found = [path for path in self._listing if path.name.lower() == name.lower()]
        self._names[name.lower()] = [self._relative(path) for path in found]
        return found

    def with_stem(self, stem: str) -> list[Path]:
        """Return and record the files directly in the folder with a stem, in any case; sorted."""
        found = _files_with_stem(self.folder, stem)
        self._stems[stem.lower()] = [self._relative(path) for path in found]
        return found

    def record(self) -> dict[str, Any]:
        """Return the record, ready for JSON and for `unchanged`."""
        return {
            "files": self._files,
            "folders": self._folders,
            "names": self._names,
            "stems": self._stems,
        }

    def _relative(self, path: Path) -> str:
        path = path.absolute()
        if not path.is_relative_to(self.folder):
            path = path.parent.resolve() / path.name
        return Path(os.path.relpath(path, self.folder)).as_posix()


def unchanged(record: Any, folder: Path) -> bool:
    """Return whether an import from `folder` would find all files as `record` says.

    False if a file was changed, removed or added where the import looked for it, and for a
    record that is absent or damaged.
    """
    folder = folder.resolve()
    try:
        if record["names"]:
            below: dict[str, list[str]] = {}
            for path in _files_below(folder):
                name = path.relative_to(folder).as_posix()
                below.setdefault(path.name.lower(), []).append(name)
            if any(below.get(name, []) != paths for name, paths in record["names"].items()):
                return False
        return (
            all(
                [path.name for path in _files_with_stem(folder, stem)] == names
                for stem, names in record["stems"].items()
            )
            and all(_digest(folder / name) == digest for name, digest in record["files"].items())
            and all(
                (folder / name).is_dir() and digest_folder(folder / name) == digest
                for name, digest in record["folders"].items()
            )
        )
    except (AttributeError, KeyError, TypeError):
        return False


def _digest(path: Path) -> str | None:
    """SHA-256 of a file; None where there is no file of this name."""
    try:
        return digest_file(path) if path.is_file() else None
    except (InputError, OSError, ValueError):
        return None


def _files_below(folder: Path) -> list[Path]:
    return [path for path in sorted(islice(folder.rglob("*"), _MAX_FILES)) if path.is_file()]


def _files_with_stem(folder: Path, stem: str) -> list[Path]:
    return [
        path
        for path in sorted(folder.iterdir())
        if path.stem.lower() == stem.lower() and path.is_file()
    ]
