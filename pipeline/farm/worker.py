"""Execution of a batch of items inside a dask worker.

The module is also the preload of the worker processes that `pbrnet.pipeline.farm.cluster` starts on
this machine, and may be that of others: dask calls `dask_setup` in each of them.

A renderer's memory rises to the need of its largest scene, and leaked memory stays. A process is
replaced after a number of scenes, or when it holds much more than after its first few: it returns
its next batch to the scheduler and its nanny starts another. Workers without a nanny are kept.
"""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import re
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import psutil
from dask.utils import format_bytes
from distributed import Reschedule, get_worker
from distributed.core import Status

from pbrnet.pipeline.farm.settings import VISIBLE_CARDS
from pbrnet.scenes.errors import MachineError, in_one_line

_MAX_RETURNED = 32 << 20  # bytes of files that a batch returns; beyond that it ends early
_rendering = threading.Lock()  # one batch at a time per process: Dr.Jit's state is the process's
_SETTLED = 3  # scenes after which a process has loaded everything that all scenes need
_GROWTH = 1.5  # factor over the settled memory
_MIN_GROWTH = 256 << 20  # bytes over the settled memory: less is not worth a new process
_CLOSING = 10.0  # seconds


@dataclass(frozen=True)
class Item:
    """A unit of work.

    `payload` is the argument of the work function; `group` names the costly state (an opened
    scene) that items share; `weight` is the expected duration, in any unit. Within its group an
    item comes after those of a lower `phase`, and shares no batch with them.
    """

    key: str
    group: str
    payload: Any
    weight: float = 1.0
    phase: int = 0


@dataclass(frozen=True)
class Outcome:
    """Result of an item: `value` from the work function, or a message in `error`."""

    key: str
    value: Any = None
    error: str = ""
    fatal: bool = False
    seconds: float = 0.0
    worker: str = ""
    attempt: int = 1
    ended: datetime | None = None  # by the worker's clock


def run_batch(
    setup: Callable[[int], None],
    threads: int,
    time_limit: int,
    recycle: int,
    work: Callable[[Any], Any],
    batch: tuple[Item, ...],
    attempts: list[int],
    topic: str,
) -> list[Outcome]:
    """Run the items of a batch in order and return their outcomes.

    The key of each finished item, with its seconds, is an event of `topic`, which the command reads
    meanwhile.

    The list is shorter than the batch after a fatal error, and when the returned files exceed
    `_MAX_RETURNED`; the caller submits the remaining items again.
    """
    returned = 0
    worker = f"{os.uname().nodename}:{os.getpid()}"
    outcomes = []
    _leave_terminal()
    with _rendering:
        replace_if_due(batch[0].group, recycle)
        for item, attempt in zip(batch, attempts, strict=True):
            started = time.perf_counter()
            value, message, fatal = None, "", False
            try:
                with _time_limit(time_limit):
                    setup(threads)
                    value = work(item.payload)
            except MachineError as error:
                message, fatal = str(error), True
            except Exception as error:
                message = _message(error)
            seconds = time.perf_counter() - started
            ended = datetime.now(UTC)
            outcomes.append(
                Outcome(item.key, value, message, fatal, seconds, worker, attempt, ended)
            )
            files = value.get("files", {}) if isinstance(value, dict) else {}
            returned += sum(len(file.content) for file in files.values())
            if not message:
                with contextlib.suppress(Exception):  # progress is no reason to fail
                    get_worker().log_event(topic, (item.key, seconds))
            if fatal or returned > _MAX_RETURNED:
                break
    return outcomes


def dask_setup(worker: Any) -> None:
    """Prepare a worker process; dask calls this as the process starts."""
    _leave_terminal()
    _take_card(str(worker.name))


def _take_card(name: str) -> None:
    """Leave one of several visible graphics cards to this worker, by the number in its name."""
    cards, number = os.environ.get(VISIBLE_CARDS, "").split(","), re.search(r"\d+$", name)
    if len(cards) > 1 and number:
        os.environ[VISIBLE_CARDS] = cards[int(number[0]) % len(cards)]


def _leave_terminal() -> None:
    """Keep a terminal's Ctrl-C from this worker; its nanny, or the main process, ends it.

    Mitsuba handles SIGINT itself while it renders, and returns early with an image that looks
    finished: such a frame must never be written.
    """
    if multiprocessing.parent_process() is not None and os.getpgid(0) != os.getpid():
        with contextlib.suppress(OSError):
            os.setpgid(0, 0)


@contextlib.contextmanager
def _time_limit(seconds: int) -> Iterator[None]:
    """End this process if the block takes longer than `seconds` (0: no limit).

    Uses the interpreter's watchdog, which is no Python thread: an endless kernel in native code
    may hold the interpreter's lock.
    """
    if not seconds:
        yield
        return
    with Path(os.devnull).open("w") as nowhere:  # a traceback would not show the native kernel
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _message(error: Exception) -> str:
    """Return an error as one line, with its place unless it is one of the project's own."""
    text = in_one_line(error)
    frames = traceback.extract_tb(error.__traceback__)
    if hasattr(error, "exit_code") or not frames:
        return text
    return f"{type(error).__name__}: {text} (in {frames[-1].name}, line {frames[-1].lineno})"


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
    deadline = time.monotonic() + _CLOSING
    while condition() and time.monotonic() < deadline:
        time.sleep(0.02)
