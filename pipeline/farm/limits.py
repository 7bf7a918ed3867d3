"""Limits of time and memory for work in a child process, which is stopped when it exceeds them."""

from __future__ import annotations

import json
import os
import pickle
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import psutil

from pbrnet.scenes.errors import InputError, MachineError, ParameterError, PbrnetError
from pbrnet.scenes.files import temporary_folder
from pbrnet.scenes.installation import IMPORT_FOLDER

_ERRORS: tuple[type[PbrnetError], ...] = (ParameterError, InputError, MachineError, PbrnetError)
_THREADED = ("drjit", "torch", "pyarrow")  # libraries with threads that a fork loses
_INTERVAL = 0.1  # seconds between two checks
_LENGTH = 8  # bytes of the number of bytes that follow


@dataclass(frozen=True)
class Limits:
    """Wall-clock seconds, and GiB of resident memory of a process and its children."""

    seconds: float
    gibibytes: float
    options: tuple[str, str] = ("--max-seconds", "--max-memory")  # which allow more of each


class StoppedError(MachineError):
    """The work exceeded a limit, or its process died."""


def run_limited(work: Callable[[], object], limits: Limits, what: str) -> int:
    """Call `work` in a child process within `limits`; its exceptions are raised here.

    Returns the bytes of memory that it needed at most. Raises `StoppedError`, which begins with
    `what`, if the child exceeds a limit or crashes. Its temporary files are removed in any case,
    also on SIGTERM, which ends both as Ctrl-C does. If this process is killed, the child ends too.
    The child is forked where that is safe; a process with threads starts a fresh interpreter
    instead, for which `work` must be picklable.
    """
    with temporary_folder() as folder:
        reader, writer = os.pipe()
        try:
            start = _forked if _can_fork() else _started
            with start(work, reader, writer, folder) as child, _terminable():
                os.close(writer)
                writer = -1
                said, peak = _watched(child, reader, limits, what)
        finally:
            for each in (reader, writer):
                if each >= 0:
                    os.close(each)
    if not said:
        raise StoppedError(
            f"{what}: the import ended without a word, as if it was killed or a library crashed; "
            "allow it more memory, or convert the file with another program"
        )
    outcome = json.loads(said)
    if outcome is not None:
        kinds: dict[str, type[Exception]] = {each.__name__: each for each in _ERRORS}
        error = kinds.get(outcome["kind"], RuntimeError)(outcome["text"])
        error.add_note(outcome["trace"])
        raise error
    return peak


def _can_fork() -> bool:
    """Return whether this process has no threads but those of NumPy's OpenBLAS.

    OpenBLAS starts threads as it is loaded, and stops them around a fork.
    """
    return threading.active_count() == 1 and not any(name in sys.modules for name in _THREADED)


@contextmanager
def _forked(work: Callable[[], object], reader: int, writer: int, folder: Path) -> Iterator[int]:
    """A forked child that calls `work`; yields its number."""
    watched, held = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(held)
        os.close(reader)
        os.setpgid(0, 0)
        tempfile.tempdir = str(folder)
        _work_while(os.fdopen(watched, "rb"), work, writer)
    os.close(watched)
    try:
        yield child
    finally:
        _stop(child)
        with suppress(ChildProcessError):
            os.waitpid(child, 0)
        os.close(held)


@contextmanager
def _started(work: Callable[[], object], reader: int, writer: int, folder: Path) -> Iterator[int]:
    """A fresh interpreter that calls `work`; yields the number of its process."""
    known = os.environ.get("PYTHONPATH", "")
    path = os.pathsep.join(filter(None, (str(IMPORT_FOLDER), known)))
    with subprocess.Popen(
        [sys.executable, "-m", __name__, str(writer)],
        stdin=subprocess.PIPE,
        pass_fds=(writer,),
        process_group=0,
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(folder)},
    ) as child:
        assert child.stdin is not None
        try:
            with suppress(BrokenPipeError):  # it has died already
                job = pickle.dumps(work)
                child.stdin.write(len(job).to_bytes(_LENGTH) + job)
                child.stdin.flush()
            yield child.pid
        finally:
            _stop(child.pid)


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM end this process as Ctrl-C does, where its main thread runs the block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _work_while(parent: BinaryIO, work: Callable[[], object], writer: int) -> None:
    """Run in the child: call `work`, send its exception (or None) and end the process.

    `parent` is a stream that ends when the parent does, upon which the child ends, too.
    """
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    outcome: dict[str, str] | None = None
    try:
        work()
    except BaseException as error:
        outcome = _described(error)
    sys.stdout.flush()
    sys.stderr.flush()
    with os.fdopen(writer, "wb") as stream:
        stream.write(json.dumps(outcome).encode())
    os._exit(0)


def _end_with(parent: BinaryIO) -> None:
    parent.read()
    os.killpg(0, signal.SIGKILL)


def _described(error: BaseException) -> dict[str, str]:
    """Describe an exception as text: JSON, since what a hostile file made is not unpickled."""
    kind = next((each for each in _ERRORS if isinstance(error, each)), None)
    trace = "In the child process:\n" + "".join(traceback.format_exception(error))
    if kind is None:
        return {"kind": "", "text": f"{type(error).__name__}: {error}", "trace": trace}
    return {"kind": kind.__name__, "text": str(error), "trace": trace}


def _watched(child: int, reader: int, limits: Limits, what: str) -> tuple[bytes, int]:
    """Return what the child writes until it closes `reader`, and its greatest memory, bytes.

    Raises `StoppedError` at a limit.
    """
    started, said, peak = time.monotonic(), b"", 0
    while True:
        if select.select([reader], [], [], _INTERVAL)[0]:
            part = os.read(reader, 1 << 16)
            if not part:
                return said, peak
            said += part
        peak = max(peak, _memory(child))
        for used, limit, text, option in (
            (time.monotonic() - started, limits.seconds,
             f"took more than {limits.seconds:g} s", limits.options[0]),
            (peak / 2**30, limits.gibibytes,
             f"needed more than {limits.gibibytes:g} GiB of memory", limits.options[1]),
        ):  # fmt: skip
            if used > limit:
                raise StoppedError(
                    f"{what}: the import {text} and was stopped; import a simpler or smaller part "
                    f"of the scene, or allow more with {option}"
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
    """Kill a child and its process group, if they still run."""
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError):
            kill(child, signal.SIGKILL)


def _main(writer: str) -> None:
    """Run in a fresh interpreter: read the work from standard input and do it."""
    stream = sys.stdin.buffer
    size = int.from_bytes(stream.read(_LENGTH))
    _work_while(stream, pickle.loads(stream.read(size)), int(writer))


if __name__ == "__main__":
    _main(*sys.argv[1:])
