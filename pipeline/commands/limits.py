"""Limits of time and memory for work in a child process, which is stopped when it exceeds them."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import psutil

from scenes.errors import InputError, MachineError, ParameterError, PbrnetError

_ERRORS: tuple[type[PbrnetError], ...] = (
    ParameterError,
    InputError,
    MachineError,
    PbrnetError,
)
_THREADED = ("drjit", "torch", "pyarrow")  # libraries with threads that a fork loses
_INTERVAL = 0.1  # seconds between two checks


@dataclass(frozen=True)
class Limits:
    """Wall-clock seconds, and GiB of resident memory of a process and its children."""

    seconds: float
    gibibytes: float


def run_limited(work: Callable[[], None], limits: Limits, what: str) -> None:
    """Call `work` in a forked child within `limits`; its exceptions are raised here.

    Raises `MachineError`, which begins with `what`, if the child exceeds a limit or crashes.
    Temporary files of the child are removed in any case, also on SIGTERM, which ends both as Ctrl-C
    does. A process with threads of Python, or of
    libraries of `_THREADED`, cannot be forked safely; it calls `work` itself, without limits.
    """
    if not _can_fork():
        work()
        return
    with tempfile.TemporaryDirectory(prefix="pbrnet-import-") as folder:
        reader, writer = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        child = os.fork()
        if child == 0:
            os.close(reader)
            _run_child(work, writer, folder)
        os.close(writer)
        before = signal.signal(signal.SIGTERM, _interrupt)
        try:
            said = _watched(child, reader, limits, what)
        finally:
            os.close(reader)
            _stop(child)
            signal.signal(signal.SIGTERM, before)
    if not said:
        raise MachineError(
            f"{what}: the import ended without a word, as if it was killed or a library crashed; "
            "allow it more memory, or convert the file with another program"
        )
    outcome = json.loads(said)
    if outcome is not None:
        kinds: dict[str, type[Exception]] = {each.__name__: each for each in _ERRORS}
        error = kinds.get(outcome["kind"], RuntimeError)(outcome["text"])
        error.add_note(outcome["trace"])
        raise error


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _can_fork() -> bool:
    """Return whether this process has no threads but those of NumPy's OpenBLAS.

    OpenBLAS starts threads as it is loaded, and stops them around a fork.
    """
    return threading.active_count() == 1 and not any(name in sys.modules for name in _THREADED)


def _run_child(work: Callable[[], None], writer: int, folder: str) -> None:
    """Run in the child: call `work`, send its exception (or None) and end the process."""
    os.setpgid(0, 0)
    tempfile.tempdir = folder
    outcome: dict[str, str] | None = None
    try:
        work()
    except BaseException as error:
        outcome = _described(error)
    with os.fdopen(writer, "wb") as stream:
        stream.write(json.dumps(outcome).encode())
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _described(error: BaseException) -> dict[str, str]:
    """Describe an exception as text: JSON, since what a hostile file made is not unpickled."""
    kind = next((each for each in _ERRORS if isinstance(error, each)), None)
    trace = "In the child process:\n" + "".join(traceback.format_exception(error))
    if kind is None:
        return {"kind": "", "text": f"{type(error).__name__}: {error}", "trace": trace}
    return {"kind": kind.__name__, "text": str(error), "trace": trace}


def _watched(child: int, reader: int, limits: Limits, what: str) -> bytes:
    """Return what the child writes until it closes `reader`; raises `MachineError` at a limit."""
    started, said = time.monotonic(), b""
    while True:
        if select.select([reader], [], [], _INTERVAL)[0]:
            part = os.read(reader, 1 << 16)
            if not part:
                return said
            said += part
        if time.monotonic() - started > limits.seconds:
            raise MachineError(
                f"{what}: the import took more than {limits.seconds:g} s and was stopped; import a "
                "simpler or smaller part of the scene, or allow more with --max-seconds"
            )
        if _memory(child) > limits.gibibytes * 2**30:
            raise MachineError(
                f"{what}: the import needed more than {limits.gibibytes:g} GiB of memory and was "
                "stopped; import a simpler or smaller part of the scene, or allow more with "
                "--max-memory"
            )


def _memory(child: int) -> int:
    """Resident memory of a process and its descendants, bytes; 0 when it has ended."""
    total = 0
    with suppress(psutil.Error):
        process = psutil.Process(child)
        for each in (process, *process.children(recursive=True)):
            total += each.memory_info().rss
    return total


def _stop(child: int) -> None:
    """Kill a child and its process group, if they still run, and reap it."""
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError):
            kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
