"""The zip that a home is: members by checked names, within limits of size and compression."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path, PurePosixPath

from scenes.errors import InputError

MAX_MEMBERS = 20_000
MAX_MEMBER = 256 * 2**20  # bytes of one member, unpacked
MAX_TOTAL = 2 * 2**30  # bytes of all that is read, unpacked
MAX_XML = 32 * 2**20
MAX_RATIO = 250  # of unpacked to packed size; deflate's own limit is about 1030
_SMALL = 2**20  # bytes up to which any ratio is harmless


class HomeArchive:
    """Reads members of a `.sh3d`; raises `InputError` with the file's and the member's name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._read = 0
        self._folders: dict[str, list[str]] | None = None
        try:
            self._zip = zipfile.ZipFile(path)
            names = self._zip.infolist()
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
            raise InputError(f"{path}: not a Sweet Home 3D file, or damaged ({error})") from None
        if len(names) > MAX_MEMBERS:
            raise InputError(f"{path}: {len(names):,} files inside; at most {MAX_MEMBERS:,}")
        self._members = {info.filename: info for info in names if not info.is_dir()}
        for name in self._members:
            parts = PurePosixPath(name.replace("\\", "/")).parts
            if name.startswith(("/", "\\")) or ".." in parts or ":" in name or "\0" in name:
                raise InputError(f"{path}: a file inside has a path that leads out: {name!r}")

    def __enter__(self) -> HomeArchive:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def home_xml(self) -> bytes:
        """`Home.xml`; homes that only hold serialised Java objects are refused."""
        if "Home.xml" not in self._members:
            if "Home" in self._members:
                raise InputError(
                    f"{self.path}: saved by a version before 5.3, as serialised Java objects, "
                    "which are not read because reading them would run foreign code; open the "
                    "home with Sweet Home 3D 5.3 or later and save it again"
                )
            raise InputError(f"{self.path}: no Home.xml inside; not a Sweet Home 3D home")
        return self.read("Home.xml", MAX_XML)

    def read(self, name: str, limit: int = MAX_MEMBER) -> bytes:
        """The bytes of a member; at most `limit`."""
        info = self._members.get(name)
        where = f"{self.path}: {name}"
        if info is None:
            raise InputError(f"{where}: missing in the file")
        if info.file_size > limit:
            raise InputError(f"{where}: {info.file_size:,} bytes unpacked; at most {limit:,}")
        if info.file_size > max(_SMALL, MAX_RATIO * info.compress_size):
            raise InputError(f"{where}: packed more than {MAX_RATIO} to 1, as zip bombs are")
        self._read += info.file_size
        if self._read > MAX_TOTAL:
            raise InputError(f"{self.path}: more than {MAX_TOTAL:,} bytes in all")
        try:
            with self._zip.open(info) as stream:
                data = stream.read(info.file_size + 1)
        except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError,
                NotImplementedError) as error:  # fmt: skip
            raise InputError(f"{where}: damaged or encrypted ({error})") from None
        if len(data) != info.file_size:
            raise InputError(f"{where}: not of the size that the file says")
        return data

    def beside(self, name: str, wanted: str) -> str | None:
        """The member `wanted` in the folder of member `name`, or one with its base name there.

        Case and foreign paths do not matter; None where there is none.
        """
        folder = PurePosixPath(name).parent
        base = PurePosixPath(wanted.replace("\\", "/")).name.lower()
        exact = (folder / wanted.replace("\\", "/")).as_posix()
        if exact in self._members:
            return exact
        for member in sorted(self._members):
            path = PurePosixPath(member)
            inside = path.is_relative_to(folder) if folder.parts else len(path.parts) == 1
            if inside and path.name.lower() == base:
                return member
        return None

    def names(self) -> list[str]:
        """All members; sorted."""
        return sorted(self._members)

    def top(self) -> list[str]:
        """The members that lie in no folder; sorted."""
        return sorted(member for member in self._members if "/" not in member)

    def folder(self, name: str) -> list[str]:
        """The members in the folder of member `name`, if it lies in one; sorted."""
        parent = name.rpartition("/")[0]
        if not parent:
            return []
        if self._folders is None:
            self._folders = {}
            for member in sorted(self._members):
                self._folders.setdefault(member.rpartition("/")[0], []).append(member)
        return list(self._folders.get(parent, []))
