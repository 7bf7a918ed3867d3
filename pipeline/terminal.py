r"""Lines for the user: the only place that prints. Text of strangers cannot steer the terminal.

Nor do libraries write beside our lines: see `quiet_libraries`.
"""

from __future__ import annotations

import ctypes
import io
import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from pbrnet.scenes.errors import ParameterError

# Old name of a command, option or parameter: its present name. The old one works for one minor
# version; then it moves to `REMOVED`, with what to use instead. Names are written
# "pbrnet COMMAND", "pbrnet COMMAND --option" and "section.key"; keys stay in their section.
RENAMED: dict[str, str] = {}
REMOVED = {"pbrnet predict --visibility": "--transport and --materials"}


def visible(text: object) -> str:
    r"""Return text as one line that shows every sign, control characters as Python writes them.

    A line break becomes `\n`, a bell `\x07`, the beginning of an escape sequence `\x1b`.
    """
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in str(text)
    )


def lines_of(lines: Iterable[object]) -> str:
    """Return lines as one text, each made `visible`: only its own line breaks begin a line."""
    return "\n".join(map(visible, lines))


def counted(count: int, noun: str) -> str:
    """Return a number with a noun, in the plural unless it is one: `1 view`, `1,200 views`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def views_of(views: int, scenes: int, split: str = "") -> str:
    """Return numbers of views and scenes as `12 views of 1 test scene`."""
    return f"{counted(views, 'view')} of {counted(scenes, f'{split} scene'.lstrip())}"


def say(*lines: object, err: bool = False) -> None:
    """Print lines, each made `visible`, with `err` on standard error.

    So a name in a file from outside neither forges a line, nor hides one, nor rings.
    """
    print(lines_of(lines or ("",)), file=sys.stderr if err else sys.stdout, flush=True)


def present(name: str) -> str:
    """Return the present name of a command, option or parameter; say so of an old one.

    Raises `ParameterError` for a name that was removed.
    """
    if name in REMOVED:
        raise ParameterError(f"{name} was removed; use {REMOVED[name]}")
    if name in RENAMED:
        say(f"{name} is deprecated; use {RENAMED[name]}", err=True)
    return RENAMED.get(name, name)


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Hide what libraries say of a file, here and in child processes; our own messages tell it.

    Python's warnings, unless Python was asked for them, and what OpenEXR, libtiff and others write
    to the standard streams natively: Python's own streams are elsewhere meanwhile. With
    PBRNET_DEBUG in the environment, all is shown.
    """
    with ExitStack() as stack:
        if not sys.warnoptions:
            os.environ["PYTHONWARNINGS"] = "ignore"
            stack.callback(os.environ.pop, "PYTHONWARNINGS", None)
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore")
        if not os.environ.get("PBRNET_DEBUG"):
            stack.enter_context(_moved("stdout", 1))
            stack.enter_context(_moved("stderr", 2))
        yield


@contextmanager
def _moved(name: str, number: int) -> Iterator[None]:
    """Move a stream of Python's to a copy of its file descriptor, and let that lead nowhere."""
    stream = getattr(sys, name)
    if stream is None or stream is not getattr(sys, f"__{name}__"):  # of a test, a notebook
        yield
        return
    stream.flush()
    kept, nowhere = os.dup(number), os.open(os.devnull, os.O_WRONLY)
    moved = os.fdopen(
        os.dup(number), "w", encoding=stream.encoding, errors="backslashreplace", buffering=1
    )
    setattr(sys, name, moved)
    os.dup2(nowhere, number)
    os.close(nowhere)
    try:
        yield
    finally:
        with suppress(OSError):  # its reader has gone
            moved.close()
        ctypes.CDLL(None).fflush(None)  # what native code printed last
        os.dup2(kept, number)
        os.close(kept)
        setattr(sys, name, stream)


def own_streams() -> dict[str, Any]:
    """Arguments of `subprocess.run` with which a program prints where this one does."""
    found = {}
    for name in ("stdout", "stderr"):
        with suppress(AttributeError, io.UnsupportedOperation):  # a test's
            found[name] = getattr(sys, name).fileno()
    return found
