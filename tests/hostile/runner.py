"""Runs cases of hostile input in child processes, within limits of time, memory and place.

The packages are imported once; each case is a fork of that process. Its folder, home and
temporary folder lie deep in a tree of its own, so that what leads out of it is found.
"""

import hashlib
import importlib
import os
import re
import resource
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from tests.hostile.family import STAND_IN, Arguments, Family

SECONDS, MEMORY = 60, 2 * 2**30  # of a processor; resident bytes
PATIENCE = 240.0  # seconds on the clock, on a busy machine
ALLOWED = (0, 1, 2, 3, 4)  # exit codes: done, done in part, wrong usage, wrong input, machine
_DEEP = "a/b/c/d"
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Files around a case that some of its files name, and that are none of its business.
_OUTSIDE = [f"{name}{suffix}" for name in ("outside", "x") for suffix in
            ("", ".bin", ".exr", ".mtl", ".obj", ".pbrt", ".ply", ".png", ".xml")]  # fmt: skip
_SECRETS = ("/etc/passwd", "/etc/shadow")
_HARMLESS = ("/dev/null", "/dev/shm/", "/proc/", "/dev/tty", "/dev/full")
_PRELOADED = (
    "pbrnet.pipeline.cli",
    "pbrnet.pipeline.commands.import_scene",
    "pbrnet.pipeline.commands.inspect",
    "pbrnet.pipeline.commands.cost",
    "pbrnet.pipeline.commands.stages",
    "pbrnet.model.commands.doctor",
    "pbrnet.model.commands.predict",
    "pbrnet.model.commands.networks",
    "pbrnet.model.commands.report",
    "pbrnet.scenes.mitsuba.importer",
    "pbrnet.scenes.models.importer",
    "pbrnet.scenes.sweethome.importer",
)


@dataclass(frozen=True)
class Outcome:
    """End of a case; `faults` is empty if it ended as it should."""

    family: str
    number: int
    arguments: Arguments
    code: int  # negative: the signal
    seconds: float
    processor: float
    memory: int  # peak resident bytes
    message: str
    faults: tuple[str, ...]

    @property
    def name(self) -> str:
        """Family and number."""
        return f"{self.family}-{self.number}"


@dataclass
class _Running:
    family: Family
    number: int
    root: Path
    started: float
    late: bool = False


@dataclass
class Runner:
    """Runs cases with up to `processes` at once below the folder `work`."""

    work: Path
    processes: int = 1
    keep: bool = False
    _running: dict[int, _Running] = field(default_factory=dict)
    _templates: dict[str, Path] = field(default_factory=dict)

    def run(self, cases: Iterable[tuple[Family, int]]) -> Iterator[Outcome]:
        """Yield the outcome of each case, in order of completion."""
        for name in _PRELOADED:
            importlib.import_module(name)
        for family, number in cases:
            while len(self._running) >= self.processes:
                yield from self._finished()
            self._start(family, number)
        while self._running:
            yield from self._finished()

    def _start(self, family: Family, number: int) -> None:
        template = self._template(family)
        root = self.work / f"{family.name}-{number}"
        shutil.rmtree(root, ignore_errors=True)
        (root / _DEEP).mkdir(parents=True)
        for place in Path(_DEEP, "case").parents:
            for name in _OUTSIDE:
                (root / place / name).write_bytes(b"secret")
        shutil.copytree(template, root / _DEEP / "case", symlinks=True)
        child = os.fork()
        if child == 0:
            _child(root, family, number)
        self._running[child] = _Running(family, number, root, time.monotonic())

    def _template(self, family: Family) -> Path:
        """Write a family's sound files once, in a child, so that this process starts no threads."""
        if family.name not in self._templates:
            folder = self.work / f"template-{family.name}"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            child = os.fork()
            if child == 0:
                try:
                    family.base(folder)
                except BaseException as error:
                    print(f"{family.name}: base: {error!r}", file=sys.stderr, flush=True)
                    os._exit(1)
                os._exit(0)
            if os.waitpid(child, 0)[1]:
                raise RuntimeError(f"the sound files of {family.name} could not be written")
            self._templates[family.name] = folder
        return self._templates[family.name]

    def _finished(self) -> Iterator[Outcome]:
        """Wait for a child; stop those that are late."""
        while True:
            child, status, usage = os.wait4(-1, os.WNOHANG)
            if child in self._running:
                break
            now = time.monotonic()
            for number, one in self._running.items():
                if now - one.started > PATIENCE and not one.late:
                    one.late = True
                    os.killpg(number, signal.SIGKILL)
            time.sleep(0.005)
        done = self._running.pop(child)
        outcome = _judged(done, os.waitstatus_to_exitcode(status), usage)
        if not self.keep and not outcome.faults:
            shutil.rmtree(done.root, ignore_errors=True)
        yield outcome


def _child(root: Path, family: Family, number: int) -> None:
    """Run a case in this forked process, which ends."""
    code = 70
    try:
        os.setsid()
        case = root / _DEEP / "case"
        os.chdir(case)
        for name, value in {"HOME": case, "TMPDIR": case / "tmp", "XDG_CACHE_HOME": case}.items():
            os.environ[name] = str(value)
        (case / "tmp").mkdir(exist_ok=True)
        streams = {1: "stdout", 2: "stderr", 3: "report"}
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        for handle, name in streams.items():
            made = os.open(root / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(made, handle)
            os.close(made)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
        sys.__stdout__, sys.__stderr__ = sys.stdout, sys.stderr  # as those of a process of its own
        seed = hashlib.sha256(f"{family.name}/{number}".encode()).digest()
        arguments = family.write(case, Random(int.from_bytes(seed[:8], "little")), number)
        (root / "arguments").write_text("\0".join(arguments), "utf-8", "surrogatepass")
        (root / "listing").write_text("\n".join(_tree(root)), encoding="utf-8")
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        limit = size + 2 * MEMORY  # address space is more than memory: threads, maps of files
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        import tempfile

        from pbrnet.pipeline.cli import main
        from pbrnet.pipeline.farm import limits

        # Imports fork this process, as the command does: the hook watches forks alone.
        limits._can_fork = lambda: True
        tempfile.tempdir = None
        sys.argv = ["pbrnet", *arguments]
        sys.addaudithook(_Watch(case, root, 3))
        main(arguments)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


class _Watch:
    """Audit hook that reports programs that are run, and files outside the case's folder.

    Those that are written, wherever they are; those that are read of the tree around that folder,
    and of the system's accounts.
    """

    def __init__(self, folder: Path, root: Path, report: int) -> None:
        self.folder, self.report = os.fspath(folder.resolve()), report
        self.secrets = (os.fspath(root.resolve()) + "/", *_SECRETS)

    def __call__(self, event: str, values: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = values
            writes = flags & _WRITES if mode is None else set(str(mode)) & set("wax+")
            self._check(event if writes else "reads", path)
        elif event in ("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod"):
            self._check(event, values[0])
        elif event in ("os.rename", "os.link", "os.symlink"):
            self._check(event, values[1])
        elif event in ("subprocess.Popen", "os.exec", "os.posix_spawn", "os.system"):
            program = str(values[0])
            stand_in = f"{self.folder}/{STAND_IN}"  # of a case, in another program's place
            known = ("ldconfig", "uname", Path(sys.executable).name)
            if Path(program).name not in known and program != stand_in:
                os.write(self.report, f"runs {program}\n".encode(errors="replace"))

    def _check(self, event: str, path: Any) -> None:
        if isinstance(path, int):
            return
        try:
            real = os.path.realpath(os.fsdecode(path))
        except (TypeError, ValueError, OSError):
            return
        inside = real == self.folder or real.startswith(self.folder + "/")
        watched = event != "reads" or real.startswith(self.secrets)
        if watched and not inside and not real.startswith(_HARMLESS):
            os.write(self.report, f"{event} {real}\n".encode(errors="replace"))


def _tree(root: Path) -> list[str]:
    """Paths of everything below `root` outside the case's folder."""
    found = []
    for place, folders, files in os.walk(root):
        names = [os.path.relpath(Path(place) / name, root) for name in (*folders, *files)]
        found += [name for name in names if name != f"{_DEEP}/case"]
        folders[:] = [name for name in folders if (Path(place) / name) != root / _DEEP / "case"]
    own = {"stdout", "stderr", "report", "arguments", "listing"}
    return sorted(name for name in found if name not in own)


def _judged(done: _Running, code: int, usage: Any) -> Outcome:
    """Compare a case's end with what is allowed."""
    root = done.root

    def text(name: str) -> str:
        path = root / name
        return path.read_bytes().decode("utf-8", "replace") if path.is_file() else ""

    errors = text("stderr").strip()
    memory = usage.ru_maxrss * 1024
    faults = []
    if done.late or usage.ru_utime + usage.ru_stime > SECONDS - 1:
        faults.append(f"more than {SECONDS} s")
    elif code not in ALLOWED:
        faults.append(f"exit code {code}" if code >= 0 else f"signal {-code}")
    if memory > MEMORY:
        faults.append(f"{memory / 2**30:.1f} GiB of memory")
    if "Traceback" in errors:
        faults.append("traceback")
    if code in (1, 2, 3, 4) and not errors:
        faults.append("no message")
    if sum(line.startswith("Error: ") for line in errors.split("\n")) > 1:
        faults.append("more than one error")
    if re.search(r"\wWarning\b", errors):  # ours is a word of its own
        faults.append("a warning of a library")
    if not all(line.isprintable() for line in (errors + text("stdout")).split("\n")):
        faults.append("control characters")
    if len(errors) > 4000:
        faults.append(f"a message of {len(errors):,} characters")
    faults += [f"outside: {line}" for line in dict.fromkeys(text("report").splitlines())]
    new = sorted(set(_tree(root)) - set(text("listing").splitlines()))
    faults += [f"outside: made {name}" for name in new]
    lines = [line for line in errors.splitlines() if line.strip()]
    # Processes that a command leaves behind may write after it.
    named = [line for line in lines if line.startswith(("Error", "Usage"))]
    message = (named or lines or [""])[-1]
    return Outcome(
        done.family.name,
        done.number,
        text("arguments").split("\0"),
        code,
        time.monotonic() - done.started,
        usage.ru_utime + usage.ru_stime,
        memory,
        message[:300],
        tuple(faults),
    )


def table(outcomes: Iterable[Outcome]) -> str:
    """Figures by family: cases, exit codes, faults, the slowest and the largest."""
    families: dict[str, list[Outcome]] = {}
    for one in outcomes:
        families.setdefault(one.family, []).append(one)
    head = (
        "family",
        "cases",
        "done",
        "in part",
        "usage",
        "input",
        "machine",
        "faults",
        "worst s",
        "MiB",
        "core s",
    )
    lines = [f"{head[0]:16}" + "".join(f"{word:>9}" for word in head[1:])]
    every = [one for group in families.values() for one in group]
    for name, group in [*families.items(), ("all", every)]:
        codes = Counter(one.code for one in group if not one.faults)
        cells = [
            len(group),
            *(codes[code] for code in ALLOWED),
            sum(bool(one.faults) for one in group),
            f"{max((one.seconds for one in group), default=0):.1f}",
            f"{max((one.memory for one in group), default=0) / 2**20:.0f}",
            f"{sum(one.processor for one in group):.0f}",
        ]
        lines.append(f"{name:16}" + "".join(f"{cell:>9}" for cell in cells))
    return "\n".join(lines)
