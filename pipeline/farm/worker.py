"""Execution of a batch of items inside a dask worker.

The module is also the preload of the worker processes that `pbrnet.pipeline.farm.cluster` starts on
this machine, and may be that of others: dask calls `dask_setup` in each of them.
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

from distributed import get_worker

from pbrnet.pipeline.farm.recycling import replace_if_due
from pbrnet.pipeline.farm.scheduling import Item
from pbrnet.pipeline.farm.settings import VISIBLE_CARDS
from pbrnet.scenes.errors import MachineError

_MAX_RETURNED = 32 << 20  # bytes of files that a batch returns; beyond that it ends early
_rendering = threading.Lock()  # one batch at a time per process: Dr.Jit's state is the process's


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

    The key of each finished item is an event of `topic`, which the command reads meanwhile.

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
                    get_worker().log_event(topic, item.key)
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
    text = " ".join(str(error).split()) or type(error).__name__
    frames = traceback.extract_tb(error.__traceback__)
    if hasattr(error, "exit_code") or not frames:
        return text
    return f"{type(error).__name__}: {text} (in {frames[-1].name}, line {frames[-1].lineno})"
