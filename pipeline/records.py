"""List of a stage's failures, and the lock on a data folder."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from pbrnet.scenes.errors import MachineError, PbrnetError
from pbrnet.scenes.files import machine_errors, write_json


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
def data_lock(data: Path, stage: str) -> Iterator[None]:
    """Lock the data folder for one run.

    Raises `PbrnetError` if another run holds the lock and `MachineError` if the folder cannot be
    written. The kernel releases the lock when the process ends, however it ends.
    """
    path = data / ".lock"
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
                f"{data}: in use by {holder}; wait for it to end, or use another folder with --data"
            ) from None
        with machine_errors(path):
            stream.seek(0)
            stream.truncate()
            holder = f"'pbrnet {stage}' (process {os.getpid()} on {os.uname().nodename})"
            stream.write(holder.encode())
        yield
