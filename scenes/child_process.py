"""Child processes for libraries that may crash, limited in processor time, memory and duration.

The parent calls `run_child`; the child sets its own limits and calls a function with words as
arguments, which leaves its results in files. Also the check that an optional library is there.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name

from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.installation import IMPORT_FOLDER

_MOST_SAID = 300  # characters of a message of the library
_REFUSED, _FAILED = 3, 4  # exit status of a child that leaves a message


def require_extra(module: str, extra: str, path: Path) -> None:
    """Raise `MachineError` unless the Python module of the optional dependency is installed."""
    if find_spec(module) is None:
        raise MachineError(
            f"{path}: {path.suffix.lower()} files need an optional library; "
            f"install pbrnet[{extra}], for example by: pip install 'pbrnet[{extra}]'"
        )


def run_child(
    function: str, arguments: tuple[str, ...], path: Path, seconds: int, memory: int
) -> None:
    """Call "module:function" with `arguments` in a child of at most `seconds` and `memory` bytes.

    `path` is the file that it reads. Raises `InputError` with the message of an `InputError` in
    the child, and for a child that crashes, runs too long or needs too much memory.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PXR_")}
    known = environment.get("PYTHONPATH", "")
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(IMPORT_FOLDER), known)))
    with tempfile.TemporaryDirectory() as folder:
        message = Path(folder) / "message"
        command = [sys.executable, "-m", __name__, function, str(message), str(seconds),
                   str(memory), *arguments]  # fmt: skip
        run_program(command, environment, path, seconds, memory, message)


def run_program(
    command: list[str],
    environment: dict[str, str],
    path: Path,
    seconds: int,
    memory: int,
    message: Path,
) -> None:
    """Run a program that reads the file `path` and sets its limits itself, as `run_child` does.

    It runs in the folder of `message`, the file in which it may say why it ended with a status
    other than 0. Raises `InputError` as `run_child` does.
    """
    try:
        done = subprocess.run(
            command,
            env=environment,
            cwd=message.parent,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=2 * seconds + 30,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: reading took more than {2 * seconds + 30} s") from None
    if done.returncode == 0:
        return
    said = message.read_text("utf-8", "replace") if message.is_file() else ""
    if done.returncode == _REFUSED and said:
        raise InputError(said)
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise InputError(f"{path}: reading took more than {seconds} s of a processor")
    # An error of a library may quote a traceback, whose last line is the error itself.
    said = said.strip().rpartition("\n")[2].strip()[:_MOST_SAID]
    raise InputError(
        f"{path}: the library that reads {path.suffix.lower()} files failed on it "
        f"({said or f'status {done.returncode}'}); it is damaged, or needs more than "
        f"{memory / 2**30:g} GiB"
    )


def _main(function: str, message: str, seconds: str, memory: str, *arguments: str) -> int:
    for kind, soft, hard in (
        (resource.RLIMIT_CPU, int(seconds), int(seconds) + 5),
        (resource.RLIMIT_AS, int(memory), int(memory)),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        _, largest = resource.getrlimit(kind)  # of this process, which may be limited already
        if largest != resource.RLIM_INFINITY:
            soft, hard = min(soft, largest), min(hard, largest)
        resource.setrlimit(kind, (soft, hard))
    try:
        resolve_name(function)(*arguments)
    except InputError as error:
        Path(message).write_text(str(error), "utf-8", "replace")
        return _REFUSED
    except Exception as error:  # of the library, which may raise anything on a damaged file
        said = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        Path(message).write_text(said, "utf-8", "replace")
        return _FAILED
    return 0


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
