"""Replacement of worker processes, so that their memory does not grow without bound.

A renderer's memory rises to the need of its largest scene, and leaked memory stays. A process is
replaced after a number of scenes, or when it holds much more than after its first few: it returns
its next batch to the scheduler and its nanny starts another. Workers without a nanny are kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import psutil
from dask.utils import format_bytes
from distributed import Reschedule, get_worker
from distributed.core import Status

_SETTLED = 3  # scenes after which a process has loaded everything that all scenes need
_GROWTH = 1.5  # factor over the settled memory
_MIN_GROWTH = 256 << 20  # bytes over the settled memory: less is not worth a new process
_PATIENCE = 10.0  # seconds


class WorkerHistory:
    """Scenes that a worker process has opened, and its memory once it had settled."""

    def __init__(self) -> None:
        self.scenes = 0
        self.settled = 0  # bytes
        self._last = ""

    def begin(self, group: str, held: int) -> None:
        """Record the start of work on a scene, with `held` bytes in use by the process."""
        if group == self._last:
            return
        self._last = group
        if self.scenes == _SETTLED:
            self.settled = held
        self.scenes += 1

    def reason(self, group: str, held: int, limit: int) -> str:
        """Return why to replace the process before it opens this scene; empty to keep it.

        `held` is the process's memory now in bytes, `limit` the most scenes (0: no limit at all).
        """
        if not limit or group == self._last:
            return ""
        if self.scenes >= limit:
            return f"{self.scenes} scenes"
        if self.settled and held > max(_GROWTH * self.settled, self.settled + _MIN_GROWTH):
            return f"{format_bytes(held)} of memory, {format_bytes(self.settled)} at first"
        return ""


_history = WorkerHistory()


def replace_if_due(group: str, limit: int) -> None:
    """Replace this worker process if it is due; call it before a batch of the scene `group`.

    Nothing else may run on the worker. Raises dask's `Reschedule` if the process is closing:
    another worker then runs the batch.
    """
    worker = get_worker()
    if worker.status != Status.running:
        raise Reschedule
    held = psutil.Process().memory_info().rss
    reason = _history.reason(group, held, limit)
    if not reason or not worker.nanny:
        _history.begin(group, held)
        return
    # Results that the command has not fetched yet would have to be computed again.
    _wait_while(lambda: bool(worker.data))
    worker.loop.add_callback(worker.close_gracefully, restart=True, reason=f"pbrnet: {reason}")
    _wait_while(lambda: worker.status == Status.running)
    raise Reschedule


def _wait_while(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE
    while condition() and time.monotonic() < deadline:
        time.sleep(0.02)
