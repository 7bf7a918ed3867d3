"""Access to the files of a scene, limited to the scene's own folder.

Files are found even if the case of their name or their path has changed since the scene was
written.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import resolved
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.opened_files import OpenedFiles

# Where the images of `X/meshes/X.dae` lie, seen from `X`: Gazebo's layout, and the usual others.
_TEXTURE_FOLDERS = ("materials/textures", "textures", "Textures", "maps")


def model_root(opened: OpenedFiles) -> Path | None:
    """Return the folder of a Gazebo model, whose file lies in its folder `meshes`; else None.

    Such a folder has a `model.config`, and is a package: all its files belong to the model.
    """
    parent = opened.folder.parent
    is_package = opened.folder.name == "meshes" and opened.is_file(parent / "model.config")
    return parent if is_package else None


def missing_meshes(names: Sequence[str], nothing_left: bool = False) -> str:
    """The error for mesh files, by name, that a scene needs and that are not there."""
    if nothing_left:
        return f"all meshes are missing, {names[0]!r:.200} first of {len(names):,}; add the files"
    if len(names) == 1:
        return (
            f"the mesh {names[0]!r:.200} is missing; add the file, or leave the shape out with "
            "--skip-missing"
        )
    return (
        f"{len(names):,} meshes are missing, {names[0]!r:.200} first; add the files, or leave the "
        "shapes out with --skip-missing"
    )


class Sandbox:
    """Finds files by name inside `root`, first relative to the scene's folder.

    `opened`, for the scene's folder, records each file looked for. `trusted` are names that the
    user gave as parameters; these files may lie anywhere.
    """

    def __init__(
        self, opened: OpenedFiles, root: Path | None = None, trusted: tuple[str, ...] = ()
    ) -> None:
        self.opened = opened
        self.folder = opened.folder
        self.root = resolved(root or self.folder)
        if not self.folder.is_relative_to(self.root):
            raise InputError(
                f"{root}: does not contain the scene's folder {self.folder}; see --root"
            )
        self.trusted = frozenset(trusted)
        self._folders = [self.folder]
        self.relocated: list[tuple[str, str]] = []  # name in the scene, path where it was found

    def note_relocated(self, changes: Changes) -> None:
        """Note the files that were found under another path than the scene gives."""
        for old, new in self.relocated:
            if old != new:
                changes.note("files were found under another path: {}", f"{old!r} as {new!r}")

    def add_folder(self, name: str, place: str) -> None:
        """Search one more folder (a `<path>` element); it must lie inside `root`."""
        path = self._inside(name, place)
        if path.is_dir():
            self._folders.append(path)

    def find(self, name: str, place: str, is_image: bool = False) -> Path | None:
        """Return the path of the file called `name`, or None if it is missing.

        An absolute path, or one in another case, is looked up by its last part, below the scene's
        folder and then in folders of textures beside it, as far as `root` has them. Raises
        `InputError`, with `place` in its message, for a path that leads out of `root`; but that of
        an image which is not there is looked up by its last part, too.
        """
        if not name or "\0" in name or len(name) > 4096:
            raise InputError(f"{place}: the file name is empty, too long or has a NUL character")
        if name in self.trusted:
            return Path(name) if self.opened.is_file(Path(name)) else None
        written = name.replace("\\", "/")
        foreign = PurePosixPath(written).is_absolute() or PureWindowsPath(name).drive != ""
        if not foreign:
            for folder in self._folders:
                path = folder / written
                if is_image and not self._is_inside(path) and not path.exists():
                    continue
                path = self._inside(written, place, folder)
                if self.opened.is_file(folder / written):
                    return path
        last = PurePosixPath(written).name
        beside = () if self.folder == self.root or not last else _TEXTURE_FOLDERS
        textures = [self.folder.parent / each / last for each in beside]
        for found in (*self.opened.with_name(last), *textures):
            if self._is_inside(found) and self.opened.is_file(found):
                self.relocated.append((name, found.relative_to(self.root).as_posix()))
                return found
        return None

    def _is_inside(self, path: Path) -> bool:
        return resolved(path).is_relative_to(self.root)

    def _inside(self, name: str, place: str, folder: Path | None = None) -> Path:
        path = resolved((folder or self.folder) / name)
        if not self._is_inside(path):
            raise InputError(
                f"{place}: {name!r} lies outside the scene's folder {self.root}; "
                "move the file into it, or give a folder that contains both with --root"
            )
        return path
