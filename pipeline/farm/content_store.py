"""Content-addressed store of files on a worker's disk, of bounded size.

A file is named by the SHA-256 of its bytes. It travels in chunks of at most `CHUNK_BYTES`, so that
memory is bounded whatever the file's size, and enters the store by rename once its digest has been
checked. Folders are assembled from hard links: a file that is evicted meanwhile, or that several
scenes share, is on the disk once and stays readable.

Several processes may use one store: they hold a lock for each folder that they fetch.
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

from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import digest_file, machine_errors

CHUNK_BYTES = 4 << 20  # bytes of files in one bundle
_ORPHANED = 60.0  # seconds after which a folder without an owner may be removed


@dataclass(frozen=True)
class StoredFile:
    """A file of a folder: its relative POSIX path, SHA-256 and size in bytes."""

    path: str
    digest: str
    size: int


@dataclass(frozen=True)
class Chunk:
    """Consecutive bytes of the file at `index` of a list; `last` marks the file's end."""

    index: int
    content: bytes
    last: bool


Fetch = Callable[[Sequence[int]], Iterable[Sequence[Chunk]]]  # indices of a list -> bundles


def list_files(folder: Path) -> list[StoredFile]:
    """Return all files below a folder, sorted by path."""
    files = sorted(file for file in Path(folder).rglob("*") if file.is_file())
    return [
        StoredFile(file.relative_to(folder).as_posix(), digest_file(file), file.stat().st_size)
        for file in files
    ]


def read_chunks(
    folder: Path, files: Sequence[StoredFile], wanted: Iterable[int]
) -> Iterator[list[Chunk]]:
    """Yield the wanted files in order, as bundles of at most `CHUNK_BYTES` bytes."""
    bundle: list[Chunk] = []
    room = CHUNK_BYTES
    for index in wanted:
        with (Path(folder) / files[index].path).open("rb") as stream:
            content = stream.read(room)
            while True:
                following = stream.read(CHUNK_BYTES) if len(content) == room else b""
                bundle.append(Chunk(index, content, not following))
                room -= len(content)
                if room <= 0:
                    yield bundle
                    bundle, room = [], CHUNK_BYTES
                if not following:
                    break
                content = following
    if bundle:
        yield bundle


class ContentStore:
    """Files below `root`, at most `limit` bytes of them once `trim` has been called."""

    def __init__(self, root: Path, limit: int) -> None:
        self.root, self.limit = Path(root), limit
        with machine_errors(self.root):
            self.root.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self.root.stat().st_uid != os.geteuid():
            raise MachineError(
                f"{self.root}: belongs to another user; set PBRNET_CACHE to another folder"
            )

    def assemble(
        self, name: str, files: Sequence[StoredFile], fetch: Fetch, verify: Callable[[Path], bool]
    ) -> Path:
        """Return a private folder with these files; `fetch` provides those that are missing.

        `verify` reads the finished folder and returns whether its content is right; if not,
        damaged files are removed and fetched again. `name` names the lock. The caller removes the
        folder. Raises `InputError` if the content is wrong even with fresh files.
        """
        for _ in range(3):
            with self._locked(name):
                self._fetch_missing(files, fetch)
                folder = self.private_folder()
                try:
                    if self._link(files, folder) and verify(folder):
                        return folder
                except BaseException:
                    shutil.rmtree(folder, ignore_errors=True)
                    raise
                shutil.rmtree(folder, ignore_errors=True)
                self._drop_damaged(files)
        raise InputError(
            f"{name}: its files arrive with other content than listed; do not change a scene "
            "while a stage runs"
        )

    def private_folder(self) -> Path:
        """Create a folder of this process on the store's file system.

        A later `trim` removes it once the process has ended.
        """
        return Path(tempfile.mkdtemp(dir=_process_folder(self.root)))

    def trim(self) -> None:
        """Evict the least recently used files until the rest is within the limit.

        Also removes the private folders of killed processes.
        """
        found = []
        for path in self.root.glob("files/*/*"):
            with contextlib.suppress(FileNotFoundError):
                stat = path.stat()
                found.append((stat.st_mtime, stat.st_size, path))
        total = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if total <= self.limit:
                break
            path.unlink(missing_ok=True)
            total -= size
        _remove_orphans(self.root / "processes")

    def path(self, file: StoredFile) -> Path:
        """Return the path of a file in the store, whether or not it is there."""
        return self.root / "files" / file.digest[:2] / file.digest

    def _has(self, file: StoredFile) -> bool:
        try:
            return self.path(file).stat().st_size == file.size
        except FileNotFoundError:
            return False

    def _fetch_missing(self, files: Sequence[StoredFile], fetch: Fetch) -> None:
        """Fetch the files that the store lacks, each content once."""
        first = {file.digest: index for index, file in reversed(list(enumerate(files)))}
        missing = sorted(index for index in first.values() if not self._has(files[index]))
        if not missing:
            return
        with _StoreWriter(self, files) as writer:
            for bundle in fetch(missing):
                for chunk in bundle:
                    writer.write(chunk)

    def _link(self, files: Sequence[StoredFile], folder: Path) -> bool:
        """Link all files into `folder`; False if one was evicted meanwhile."""
        for file in files:
            inside = PurePosixPath(file.path)
            if inside.is_absolute() or ".." in inside.parts:
                raise InputError(f"{file.path!r}: the path leads outside of its folder")
            source, target = self.path(file), folder / inside
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

    def _drop_damaged(self, files: Iterable[StoredFile]) -> None:
        for file in files:
            path = self.path(file)
            with contextlib.suppress(InputError):
                if digest_file(path) != file.digest:
                    path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _locked(self, name: str) -> Iterator[None]:
        """Hold the lock of a folder; the system releases it when the process ends."""
        bucket = hashlib.sha256(name.encode()).hexdigest()[:2]  # bounds the number of lock files
        path = self.root / "locks" / bucket
        with machine_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            stream = path.open("a")
        with stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            yield


class _StoreWriter:
    """Writes the chunks of one file after the other into the store."""

    def __init__(self, store: ContentStore, files: Sequence[StoredFile]) -> None:
        self.store, self.files = store, files
        self.folder = store.private_folder()
        self.index = -1
        self.stream: IO[bytes] | None = None
        self.digest = hashlib.sha256()

    def __enter__(self) -> _StoreWriter:
        return self

    def __exit__(self, *error: object) -> None:
        if self.stream:
            self.stream.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def write(self, chunk: Chunk) -> None:
        """Add a chunk; a finished file with a wrong digest is discarded."""
        partial = self.folder / "partial"
        with machine_errors(self.store.root):
            if self.stream is None or chunk.index != self.index:
                if self.stream:
                    self.stream.close()
                self.index, self.digest = chunk.index, hashlib.sha256()
                self.stream = partial.open("wb")
            self.stream.write(chunk.content)
            self.digest.update(chunk.content)
            if not chunk.last:
                return
            self.stream.close()
            self.stream = None
            file = self.files[chunk.index]
            if self.digest.hexdigest() == file.digest:
                path = self.store.path(file)
                path.parent.mkdir(parents=True, exist_ok=True)
                partial.replace(path)


_process_folders: dict[tuple[Path, int], tuple[Path, IO[str]]] = {}


def _process_folder(root: Path) -> Path:
    """Return this process's folder in a store; its lock is released when the process ends."""
    key = (root, os.getpid())
    if key not in _process_folders or not _process_folders[key][0].is_dir():
        with machine_errors(root):
            (root / "processes").mkdir(exist_ok=True)
            folder = Path(tempfile.mkdtemp(dir=root / "processes"))
            stream = (folder / "lock").open("w")
        fcntl.flock(stream, fcntl.LOCK_EX)
        _process_folders[key] = (folder, stream)
    return _process_folders[key][0]


def _remove_orphans(folders: Path) -> None:
    """Remove the folders of ended processes, by their released locks."""
    for folder in folders.glob("*"):
        try:
            if time.time() - folder.stat().st_mtime < _ORPHANED:
                continue
            with (folder / "lock").open("a") as stream:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
        except BlockingIOError:
            continue
        except FileNotFoundError:
            shutil.rmtree(folder, ignore_errors=True)
