"""Reader of zip archives (Sweet Home 3D, USDZ): checked names, limits of size and compression."""

from __future__ import annotations

import io
import lzma
import posixpath
import struct
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import regular_file

MAX_MEMBERS = 20_000
MAX_MEMBER = 256 * 2**20  # bytes of one member, unpacked
MAX_TOTAL = 2 * 2**30  # bytes of all that is read, unpacked
MAX_XML = 32 * 2**20
MAX_RATIO = 250  # of unpacked to packed size; deflate reaches about 1030
_SMALL = 2**20  # bytes: any ratio is allowed up to this size


class HomeArchive:
    """Reads members of a `.sh3d`, `.sh3f` or `.usdz`; `InputError` names the file and the member.

    `kind` is the name of the kind of file, for errors.
    """

    def __init__(self, path: Path, kind: str = "Sweet Home 3D file") -> None:
        self.path = path
        self._read = 0
        self._folders: dict[str, list[str]] | None = None
        self._members: dict[str, tuple[zipfile.ZipFile, zipfile.ZipInfo]] = {}
        try:
            self._zip = zipfile.ZipFile(regular_file(path))
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
            raise InputError(f"{path}: not a {kind}, or damaged ({error})") from None
        self._add(self._zip, "")

    def _add(self, file: zipfile.ZipFile, prefix: str) -> list[str]:
        """Register the members of `file` under `prefix` + name; returns these names."""
        infos = file.infolist()
        if len(infos) + len(self._members) > MAX_MEMBERS:
            raise InputError(f"{self.path}: {len(infos):,} files inside; at most {MAX_MEMBERS:,}")
        if not all(info.filename for info in infos):  # zipfile itself fails at one
            raise InputError(f"{self.path}: a file inside has no name")
        added = {info.filename: info for info in infos if not info.is_dir()}
        for name in added:
            parts = PurePosixPath(name.replace("\\", "/")).parts
            if name.startswith(("/", "\\")) or ".." in parts or ":" in name or "\0" in name:
                raise InputError(f"{self.path}: a file inside has a path that leads out: {name!r}")
        self._members |= {prefix + name: (file, info) for name, info in added.items()}
        return sorted(prefix + name for name in added)

    def __enter__(self) -> HomeArchive:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def open_inside(self, name: str) -> list[str]:
        """Open a member that is a zip; returns its files, now members `name!/file`."""
        prefix = f"{name}!/"
        known = sorted(member for member in self._members if member.startswith(prefix))
        if known:
            return known
        try:
            inner = zipfile.ZipFile(io.BytesIO(self.read(name)))
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
            raise InputError(f"{self.path}: {name}: a damaged zip ({error})") from None
        return self._add(inner, prefix)

    def read(self, name: str, limit: int = MAX_MEMBER) -> bytes:
        """Return the bytes of a member, at most `limit`."""
        where = f"{self.path}: {name}"
        if name not in self._members:
            raise InputError(f"{where}: missing in the file")
        file, info = self._members[name]
        if info.file_size > limit:
            raise InputError(f"{where}: {info.file_size:,} bytes unpacked; at most {limit:,}")
        if info.file_size > max(_SMALL, MAX_RATIO * info.compress_size):
            raise InputError(f"{where}: packed more than {MAX_RATIO} to 1, as zip bombs are")
        self._read += info.file_size
        if self._read > MAX_TOTAL:
            raise InputError(f"{self.path}: more than {MAX_TOTAL:,} bytes in all")
        try:
            with file.open(info) as stream:
                data = stream.read(info.file_size + 1)
        except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, OSError, EOFError, ValueError,
                RuntimeError, NotImplementedError, struct.error) as error:  # fmt: skip
            raise InputError(f"{where}: damaged or encrypted ({error})") from None
        if len(data) != info.file_size:
            raise InputError(f"{where}: not of the size that the file says")
        return data

    def beside(self, name: str, wanted: str) -> str | None:
        """Return the member `wanted` relative to member `name`, or one with its base name; or None.

        Base names are looked up in the folder of `name`, then in everything saved with it; case
        and directories are ignored.
        """
        folder = posixpath.dirname(name)
        wanted = wanted.replace("\\", "/")
        base = posixpath.basename(wanted).lower()
        exact = posixpath.normpath(posixpath.join(folder, wanted))
        zipped, inside, _ = name.partition("!/")
        whole = f"{zipped}!" if inside else name.partition("/")[0] if folder else ""
        if exact in self._members and exact.startswith(f"{whole}/" if whole else ""):
            return exact
        for root in dict.fromkeys((folder, whole)):
            for member in sorted(self._members):
                near = member.startswith(f"{root}/") if root else "/" not in member
                if near and posixpath.basename(member).lower() == base:
                    return member
        return None

    def stored(self) -> list[str]:
        """Return all members in the order in which the file holds them."""
        places = {name: info.header_offset for name, (_, info) in self._members.items()}
        return sorted(places, key=lambda name: places[name])

    def names(self) -> list[str]:
        """Return all members, sorted."""
        return sorted(self._members)

    def top(self) -> list[str]:
        """Return the members outside any folder, sorted."""
        return sorted(member for member in self._members if "/" not in member)

    def folder(self, name: str) -> list[str]:
        """Return the members in the folder of member `name`, sorted; none if it is in no folder."""
        parent = name.rpartition("/")[0]
        if not parent:
            return []
        if self._folders is None:
            self._folders = {}
            for member in sorted(self._members):
                self._folders.setdefault(member.rpartition("/")[0], []).append(member)
        return list(self._folders.get(parent, []))
