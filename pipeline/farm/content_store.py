"""Files by content: a folder as a list of pieces, and a bounded store of pieces on a worker's disk.

A piece is a file, named by the SHA-256 of its bytes. It travels in parts of at most `PART` bytes,
so that memory is bounded whatever a file's size, and enters the store by rename once its bytes
have the digest that was asked for. Folders are put together from hard links: a piece that is
evicted meanwhile, or that several scenes have in common, is on the disk once and stays readable.

Several processes may use one store: they take a lock for each folder that they fetch.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from scenes.errors import InputError, MachineError
from scenes.files import digest_file, machine_errors

PART = 4 << 20  # bytes of files that travel at a time
_FORSAKEN = 60.0  # seconds after which a folder without owner may go


@dataclass(frozen=True)
class Piece:
    """A file of a folder: its path there (POSIX, relative), SHA-256 and bytes."""

    path: str
    digest: str
    size: int


@dataclass(frozen=True)
class Part:
    """Some bytes of the piece at place `index` of a list; `last` ends that piece."""

    index: int
    content: bytes
    last: bool


Fetch = Callable[[Sequence[int]], Iterable[Sequence[Part]]]  # indices of a list -> their bytes


def list_pieces(folder: Path) -> list[Piece]:
    """All files below a folder, by path."""
    files = sorted(file for file in Path(folder).rglob("*") if file.is_file())
    return [
        Piece(file.relative_to(folder).as_posix(), digest_file(file), file.stat().st_size)
        for file in files
    ]


def read_parts(
    folder: Path, pieces: Sequence[Piece], wanted: Iterable[int]
) -> Iterator[list[Part]]:
    """The wanted pieces in order, bundles of at most `PART` bytes in all."""
    bundle: list[Part] = []
    room = PART
    for index in wanted:
        with (Path(folder) / pieces[index].path).open("rb") as stream:
            content = stream.read(room)
            while True:
                following = stream.read(PART) if len(content) == room else b""
                bundle.append(Part(index, content, not following))
                room -= len(content)
                if room <= 0:
                    yield bundle
                    bundle, room = [], PART
                if not following:
                    break
                content = following
    if bundle:
        yield bundle


class Store:
    """Pieces below `root`, at most `limit` bytes of them once `trim` has been called."""

    def __init__(self, root: Path, limit: int) -> None:
        self.root, self.limit = Path(root), limit
        with machine_errors(self.root):
            self.root.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self.root.stat().st_uid != os.geteuid():
            raise MachineError(
                f"{self.root}: belongs to somebody else; name another folder in PBRNET_CACHE"
            )

    def folder_of(
        self, name: str, pieces: Sequence[Piece], fetch: Fetch, sure: Callable[[Path], bool]
    ) -> Path:
        """A private folder with these files, from the store or else by `fetch`.

        `sure` reads the finished folder and says whether all is as it should be; if not, damaged
        pieces are thrown away and fetched again. `name` names the lock. Whoever gets the folder
        removes it. Raises `InputError` if even fresh pieces do not make it right.
        """
        for _ in range(3):
            with self._locked(name):
                self._complete(pieces, fetch)
                folder = self.private()
                try:
                    if self._assemble(pieces, folder) and sure(folder):
                        return folder
                except BaseException:
                    shutil.rmtree(folder, ignore_errors=True)
                    raise
                shutil.rmtree(folder, ignore_errors=True)
                self._drop_damaged(pieces)
        raise InputError(f"{name}: its files do not arrive as they should be; are they changing?")

    def private(self) -> Path:
        """A new folder on the store's file system, for this process; gone some time after it."""
        return Path(tempfile.mkdtemp(dir=_own_room(self.root)))

    def trim(self) -> None:
        """Evict the pieces that were not used for longest, until the rest is within the limit.

        Also removes what processes left that were killed.
        """
        found = []
        for path in self.root.glob("pieces/*/*"):
            with contextlib.suppress(FileNotFoundError):
                stat = path.stat()
                found.append((stat.st_mtime, stat.st_size, path))
        total = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if total <= self.limit:
                break
            path.unlink(missing_ok=True)
            total -= size
        _remove_forsaken(self.root / "rooms")

    def _path(self, piece: Piece) -> Path:
        return self.root / "pieces" / piece.digest[:2] / piece.digest

    def _has(self, piece: Piece) -> bool:
        try:
            return self._path(piece).stat().st_size == piece.size
        except FileNotFoundError:
            return False

    def _complete(self, pieces: Sequence[Piece], fetch: Fetch) -> None:
        """Fetch what is not there, each content once."""
        first = {piece.digest: index for index, piece in reversed(list(enumerate(pieces)))}
        missing = sorted(index for index in first.values() if not self._has(pieces[index]))
        if not missing:
            return
        with _Incoming(self, pieces) as incoming:
            for bundle in fetch(missing):
                for part in bundle:
                    incoming.take(part)

    def _assemble(self, pieces: Sequence[Piece], folder: Path) -> bool:
        """Link all pieces into `folder`; False if one was evicted meanwhile."""
        for piece in pieces:
            inside = PurePosixPath(piece.path)
            if inside.is_absolute() or ".." in inside.parts:
                raise InputError(f"{piece.path!r} would lie outside of its folder")
            source, target = self._path(piece), folder / inside
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.utime(source)
                try:
                    target.hardlink_to(source)
                except PermissionError:  # a file system without hard links
                    shutil.copyfile(source, target)
            except FileNotFoundError:
                return False
        return True

    def _drop_damaged(self, pieces: Iterable[Piece]) -> None:
        for piece in pieces:
            path = self._path(piece)
            with contextlib.suppress(FileNotFoundError):
                if digest_file(path) != piece.digest:
                    path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _locked(self, name: str) -> Iterator[None]:
        """Wait until no other process of this machine fetches the same; ends with the process."""
        bucket = hashlib.sha256(name.encode()).hexdigest()[:2]  # so that locks are not too many
        path = self.root / "locks" / bucket
        with machine_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            stream = path.open("a")
        with stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            yield


class _Incoming:
    """Writes the parts of one piece after the other into the store."""

    def __init__(self, store: Store, pieces: Sequence[Piece]) -> None:
        self.store, self.pieces = store, pieces
        self.folder = store.private()
        self.index = -1
        self.stream: IO[bytes] | None = None
        self.digest = hashlib.sha256()

    def __enter__(self) -> _Incoming:
        return self

    def __exit__(self, *error: object) -> None:
        if self.stream:
            self.stream.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def take(self, part: Part) -> None:
        """Add a part; a piece whose bytes turn out wrong is left out."""
        partial = self.folder / "partial"
        with machine_errors(self.store.root):
            if self.stream is None or part.index != self.index:
                if self.stream:
                    self.stream.close()
                self.index, self.digest = part.index, hashlib.sha256()
                self.stream = partial.open("wb")
            self.stream.write(part.content)
            self.digest.update(part.content)
            if not part.last:
                return
            self.stream.close()
            self.stream = None
            piece = self.pieces[part.index]
            if self.digest.hexdigest() == piece.digest:
                path = self.store._path(piece)
                path.parent.mkdir(parents=True, exist_ok=True)
                partial.replace(path)


_rooms: dict[tuple[Path, int], tuple[Path, IO[str]]] = {}


def _own_room(root: Path) -> Path:
    """This process's folder in a store: the lock on it ends with the process."""
    key = (root, os.getpid())
    if key not in _rooms or not _rooms[key][0].is_dir():
        with machine_errors(root):
            (root / "rooms").mkdir(exist_ok=True)
            room = Path(tempfile.mkdtemp(dir=root / "rooms"))
            stream = (room / "lock").open("w")
        fcntl.flock(stream, fcntl.LOCK_EX)
        _rooms[key] = (room, stream)
    return _rooms[key][0]


def _remove_forsaken(rooms: Path) -> None:
    for room in rooms.glob("*"):
        try:
            if time.time() - room.stat().st_mtime < _FORSAKEN:
                continue
            with (room / "lock").open("a") as stream:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(room, ignore_errors=True)
        except BlockingIOError:
            continue
        except FileNotFoundError:
            shutil.rmtree(room, ignore_errors=True)
