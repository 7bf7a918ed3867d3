"""Real dask processes on the loopback, for the tests of clusters."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

TESTS = Path(__file__).parent


@dataclass(frozen=True)
class Cluster:
    """A `dask scheduler` and one `dask worker` process (with its nanny)."""

    address: str
    scheduler: subprocess.Popen[bytes]
    worker: subprocess.Popen[bytes]


@contextmanager
def dask_cluster(folder: Path) -> Iterator[Cluster]:
    """Start both processes, and end them with all their children."""
    folder.mkdir(parents=True, exist_ok=True)
    with dask_scheduler(folder) as (address, scheduler), dask_worker(address, folder) as worker:
        yield Cluster(address, scheduler, worker)


@contextmanager
def dask_scheduler(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler alone: its address and process."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "scheduler.json"
    words = ["--scheduler-file", str(file), "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    with _dask("scheduler", *words) as process:
        deadline = time.monotonic() + 60
        while "address" not in (text := file.read_text() if file.exists() else ""):
            assert time.monotonic() < deadline, "the scheduler did not start"
            time.sleep(0.1)
        address = re.search(r'"address": "([^"]+)"', text)
        assert address
        yield address[1], process


@contextmanager
def dask_worker(
    address: str,
    folder: Path,
    source: Path | None = None,
    hidden: Path | None = None,
    processes: int = 1,
) -> Iterator[subprocess.Popen[bytes]]:
    """A worker at work in `folder`, with our code or that below `source`; ended at the end.

    It and what it starts do not see what lies in the folder `hidden`, as on another machine. What
    it is sent it keeps in `folder/cache`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    words = ["--host", "127.0.0.1", "--nthreads", "2", "--local-directory", str(folder)]
    words += ["--nworkers", str(processes), "--no-dashboard"]
    with _dask("worker", address, *words, folder=folder, source=source, hidden=hidden) as worker:
        yield worker


def without(hidden: Path) -> list[str]:
    """What to put before a command for it to see an empty folder instead of `hidden`."""
    rights = ["--mount"] if os.geteuid() == 0 else ["--mount", "--map-root-user"]
    script = 'mount -t tmpfs tmpfs "$0" && exec "$@"'
    return ["unshare", *rights, "sh", "-c", script, str(hidden)]


def can_hide(folder: Path) -> bool:
    """Whether this machine lets us hide folders from what we start."""
    if not shutil.which("unshare"):
        return False
    (folder / "something").touch()
    command = [*without(folder), "test", "!", "-e", str(folder / "something")]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@contextmanager
def _dask(
    *words: str,
    folder: Path | None = None,
    source: Path | None = None,
    hidden: Path | None = None,
) -> Iterator[subprocess.Popen[bytes]]:
    code = [str(path) for path in (source or TESTS.parent, TESTS)]
    cache = {"PBRNET_CACHE": str(folder / "cache")} if folder else {}
    process = subprocess.Popen(
        [*(without(hidden) if hidden else []), sys.executable, "-m", "dask", *words],
        stderr=subprocess.DEVNULL,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(code), **cache},
    )
    try:
        yield process
    finally:
        kill_tree(process)


def kill_tree(process: subprocess.Popen[bytes]) -> None:
    """SIGKILL a process and all that descend from it."""
    if process.poll() is None:
        for victim in [psutil.Process(process.pid), *workers_of(process)]:
            victim.kill()
    process.wait()


def workers_of(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """The processes that descend from one of ours."""
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []
