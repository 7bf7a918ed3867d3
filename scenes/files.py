"""Atomic writing of files and folders (complete or absent, by rename), JSON and digests."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from scenes.errors import InputError, MachineError

_PARTIAL = ".partial-"
_FLUSHERS = 16
MAX_FILES = 200_000  # of a folder that is copied


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; renamed to `path` on success, removed on failure.

    Raises `MachineError` when the disk is full or the folder cannot be written.
    """
    path = Path(path)
    with machine_errors(path):
        partial, lock = _new_partial(path, folder=False)
    try:
        with machine_errors(path):
            yield partial
            _flush(partial)
            partial.chmod(0o644)
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
        os.close(lock)


@contextmanager
def atomic_directory(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it replaces `path` on success, else is removed."""
    path = Path(path)
    with machine_errors(path):
        partial, lock = _new_partial(path, folder=True)
    try:
        with machine_errors(path):
            yield partial
            _flush_all(file for file in partial.rglob("*") if file.is_file())
            partial.chmod(0o755)
            if path.exists():
                retired = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=path.parent))
                path.replace(retired / "old")
                partial.replace(path)
                shutil.rmtree(retired, ignore_errors=True)
            else:
                partial.replace(path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)


def _new_partial(path: Path, folder: bool) -> tuple[Path, int]:
    """A new file or folder beside `path`, and a handle that holds its lock until it is closed.

    The lock is the kernel's: it tells `sweep` whether the writer is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        if folder:
            name = tempfile.mkdtemp(prefix=_PARTIAL, dir=path.parent)
        else:
            made, name = tempfile.mkstemp(prefix=_PARTIAL, suffix=path.suffix, dir=path.parent)
            os.close(made)
        with suppress(FileNotFoundError):  # swept before it was locked: once more
            lock = os.open(name, os.O_RDONLY)
            _lock(lock, fcntl.LOCK_EX)
            if Path(name).exists():
                return Path(name), lock
            os.close(lock)


def remove_partials(folder: Path) -> int:
    """Delete partial files and folders directly in `folder`; returns their number.

    For folders that nobody else writes in, as their lock is held. Else see `sweep`.
    """
    leftovers = sorted(Path(folder).glob(_PARTIAL + "*")) if Path(folder).is_dir() else []
    for leftover in leftovers:
        _remove(leftover)
    return len(leftovers)


def sweep(folder: Path, recursive: bool = True) -> int:
    """Delete partial files of killed writers in `folder` and below; returns their number.

    Partial files of running writers are kept. If `recursive` is false, only those directly in
    `folder` are looked for.
    """
    removed = 0
    for place, folders, files in os.walk(folder):
        partials = sorted(name for name in (*folders, *files) if name.startswith(_PARTIAL))
        removed += sum(_abandoned(Path(place) / name) for name in partials)
        folders[:] = [name for name in folders if recursive and name not in partials]
    return removed


def _abandoned(partial: Path) -> bool:
    """Delete a partial file unless its writer is running; returns whether it was deleted."""
    try:
        lock = os.open(partial, os.O_RDONLY)
    except OSError:  # gone meanwhile, or not ours
        return False
    try:
        free = _lock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        if free:
            _remove(partial)
        return free
    finally:
        os.close(lock)


def _remove(partial: Path) -> None:
    if partial.is_dir():
        shutil.rmtree(partial, ignore_errors=True)
    else:
        partial.unlink(missing_ok=True)


def _lock(handle: int, how: int) -> bool:
    """Return whether the lock was acquired; always true on file systems without locks."""
    try:
        fcntl.flock(handle, how)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def copy_files(source: Path, target: Path) -> None:
    """Copy the plain files below `source` into the folder `target`; links are left out.

    Raises `InputError` for a folder of more than `MAX_FILES` files.
    """
    for count, file in enumerate(sorted(Path(source).rglob("*"))):
        if count > MAX_FILES:
            raise InputError(f"{source}: more than {MAX_FILES:,} files")
        if file.is_symlink() or not file.is_file():
            continue
        copy = Path(target) / file.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text by rename."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write indented JSON with sorted keys by rename; NaN and infinity are refused."""
    write_text(path, json.dumps(value, indent=1, sort_keys=True, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read a JSON file; `InputError` names the file and line if it is missing or broken."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: not valid JSON ({error})") from None


def digest_bytes(*parts: bytes) -> str:
    """SHA-256 of the parts, each preceded by its length, as 64 hex digits."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def digest_file(path: Path) -> str:
    """SHA-256 of a file's bytes, as 64 hex digits."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def digest_folder(folder: Path) -> str:
    """SHA-256 over names and contents of all files below `folder`, sorted by path."""
    files = sorted(file for file in Path(folder).rglob("*") if file.is_file())
    parts = []
    for file in files:
        parts += [file.relative_to(folder).as_posix().encode(), digest_file(file).encode()]
    return digest_bytes(*parts)


def _flush_all(paths: Iterable[Path]) -> None:
    # Side by side: a file system writes many waiting files with one commit of its journal.
    with ThreadPoolExecutor(_FLUSHERS, "flush") as pool:
        for _ in pool.map(_flush, paths):
            pass


def _flush(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


@contextmanager
def machine_errors(path: Path) -> Iterator[None]:
    """Convert errors of the disk (full, read-only, no permission) to `MachineError`."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise MachineError(
                f"{path}: the disk is full; free some space and run the same command again"
            ) from error
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            raise MachineError(
                f"{path}: cannot be written ({os.strerror(error.errno)}); "
                "check the folder's permissions and run the same command again"
            ) from error
        raise
