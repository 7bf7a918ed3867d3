"""Which files a scene may open: those in its own folder, found whatever their case or old path."""

from __future__ import annotations

from itertools import islice
from pathlib import Path, PurePosixPath, PureWindowsPath

from scenes.errors import InputError

_MAX_FILES = 50_000


class Sandbox:
    """Looks names up inside `root`, first relative to the scene's folder.

    `trusted` are paths that the user typed (parameter values): those may lie anywhere.
    """

    def __init__(self, folder: Path, root: Path | None = None, trusted: tuple[str, ...] = ()):
        self.folder = folder.resolve()
        self.root = (root or folder).resolve()
        if not self.folder.is_relative_to(self.root):
            raise InputError(f"{root}: does not contain the scene's folder {folder}")
        self.trusted = frozenset(trusted)
        self._folders = [self.folder]
        self._by_name: dict[str, Path] | None = None
        self.moved: list[tuple[str, str]] = []  # names as written and where they were found

    def add_folder(self, name: str, place: str) -> None:
        """A `<path>` element: one more folder to look in, if it is inside."""
        path = self._inside(name, place)
        if path.is_dir():
            self._folders.append(path)

    def find(self, name: str, place: str) -> Path | None:
        """The file called `name`, or None where there is none.

        A path of another machine, or of another case, is looked up by its last part.
        Raises `InputError` for a path that climbs out of the scene's folder.
        """
        if not name or "\0" in name or len(name) > 4096:
            raise InputError(f"{place}: an empty or impossible file name")
        if name in self.trusted:
            return Path(name) if Path(name).is_file() else None
        written = name.replace("\\", "/")
        foreign = PurePosixPath(written).is_absolute() or PureWindowsPath(name).drive != ""
        if not foreign:
            for folder in self._folders:
                path = self._inside(written, place, folder)
                if path.is_file():
                    return path
        found = self._names().get(PurePosixPath(written).name.lower())
        if found is not None:
            self.moved.append((name, found.relative_to(self.root).as_posix()))
        return found

    def _inside(self, name: str, place: str, folder: Path | None = None) -> Path:
        path = ((folder or self.folder) / name).resolve()
        if not path.is_relative_to(self.root):
            raise InputError(
                f"{place}: {name!r} lies outside the scene's folder {self.root}; "
                "move the file inside, or name a folder above both with --root"
            )
        return path

    def _names(self) -> dict[str, Path]:
        if self._by_name is None:
            self._by_name = {}
            for path in sorted(islice(self.folder.rglob("*"), _MAX_FILES)):
                if path.is_file() and path.resolve().is_relative_to(self.root):
                    self._by_name.setdefault(path.name.lower(), path)
        return self._by_name
