"""When a worker process is replaced by a fresh one, so that its memory never grows for long.

A renderer's memory rises to what its largest scene took, and what it leaks, if anything, stays. A
process is done after so many scenes, or when it holds much more than after its first few: it
hands its next batch back and its nanny starts another. Workers without nanny are left alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import psutil
from dask.utils import format_bytes
from distributed import Reschedule, get_worker
from distributed.core import Status

_SETTLED = 3  # scenes after which a process has everything loaded that all scenes need
_GROWN = 1.5  # times the memory of then
_LEAST = 256 << 20  # bytes more than then: less is not worth a new process
_PATIENCE = 10.0  # seconds


class Wear:
    """What a worker process has behind it."""

    def __init__(self) -> None:
        self.scenes = 0
        self.settled = 0  # bytes
        self._last = ""

    def begins(self, group: str, held: int) -> None:
        """Note that work on a scene begins, with so many bytes held by the process."""
        if group == self._last:
            return
        self._last = group
        if self.scenes == _SETTLED:
            self.settled = held
        self.scenes += 1

    def reason(self, group: str, held: int, limit: int) -> str:
        """Why the process should be replaced before it opens this scene; empty: it should not.

        `held` bytes are the process's memory now, `limit` is the most scenes (0: any number).
        """
        if not limit or group == self._last:
            return ""
        if self.scenes >= limit:
            return f"{self.scenes} scenes"
        if self.settled and held > max(_GROWN * self.settled, self.settled + _LEAST):
            return f"{format_bytes(held)} of memory, {format_bytes(self.settled)} at first"
        return ""


_wear = Wear()


def replace_if_worn(group: str, limit: int) -> None:
    """Runs on a worker before a batch of the scene `group`, while nothing else runs on it.

    Raises dask's `Reschedule` if this process is on its way out: another does the batch.
    """
    worker = get_worker()
    if worker.status != Status.running:
        raise Reschedule
    held = psutil.Process().memory_info().rss
    reason = _wear.reason(group, held, limit)
    if not reason or not worker.nanny:
        _wear.begins(group, held)
        return
    # What it holds for the command would have to be made again, were nobody there to take it.
    _wait_while(lambda: bool(worker.data))
    worker.loop.add_callback(worker.close_gracefully, restart=True, reason=f"pbrnet: {reason}")
    _wait_while(lambda: worker.status == Status.running)
    raise Reschedule


def _wait_while(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE
    while condition() and time.monotonic() < deadline:
        time.sleep(0.02)
