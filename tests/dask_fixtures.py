"""Real dask processes on the loopback, for the tests of clusters."""

from __future__ import annotations

import os
import re
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
    file = folder / "scheduler.json"
    common = ["--scheduler-file", str(file), "--host", "127.0.0.1", "--no-dashboard"]
    roles = (
        ["scheduler", "--port", "0"],
        ["worker", "--nthreads", "2", "--local-directory", str(folder)],
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", "dask", *role, *common],
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(TESTS)},
        )
        for role in roles
    ]
    try:
        deadline = time.monotonic() + 60
        while "address" not in (text := file.read_text() if file.exists() else ""):
            assert time.monotonic() < deadline, "the scheduler did not start"
            time.sleep(0.1)
        address = re.search(r'"address": "([^"]+)"', text)
        assert address
        yield Cluster(address[1], *processes)
    finally:
        for process in reversed(processes):
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
