"""Files: atomic writing (complete or absent, by rename), reading of those from outside, digests."""

from __future__ import annotations

import csv
import errno
import fcntl
import hashlib
import io
import json
import math
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from pbrnet.scenes.errors import InputError, MachineError

_PARTIAL = ".partial-"
_FLUSHERS = 16
MAX_FILES = 200_000  # of a folder that is copied
MAX_BYTES = 2**30  # of one file that is read as a whole
MAX_JSON = 2**28  # bytes
_MAX_DIGITS = 40  # of a whole number in JSON


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; renamed to `path` on success, removed on failure.

    Raises `MachineError` when the disk is full, the folder cannot be written, or `path` is there
    and no regular file: a rename would remove a device, a pipe or a link to one.
    """
    path = Path(path)
    _check_replaceable(path, stat.S_ISREG)
    with machine_errors(path):
        partial, lock = _new_partial(path, folder=False)
    try:
        with machine_errors(path):
            yield partial
            _flush(partial)
            partial.chmod(0o644)
            _check_replaceable(path, stat.S_ISREG)
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
        os.close(lock)


@contextmanager
def atomic_directory(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it replaces `path` on success, else is removed.

    Raises `MachineError` as `atomic_file` does, and where `path` is there and no folder.
    """
    path = Path(path)
    _check_replaceable(path, stat.S_ISDIR)
    path = path.resolve() if path.is_symlink() else path  # the link stays, what it names is new
    with machine_errors(path):
        partial, lock = _new_partial(path, folder=True)
    try:
        with machine_errors(path):
            yield partial
            _flush_all(file for file in partial.rglob("*") if file.is_file())
            partial.chmod(0o755)
            while not _took_place(partial, path):
                retired = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=path.parent))
                with suppress(FileNotFoundError):  # another writer was faster
                    path.replace(retired / "old")
                shutil.rmtree(retired, ignore_errors=True)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)


def _took_place(partial: Path, path: Path) -> bool:
    """Rename a folder to `path`, unless there is one with files."""
    try:
        partial.replace(path)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        return False
    return True


def _check_replaceable(path: Path, is_kind: Callable[[int], bool]) -> None:
    """Raise `MachineError` if `path` is there and of another kind, itself or where a link leads."""
    try:
        kind = path.stat().st_mode
        # /dev/stdout may lead to a regular file, and is itself none.
        is_stream = path.is_symlink() and str(path.readlink()).startswith("/proc/")
    except (OSError, ValueError):  # nothing there: writing says what else is wrong
        return
    if is_stream or not is_kind(kind):
        raise MachineError(
            f"{path}: not replaced, because it is {_kind_name(kind)}; choose another place"
        )


def _kind_name(mode: int) -> str:
    kinds = {stat.S_IFREG: "a file", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe"}
    return kinds.get(stat.S_IFMT(mode), "a device or the like")


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a temporary folder, which is removed in the end; those of killed processes are, too."""
    place = Path(tempfile.gettempdir())
    sweep(place, recursive=False)
    folder, lock = _new_partial(place / "temporary", folder=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
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
            acquire(lock, fcntl.LOCK_EX)
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


def write_csv(path: Path, header: Iterable[str], lines: Iterable[Iterable[Any]]) -> None:
    """Write a table by rename, as UTF-8 with line feeds."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(lines)
    write_text(path, text.getvalue())


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
        lock = os.open(partial, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
    except OSError:  # gone meanwhile, or not ours
        return False
    try:
        free = acquire(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
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


def acquire(handle: int, how: int) -> bool:
    """Return whether `fcntl.flock` acquired the lock; always true on file systems without locks."""
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


def regular_file(path: Path, limit: int = MAX_BYTES) -> Path:
    """Return the path of a file from outside that may be opened and read as a whole.

    Raises `InputError` for what is missing or a folder, for pipes and devices, whose reading might
    never end, for links in a circle, and for more than `limit` bytes.
    """
    shown = str(path)[:300]
    try:
        facts = Path(path).stat()
    except FileNotFoundError:
        raise InputError(f"{shown}: no such file") from None
    except OSError as error:
        raise InputError(f"{shown}: {os.strerror(error.errno or 0)}") from None
    except ValueError as error:  # a NUL in the name
        raise InputError(f"{shown!r}: {error}") from None
    _check_regular(shown, facts, limit)
    return Path(path)


def _check_regular(shown: str, facts: os.stat_result, limit: int) -> None:
    if stat.S_ISDIR(facts.st_mode):
        raise InputError(f"{shown}: a folder; expected a file")
    if not stat.S_ISREG(facts.st_mode):
        raise InputError(f"{shown}: not a regular file, but a pipe, a device or the like")
    if facts.st_size > limit:
        raise InputError(f"{shown}: {facts.st_size:,} bytes; at most {limit:,} can be read")


def open_regular(path: Path, limit: int = MAX_BYTES) -> io.BufferedReader:
    """Open a file from outside for reading; raises `InputError` as `regular_file` does.

    A file that meanwhile became a pipe or a device is refused as well, and never waited for.
    """
    path = regular_file(path, limit)
    try:
        stream = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    except OSError as error:
        raise InputError(f"{path}: {os.strerror(error.errno or 0)}") from None
    try:
        _check_regular(str(path), os.fstat(stream.fileno()), limit)
    except InputError:
        stream.close()
        raise
    return stream


def read_bytes(path: Path, limit: int = MAX_BYTES) -> bytes:
    """Read a file from outside as a whole; raises `InputError` as `regular_file` does."""
    with open_regular(path, limit) as stream:
        return stream.read(limit)


def read_text(path: Path, limit: int = MAX_JSON) -> str:
    """Read UTF-8 text from outside, line ends as they are, without a byte order mark.

    Raises `InputError` for other bytes.
    """
    try:
        return read_bytes(path, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text ({error})") from None


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read the lines of a CSV file from outside, by the names of its first line.

    Raises `InputError` for other bytes than UTF-8, a line of more or fewer cells than the first,
    and a cell of more than 131,072 characters.
    """
    lines = csv.DictReader(io.StringIO(read_text(path), newline=""))
    try:
        found: list[dict[str, str]] = list(lines)
    except csv.Error as error:
        raise InputError(f"{path}: not valid CSV ({error})") from None
    for number, line in enumerate(found):
        if None in line or None in line.values():
            raise InputError(f"{path}: row {number + 1} has too many or too few cells")
    return found


def exists(path: Path) -> bool:
    """Return whether a file or folder is there; False for names that nothing can have."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False


def resolved(path: Path) -> Path:
    """Return the absolute path without links; `InputError` for links in a circle."""
    try:
        return Path(path).resolve()
    except (RuntimeError, OSError, ValueError):
        raise InputError(f"{str(path)[:300]}: links in a circle, or no possible name") from None


def read_json(path: Path) -> Any:
    """Read a JSON file; `InputError` names the file and line if it is missing or broken."""
    return parse_json(read_text(path), str(path))


def data_beside(module: str) -> Any:
    """The content of the data file of a module, a YAML file of its name beside it: its tables."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast, where it is built
    return yaml.load(Path(module).with_suffix(".yaml").read_text(encoding="utf-8"), loader)


def parse_json(text: str | bytes, where: str) -> Any:
    """Read JSON text from outside; `InputError` begins with `where`.

    Refused, beside wrong syntax: lists nested deeper than Python reads, whole numbers of more
    than `_MAX_DIGITS` digits, NaN, infinity and what exceeds double precision, and text that is no
    Unicode (lone surrogates).
    """
    try:
        content = json.loads(
            text, parse_int=_whole, parse_float=_finite, parse_constant=_no_constant
        )
        if b"\\ud" in (text.encode() if isinstance(text, str) else text).lower():
            json.dumps(content, ensure_ascii=False).encode()
    except RecursionError:
        raise InputError(f"{where}: not valid JSON (nested too deep)") from None
    except UnicodeEncodeError:
        raise InputError(f"{where}: not valid JSON (text that is not Unicode)") from None
    except ValueError as error:
        raise InputError(f"{where}: not valid JSON ({error})") from None
    return content


def _whole(digits: str) -> int:
    if len(digits) > _MAX_DIGITS:
        raise ValueError(f"a number of {len(digits):,} digits")
    return int(digits)


def _finite(digits: str) -> float:
    value = float(digits)
    if math.isinf(value):
        raise ValueError(f"{digits[:_MAX_DIGITS]} is beyond double precision")
    return value


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def digest_bytes(*parts: bytes) -> str:
    """SHA-256 of the parts, each preceded by its length, as 64 hex digits."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def digest_file(path: Path) -> str:
    """SHA-256 of a file, as 64 hex digits; raises `InputError` as `regular_file` does."""
    with open_regular(path, sys.maxsize) as stream:
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
        if error.errno in (errno.EEXIST, errno.ENOTDIR, errno.ELOOP, errno.ENAMETOOLONG):
            raise MachineError(
                f"{str(path)[:300]}: cannot be written ({os.strerror(error.errno)}): a file or a "
                "link is where a folder has to be, or the name is too long; choose another place"
            ) from error
        raise
