"""Upkeep of a data folder: its lock, the list of a stage's failures, and its trash.

`DATA/trash` keeps what no view asks for any more, and what was replaced, for a while. A file or
folder lies there under its path in the data folder, one version of each. It is put back when it is
wanted again, and removed `farm.trash_days` after it was put there.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from pbrnet.pipeline.terminal import counted
from pbrnet.scenes.errors import MachineError, PbrnetError
from pbrnet.scenes.files import machine_errors, write_json

_DAY = 86_400.0
_LOCKED: set[Path] = set()  # data folders that a command of this process holds for all its stages
_FLAT = ("scenes", "cameras")  # their entries lie one folder deep, others two


@dataclass(frozen=True)
class Failure:
    """A scene or view that failed in a stage; `view_id` is empty for a whole scene."""

    stage: str
    scene_id: str
    view_id: str
    error: str

    def __str__(self) -> str:
        place = "/".join(part for part in (self.scene_id, self.view_id) if part)
        return f"{self.stage} {place}: {self.error}"


def save_failures(data: Path, stage: str, failures: list[Failure]) -> None:
    """Write `data/failures/<stage>.json`, or remove it if there are no failures."""
    path = data / "failures" / f"{stage}.json"
    if failures:
        write_json(path, [asdict(failure) for failure in failures])
    else:
        path.unlink(missing_ok=True)


@contextmanager
def run_lock(data: Path, command: str) -> Iterator[None]:
    """Lock the data folder for all stages of a command, between which no other run may begin."""
    with data_lock(data, command):
        _LOCKED.add(data.resolve())
        try:
            yield
        finally:
            _LOCKED.discard(data.resolve())


@contextmanager
def data_lock(
    data: Path, stage: str, name: str = ".lock", option: str = "--data"
) -> Iterator[None]:
    """Lock a folder, by the file `name` in it, for one stage; nothing to do inside `run_lock`.

    Raises `PbrnetError` if another run holds the lock and `MachineError` if the folder cannot be
    written. The kernel releases the lock when the process ends, however it ends. `option` is that
    of the command which names the folder.
    """
    if data.resolve() in _LOCKED:
        yield
        return
    path = data / name
    with machine_errors(path):
        data.mkdir(parents=True, exist_ok=True)
        # A link would be written to where it leads, and a pipe waited for.
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
        handle = os.open(path, flags | os.O_CLOEXEC, 0o644)
    with os.fdopen(handle, "r+b", buffering=0) as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise MachineError(f"{path}: not a regular file; remove it and run again")
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.seek(0)
            holder = stream.read(200).decode("utf-8", "replace").strip() or "another run"
            raise PbrnetError(
                f"{data}: in use by {holder}; wait for it to end, or use another folder with "
                f"{option}"
            ) from None
        with machine_errors(path):
            stream.seek(0)
            stream.truncate()
            holder = f"'pbrnet {stage}' (process {os.getpid()} on {os.uname().nodename})"
            stream.write(holder.encode())
        yield


class Trash:
    """The trash of the folder `data`; entries stay for `days`, 0: they are removed at once."""

    def __init__(self, data: Path, days: float) -> None:
        self.data, self.days = data, days
        self.folder = data / "trash"

    def place(self, path: Path) -> Path:
        """Return where `path`, a file or folder of the data folder, lies in the trash."""
        return self.folder / path.relative_to(self.data)

    def add(self, paths: Iterable[Path]) -> None:
        """Move files or folders into the trash; they replace what lies there under their names."""
        for path in paths:
            place = self.place(path)
            _remove(place)
            if self.days:
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.move(path, place)  # perhaps to another disk
                os.utime(place)
            else:
                _remove(path)

    def put_back(self, paths: Iterable[Path]) -> None:
        """Move files or folders from the trash to `paths`; those that lie there change places."""
        for path in paths:
            back = self.place(path).with_name(f".{path.name}.back")
            _remove(back)  # of a run that was killed here
            shutil.move(self.place(path), back)
            if path.exists():
                self.add([path])
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(back, path)

    def sweep(self) -> None:
        """Remove the entries whose time is over, and empty folders."""
        oldest = time.time() - self.days * _DAY
        for entry in self._entries():
            if entry.stat().st_mtime <= oldest:
                _remove(entry)
        for folder, _, _ in os.walk(self.folder, topdown=False):
            with suppress(OSError):  # not empty
                Path(folder).rmdir()

    def described(self) -> str:
        """Return number and size of the entries, and how long they stay; "" if there are none."""
        entries = list(self._entries())
        if not entries:
            return ""
        size = size_text(entries)
        return (
            f"trash: {counted(len(entries), 'item')}, {size}, in {self.folder}, each kept for "
            f"{self.days:g} days (farm.trash_days); --remove-orphans empties it"
        )

    def _entries(self) -> Iterator[Path]:
        for folder in sorted(self.folder.glob("*/")):
            yield from sorted(folder.glob("*" if folder.name in _FLAT else "*/*"))


def size_text(paths: Iterable[Path]) -> str:
    """Return the size of files and folders, like `3.4 MB`."""
    size = sum(_size(path) for path in paths) / 1e6
    return f"{size / 1000:,.1f} GB" if size >= 1000 else f"{size:.1f} MB"


def _size(path: Path) -> int:
    if path.is_dir() and not path.is_symlink():
        return sum(file.lstat().st_size for file in path.rglob("*") if not file.is_dir())
    return path.lstat().st_size if path.exists() else 0


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
