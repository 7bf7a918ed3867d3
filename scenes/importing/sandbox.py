"""Access to the files of a scene: only inside its folder, in any case, by old paths too."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

from scenes.errors import InputError
from scenes.opened_files import OpenedFiles


class Sandbox:
    """Looks names up inside `root`, first relative to the scene's folder.

    `opened` is of the scene's folder and records each look-up. `trusted` are paths that the user
    typed (parameter values): those may lie anywhere.
    """

    def __init__(
        self, opened: OpenedFiles, root: Path | None = None, trusted: tuple[str, ...] = ()
    ) -> None:
        self.opened = opened
        self.folder = opened.folder
        self.root = (root or self.folder).resolve()
        if not self.folder.is_relative_to(self.root):
            raise InputError(f"{root}: does not contain the scene's folder {self.folder}")
        self.trusted = frozenset(trusted)
        self._folders = [self.folder]
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
            return Path(name) if self.opened.is_file(Path(name)) else None
        written = name.replace("\\", "/")
        foreign = PurePosixPath(written).is_absolute() or PureWindowsPath(name).drive != ""
        if not foreign:
            for folder in self._folders:
                path = self._inside(written, place, folder)
                if self.opened.is_file(folder / written):
                    return path
        for found in self.opened.with_name(PurePosixPath(written).name):
            if found.resolve().is_relative_to(self.root) and self.opened.is_file(found):
                self.moved.append((name, found.relative_to(self.root).as_posix()))
                return found
        return None

    def _inside(self, name: str, place: str, folder: Path | None = None) -> Path:
        path = ((folder or self.folder) / name).resolve()
        if not path.is_relative_to(self.root):
            raise InputError(
                f"{place}: {name!r} lies outside the scene's folder {self.root}; "
                "move the file inside, or name a folder above both with --root"
            )
        return path
