"""Dask cluster of a stage: an external scheduler, or worker processes on this machine.

The scheduler is that of `--scheduler`, else of `DASK_SCHEDULER_ADDRESS`, else a local cluster with
one process per allowed CPU. Workers that share the data folder return paths and figures; others
receive their inputs through dask (`pbrnet.pipeline.farm.transfer`) and return the files they made.

Failures and their handling:

* an item raises: it is retried `retries` times in a batch of its own, then reported;
* an item exceeds `time_limit`: its worker ends itself, as if it had died;
* a worker is frozen, so that it cannot end itself: it is replaced from outside
  (`pbrnet.pipeline.farm.dispatch`);
* a worker has opened many scenes or has grown: a fresh process replaces it
  (`pbrnet.pipeline.farm.worker`);
* a worker dies: dask gives its batches to another worker; the items of a batch that keeps killing
  its workers run one at a time with nothing beside them, so that only the culprit is reported
  (`pbrnet.pipeline.farm.dispatch`);
* the machine lacks something (`MachineError`: a full disk, a missing library): the run stops;
* the scheduler goes away: `MachineError`; the same command resumes the run.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import multiprocessing.forkserver
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import dask
import psutil
from dask.system import cpu_count
from distributed import Client, LocalCluster, Nanny
from distributed.utils import get_mp_context, silence_logging_cmgr

from pbrnet.pipeline.farm.dispatch import Dispatch
from pbrnet.pipeline.farm.settings import VISIBLE_CARDS, FarmParams
from pbrnet.pipeline.farm.transfer import TransferServer, TransferService
from pbrnet.pipeline.farm.worker import Item, Outcome
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.errors import MachineError, ParameterError

CONNECT_PATIENCE = 15.0  # seconds to look for a scheduler
# A Unix socket's path has at most 107 bytes, of which `multiprocessing` takes the last 32.
_LONGEST_TEMPORARY = 107 - len("/pymp-12345678/listener-12345678")
_LOST = "60s"  # in which a lost local worker may come back, on a busy machine
_FOLDER = "pbrnet-farm-"
# Libraries that workers need and that start no thread: a server imports them once, and forks itself
# for each worker process, where a fresh interpreter would take two seconds of imports.
_PRELOADED = (
    "distributed",
    "PIL.Image",
    "scipy.ndimage",
    "scipy.sparse.csgraph",
    "scipy.spatial",
    "shapely",
    "skimage.measure",
)


class Farm:
    """Dask workers, as a context manager: they exist inside the block and are gone after it.

    `setup` runs on a worker before each item and must be quick when repeated; its argument is the
    number of threads that the worker may use (0: its own choice). `setup` and the work function
    must be importable by name. `service` answers the workers' requests for files. If `needed`, a
    file, is not visible to all workers of an external scheduler, local workers are used instead.
    Local workers take turns at `cards`, names of graphics cards for `CUDA_VISIBLE_DEVICES`; there
    is one worker for each unless the parameters say how many.
    """

    def __init__(
        self,
        params: FarmParams,
        scheduler: str | None,
        setup: Callable[[int], None],
        items: int,
        service: TransferService | None = None,
        needed: Path | None = None,
        cards: Sequence[str] = (),
    ) -> None:
        self.params, self.setup, self.service, self.needed = params, setup, service, needed
        self.address, self.cards = scheduler_address(scheduler), cards
        self.wanted = self._useful(items)
        self._stack = contextlib.ExitStack()
        self._cluster: LocalCluster | None = None

    def __enter__(self) -> Farm:
        try:
            with _interrupt_deferred():
                self._start()
        except BaseException:
            self.__exit__(*sys.exc_info())
            raise
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        nannies = list(self._cluster.workers.values()) if self._cluster is not None else []
        # The results of interrupted work are discarded: do not wait for it to end.
        if kind is not None:
            for nanny in nannies:
                nanny.close_gracefully()  # tells the nanny not to start another worker
            _kill_workers(nannies)
        self._stack.close()
        _kill_workers(nannies)  # those that a busy machine did not end in time

    def run(
        self,
        work: Callable[[Any], Any],
        items: Sequence[Item],
        finished: Callable[[str, float], None] | None = None,
    ) -> Iterator[Outcome]:
        """Yield exactly one final outcome per item, in order of completion.

        `finished` is called with an item's key and seconds as soon as a worker has finished it.
        Raises `MachineError` when the scheduler or all workers are gone, or a worker's machine
        cannot run any item.
        """
        self._dispatch = Dispatch(
            self._client,
            self.params,
            self.setup,
            self.threads,
            work,
            items,
            refill=self._refill,
            external=bool(self.address),
            finished=finished,
        )
        yield from self._dispatch.outcomes()

    def add(self, items: Sequence[Item]) -> None:
        """Add items to those of `run`, between two of its outcomes."""
        self._dispatch.add(items)

    def serve(self, items: int) -> None:
        """Have as many workers as so many items can use, if there are fewer."""
        self.wanted = max(self.wanted, self._useful(items))
        self._refill()

    def _useful(self, items: int) -> int:
        return min(self.params.workers or len(self.cards) or cpu_count(), max(1, items))

    @property
    def count(self) -> int:
        """Number of workers that there are now, at least 1."""
        found = len(self._client.scheduler_info(n_workers=-1)["workers"])
        return max(1, found if self.address else self.wanted)

    @property
    def workers(self) -> str:
        """The scheduler and its workers in words."""
        found = self._client.scheduler_info(n_workers=-1)["workers"].values()
        if not self.address:
            address = self._client.scheduler.address
            return f"workers: {self.wanted} on this machine, scheduler {address}"
        hosts = Counter(str(info.get("host", "?")) for info in found)
        named = ", ".join(f"{host} ({count})" for host, count in sorted(hosts.items()))
        return f"workers: {len(found)} of the scheduler {self.address}: {named or 'none yet'}"

    @property
    def threads(self) -> int:
        """Number of threads that each worker may use; 0: its own choice."""
        return 0 if self.address else max(1, cpu_count() // self.wanted)

    def _start(self) -> None:
        if self.address:
            self._connect()
        if not self.address:
            self._start_local()
        if self.service:
            server = TransferServer(self._client, self.service)
            self._stack.callback(server.close)

    def _connect(self) -> None:
        """Connect to the scheduler; reset `address` if one of its workers does not see `needed`."""
        if "://" not in self.address and not re.search(r":\d+$", self.address):
            raise ParameterError(
                f"{self.address!r} is not a scheduler address; write it like tcp://head:8786"
            )
        try:
            client = Client(self.address, timeout=CONNECT_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise MachineError(
                f"no dask scheduler answers at {self.address!r} ({error}); start one with "
                "'dask scheduler', or unset DASK_SCHEDULER_ADDRESS to use this machine alone"
            ) from None
        if self.needed and not _all_see(client, self.needed):
            say(
                f"note: the workers at {self.address} cannot see {self.needed.parent}, which this "
                "stage needs; it runs on local workers instead",
                err=True,
            )
            self._close_quietly(client)
            self.address = ""
            return
        # A lost scheduler is reported by `Dispatch`, not by dask's log.
        self._stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        self._client = client
        self._stack.callback(self._close_quietly, client)

    def _start_local(self) -> None:
        _check_socket_path()
        _remove_old_folders()
        folder = self._stack.enter_context(
            tempfile.TemporaryDirectory(
                prefix=f"{_FOLDER}{os.getpid()}-", ignore_cleanup_errors=True
            )
        )
        self._stack.enter_context(
            dask.config.set(
                {
                    "distributed.scheduler.allowed-failures": self.params.retries,
                    "distributed.deploy.lost-worker-timeout": _LOST,
                    "distributed.worker.multiprocessing-method": "forkserver",
                    # A renderer's memory is native: it cannot be spilled, and a paused worker
                    # would never resume. The nanny ends a worker that outgrows its share.
                    "distributed.worker.memory.target": False,
                    "distributed.worker.memory.spill": False,
                    "distributed.worker.memory.pause": False,
                    "distributed.worker.memory.terminate": 0.95,
                    # The profiler samples call stacks a hundred times a second and keeps
                    # 0.1 MB of them a second for an hour.
                    "distributed.worker.profile.enabled": False,
                }
            )
        )
        get_mp_context().set_forkserver_preload(list(_PRELOADED))  # replaces dask's own list
        self._cluster = self._local_cluster(folder)
        self._stack.callback(self._close_quietly, self._cluster)
        self._client = Client(self._cluster, set_as_default=False)
        self._stack.callback(self._close_quietly, self._client)

    def _local_cluster(self, folder: str) -> LocalCluster:
        """Start worker processes on this machine; retry if one dies while it starts."""
        tries, cards = 0, {VISIBLE_CARDS: ",".join(self.cards)} if self.cards else {}
        while True:
            try:
                return LocalCluster(
                    n_workers=self.wanted,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                    local_directory=folder,
                    preload=["pbrnet.pipeline.farm.worker"],
                    # The server keeps the environment that it was started with.
                    env={**os.environ, **cards},
                )
            except (OSError, RuntimeError, TimeoutError) as error:
                tries += 1
                if tries > self.params.retries:
                    raise MachineError(
                        f"the render workers could not be started ({error})"
                    ) from error
                say(f"note: render workers did not start ({error}); trying again", err=True)

    def _refill(self) -> None:
        """Start local workers in place of those that did not come back."""
        if self._cluster is not None and len(self._cluster.workers) < self.wanted:
            self._cluster.scale(self.wanted)

    @staticmethod
    def _close_quietly(resource: Any) -> None:
        with contextlib.suppress(Exception):
            resource.close(timeout=5)


def scheduler_address(given: str | None) -> str:
    """Return the address of an external scheduler, as given or from the environment; else ""."""
    return given or os.environ.get("DASK_SCHEDULER_ADDRESS") or ""


def _kill_workers(nannies: Sequence[Nanny]) -> None:
    """Kill the worker processes that are still running."""
    for nanny in nannies:
        process = getattr(nanny, "process", None)
        if process is not None and process.pid:
            with contextlib.suppress(OSError):
                os.kill(process.pid, signal.SIGKILL)


@atexit.register
def _end_server() -> None:
    """End the server of worker processes with this process, which so accounts for its time.

    Without it, the server would end a moment later by itself.
    """
    server: Any = multiprocessing.forkserver._forkserver
    with contextlib.suppress(AttributeError, OSError, psutil.Error):  # names of CPython's own
        if server._forkserver_pid is not None:
            os.close(server._forkserver_alive_fd)  # which the server waits for
            psutil.Process(server._forkserver_pid).wait(timeout=5)


def _all_see(client: Client, file: Path) -> bool:
    try:
        client.wait_for_workers(1, timeout=CONNECT_PATIENCE)
        return all(client.run(os.path.isfile, str(file)).values())
    except Exception:  # no worker yet, or one that has just gone
        return False


@contextlib.contextmanager
def _interrupt_deferred() -> Iterator[None]:
    """Delay a Ctrl-C to the end of the block, so that a half-started cluster closes in order."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if received:
        raise KeyboardInterrupt


def _check_socket_path() -> None:
    """Raise `MachineError` if worker processes could have no socket in the temporary folder."""
    folder = tempfile.gettempdir()
    if len(os.fsencode(folder)) > _LONGEST_TEMPORARY:
        raise MachineError(
            f"the temporary folder's path is too long for worker processes: {folder!r}; "
            f"set TMPDIR to one of at most {_LONGEST_TEMPORARY} characters"
        )


def _remove_old_folders() -> None:
    """Remove the working folders of runs that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_FOLDER}*-*"):
        owner = folder.name.removeprefix(_FOLDER).split("-")[0]
        if owner.isdigit() and not psutil.pid_exists(int(owner)):
            shutil.rmtree(folder, ignore_errors=True)
