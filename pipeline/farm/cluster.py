"""The farm: work spread over dask workers, results as they come. It and its courier know dask.

Whose workers: `--scheduler`, then `DASK_SCHEDULER_ADDRESS`, then a cluster of our own on this
machine, one process per allowed CPU. Workers that share the data folder hand back paths and
figures; others are sent what they need (`pipeline.farm.transfer`) and hand back the files they
made.

What may go wrong, and what becomes of it:

* an item raises: tried again `retries` times by itself, then reported as a failure;
* an item takes longer than `time_limit`: its worker ends itself, as if it had died;
* a worker has done many scenes or grown: a fresh process takes its place
  (`pipeline.farm.recycling`);
* a worker dies: dask gives its batches to another; a batch that keeps killing its workers is
  taken apart and its items run one at a time with nothing beside them, so that only the guilty
  one is reported;
* the machine lacks something (`MachineError`: a full disk, a missing library): everything stops;
* the scheduler goes away: `MachineError`, and the same command goes on where this run stopped.
"""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import multiprocessing
import os
import queue
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import dask
import psutil
from dask.system import cpu_count
from distributed import Client, Future, KilledWorker, LocalCluster, Nanny
from distributed.comm import CommClosedError
from distributed.utils import silence_logging_cmgr

from pipeline.farm.recycling import replace_if_worn
from pipeline.farm.scheduling import Item, Waiting
from pipeline.farm.transfer import Courier, Supply
from pipeline.params import FarmParams
from scenes.errors import MachineError

CONNECT_PATIENCE = 15.0  # seconds to look for a scheduler
WORKER_PATIENCE = 300.0  # seconds without a single worker before the farm gives up
_FETCH = 10.0  # seconds for finished outcomes to arrive
_LOST = "60s"  # that a worker of our own may take to come back, on a busy machine
_GO_ON = "run the same command again to go on where this run stopped"
_FOLDER = "pbrnet-farm-"
_CARRIED = 32 << 20  # bytes of files that a batch hands back; with more it ends before its time
_rendering = threading.Lock()  # one batch at a time per process: Dr.Jit's state is the process's


@dataclass(frozen=True)
class Outcome:
    """What became of an item: `value` from the work function, or `error` in words."""

    key: str
    value: Any = None
    error: str = ""
    fatal: bool = False
    seconds: float = 0.0
    worker: str = ""
    attempt: int = 1
    ended: datetime | None = None  # by the worker's clock


class Farm:
    """A context manager: workers are there inside it and gone after it.

    `setup` runs on a worker before each batch and must be quick when repeated; it is given the
    number of threads that the worker may use (0: its own choice). It and the work function must
    be importable by name. `supply` is what workers may ask for while they work. If `needed`, a
    file, is not seen by all workers of a scheduler, workers of our own do the work instead.
    """

    def __init__(
        self,
        params: FarmParams,
        scheduler: str | None,
        setup: Callable[[int], None],
        items: int,
        supply: Supply | None = None,
        needed: Path | None = None,
    ) -> None:
        self.params, self.setup, self.supply, self.needed = params, setup, supply, needed
        self.address = scheduler or os.environ.get("DASK_SCHEDULER_ADDRESS") or ""
        self.wanted = min(params.workers or cpu_count(), max(1, items))
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
        # Interrupted work is worth nothing: do not wait for it to end.
        if kind is not None:
            for nanny in nannies:
                nanny.close_gracefully()  # which means: start no other worker
            _kill_workers(nannies)
        self._stack.close()
        _kill_workers(nannies)  # a busy machine may have been too slow to end them in time

    def run(self, work: Callable[[Any], Any], items: Sequence[Item]) -> Iterator[Outcome]:
        """Yield exactly one final outcome per item, in order of completion.

        Raises `MachineError` when the scheduler or all workers are gone, or a worker's machine
        lacks what any item would need.
        """
        yield from _Run(self, self._client, work, items).outcomes()

    @property
    def threads(self) -> int:
        """That each worker may use; 0: its own choice."""
        return 0 if self.address else max(1, cpu_count() // self.wanted)

    def _start(self) -> None:
        if self.address:
            self._connect()
        if not self.address:
            self._start_own()
        if self.supply:
            courier = Courier(self._client, self.supply)
            self._stack.callback(courier.close)

    def _connect(self) -> None:
        """Use the scheduler at the address; forget it if its workers do not see what is needed."""
        try:
            client = Client(self.address, timeout=CONNECT_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise MachineError(
                f"no dask scheduler answers at {self.address!r} ({error}); start one with "
                "'dask scheduler', or unset DASK_SCHEDULER_ADDRESS to use this machine alone"
            ) from None
        if self.needed and not _all_see(client, self.needed):
            print(
                f"note: the workers at {self.address} do not see {self.needed.parent}, which this "
                "stage needs: it is done by workers of this machine",
                file=sys.stderr,
            )
            self._close_quietly(client)
            self.address = ""
            return
        # What the farm has to say of a scheduler that goes, it says itself.
        self._stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        self._client = client
        self._stack.callback(self._close_quietly, client)

    def _start_own(self) -> None:
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
                    # A renderer's memory is native: it cannot be spilled, and pausing would be
                    # for ever. The nanny ends a worker that outgrows its share.
                    "distributed.worker.memory.target": False,
                    "distributed.worker.memory.spill": False,
                    "distributed.worker.memory.pause": False,
                    "distributed.worker.memory.terminate": 0.95,
                    # It keeps 0.1 MB of call stacks a second for an hour, and looks at them
                    # a hundred times a second.
                    "distributed.worker.profile.enabled": False,
                }
            )
        )
        self._cluster = self._cluster_of_own(folder)
        self._stack.callback(self._close_quietly, self._cluster)
        self._client = Client(self._cluster, set_as_default=False)
        self._stack.callback(self._close_quietly, self._client)

    def _cluster_of_own(self, folder: str) -> LocalCluster:
        """Worker processes of this machine; one may die while it starts, as it may later."""
        tries = 0
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
                    preload=["pipeline.farm.cluster"],
                )
            except (OSError, RuntimeError, TimeoutError) as error:
                tries += 1
                if tries > self.params.retries:
                    raise MachineError(
                        f"the render workers could not be started ({error})"
                    ) from error
                print(f"note: render workers did not start ({error}): once more", file=sys.stderr)

    def refill(self) -> None:
        """Start anew those of our own workers that did not come back."""
        if self._cluster is not None and len(self._cluster.workers) < self.wanted:
            self._cluster.scale(self.wanted)

    @staticmethod
    def _close_quietly(thing: Any) -> None:
        with contextlib.suppress(Exception):
            thing.close(timeout=5)


def _kill_workers(nannies: Sequence[Nanny]) -> None:
    """End the worker processes that are still there."""
    for nanny in nannies:
        process = getattr(nanny, "process", None)
        if process is not None and process.pid:
            with contextlib.suppress(OSError):
                os.kill(process.pid, signal.SIGKILL)


def _all_see(client: Client, file: Path) -> bool:
    try:
        client.wait_for_workers(1, timeout=CONNECT_PATIENCE)
        return all(client.run(os.path.isfile, str(file)).values())
    except Exception:  # no worker yet, or one that has just gone
        return False


class _Run:
    """One pass over a list of items: what is waiting, in flight and under suspicion."""

    def __init__(
        self, farm: Farm, client: Client, work: Callable[[Any], Any], items: Sequence[Item]
    ) -> None:
        self.farm, self.client, self.work = farm, client, work
        self.attempts = {item.key: 0 for item in items}
        if len(self.attempts) != len(items):
            raise ValueError("two items have the same key")
        self.waiting = Waiting(items, farm.params.batch, farm.params.window)
        self.again: deque[Item] = deque()  # failed once or more: each by itself
        self.suspects: deque[Item] = deque()  # were on workers that died: run alone, at the end
        self.alone = ""  # the suspect now in flight with nothing beside it
        self.alone_since = 0.0
        self.flight: dict[Future, tuple[tuple[Item, ...], str]] = {}
        self.done: queue.Queue[Future] = queue.Queue()
        self.name = f"pbrnet-{uuid.uuid4().hex[:12]}"  # a shared scheduler sees other runs' keys
        self.submitted = 0
        self.last_worker_seen = time.monotonic()

    def outcomes(self) -> Iterator[Outcome]:
        try:
            while True:
                self.feed()
                if not self.flight and not (self.waiting or self.again or self.suspects):
                    return
                future = self.next_done()
                if future is not None and future in self.flight:
                    yield from self.settle(future)
        finally:
            with contextlib.suppress(Exception):
                if self.farm.address and self.flight and self.client.status == "running":
                    self.client.cancel(list(self.flight))

    def feed(self) -> None:
        """Keep every worker's window full; suspects wait until the farm is empty.

        Which worker runs a batch is dask's choice: it takes the least busy one, which is nearly
        always the one whose window had room, as long as the workers are fed in turn. (Tying
        batches to workers, even loosely, leaves them waiting for ever if all workers die at
        once.)
        """
        workers = self.workers()
        load = dict.fromkeys(workers, 0)
        for _, worker in self.flight.values():
            if worker in load:
                load[worker] += 1
        while workers:
            worker = min(workers, key=lambda name: (load[name], name))
            if load[worker] >= self.farm.params.window:
                break
            batch = self.waiting.take(worker, len(workers))
            if not batch and self.again:
                batch = (self.again.popleft(),)
            if not batch:
                break
            self.submit(batch, worker)
            load[worker] += 1
        if workers and not self.flight and self.suspects:
            suspect = self.suspects.popleft()
            self.alone, self.alone_since = suspect.key, time.monotonic()
            self.submit((suspect,), workers[0])

    def submit(self, batch: tuple[Item, ...], worker: str) -> None:
        self.submitted += 1
        attempts = []
        for item in batch:
            self.attempts[item.key] += 1
            attempts.append(self.attempts[item.key])
        future = self.client.submit(
            _work_batch,
            self.farm.setup,
            self.farm.threads,
            self.farm.params.time_limit,
            self.farm.params.recycle,
            self.work,
            batch,
            attempts,
            key=f"{self.name}-{self.submitted}",
            pure=False,
        )
        self.flight[future] = (batch, worker)
        future.add_done_callback(self.done.put)

    def next_done(self) -> Future | None:
        """The next finished batch, or None after a second; notices when the farm is gone."""
        if self.client.status not in ("running", "newly-created"):
            raise MachineError(f"the dask scheduler has gone; {_GO_ON}")
        if time.monotonic() - self.last_worker_seen > WORKER_PATIENCE:
            advice = "start one with 'dask worker ADDRESS', then " if self.farm.address else ""
            raise MachineError(
                f"no dask worker has been there for {WORKER_PATIENCE:.0f} s; {advice}{_GO_ON}"
            )
        try:
            return self.done.get(timeout=1)
        except queue.Empty:  # dask calls back once only: not when it runs a lost batch again
            return next((future for future in self.flight if future.done()), None)

    def settle(self, future: Future) -> Iterator[Outcome]:
        """Yield what is final of a finished batch and put the rest back in line."""
        if not future.done():
            return  # its worker died with the outcomes: dask runs it again
        batch, worker = self.flight.pop(future)
        alone, self.alone = self.alone, ""
        try:
            outcomes = future.result(timeout=_FETCH)
        except TimeoutError:  # died just now, on the way here
            self.flight[future], self.alone = (batch, worker), alone
            return
        except KilledWorker:
            if batch[0].key == alone:
                yield Outcome(
                    key=batch[0].key,
                    error=self.cause_of_death(),
                    worker=worker,
                    attempt=self.attempts[batch[0].key],
                )
            else:
                self.suspects.extend(batch)
            return
        except (CancelledError, CommClosedError):
            raise MachineError(f"the dask scheduler has gone; {_GO_ON}") from None
        except Exception as error:
            reason = " ".join(str(error).split())
            raise MachineError(
                f"the dask scheduler or a worker cannot run our work ({reason}); both need "
                "the same version of pbrnet as this command"
            ) from error
        by_key = {item.key: item for item in batch}
        for key in by_key.keys() - {outcome.key for outcome in outcomes}:
            if not any(outcome.fatal for outcome in outcomes):  # the batch ended before its time
                self.attempts[key] -= 1
                self.again.append(by_key[key])
        for outcome in outcomes:
            if outcome.fatal:
                raise MachineError(outcome.error)
            if outcome.error and outcome.attempt <= self.farm.params.retries:
                self.again.append(by_key[outcome.key])
            else:
                yield outcome

    def cause_of_death(self) -> str:
        """What became of the suspect that has just been run alone and ended its workers."""
        limit, tries = self.farm.params.time_limit, self.farm.params.retries + 1
        if limit and time.monotonic() - self.alone_since >= tries * limit:
            return f"it ran longer than farm.time_limit allows ({limit} s) and was ended each time"
        return "its worker process died each time (out of memory, or a crash)"

    def workers(self) -> list[str]:
        self.farm.refill()
        names = sorted(self.client.scheduler_info()["workers"])
        if names:
            self.last_worker_seen = time.monotonic()
        return names


@contextlib.contextmanager
def _interrupt_deferred() -> Iterator[None]:
    """Let a Ctrl-C wait until a cluster that is half started can be closed in order."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def dask_setup(worker: Any) -> None:
    """Dask calls this in each of our own workers as it starts."""
    _leave_terminal()


def _leave_terminal() -> None:
    """Keep a terminal's Ctrl-C from this worker; its nanny, or our main process, ends it.

    While Mitsuba renders it takes SIGINT for itself and returns early with an image that looks
    finished: such a frame must never be written.
    """
    if multiprocessing.parent_process() is not None and os.getpgid(0) != os.getpid():
        with contextlib.suppress(OSError):
            os.setpgid(0, 0)


def _remove_old_folders() -> None:
    """Remove the working folders of runs that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_FOLDER}*-*"):
        owner = folder.name.removeprefix(_FOLDER).split("-")[0]
        if owner.isdigit() and not psutil.pid_exists(int(owner)):
            shutil.rmtree(folder, ignore_errors=True)


def _work_batch(
    setup: Callable[[int], None],
    threads: int,
    time_limit: int,
    recycle: int,
    work: Callable[[Any], Any],
    batch: tuple[Item, ...],
    attempts: list[int],
) -> list[Outcome]:
    """Runs on a worker: the outcomes of the items, up to the first that no other could survive,
    or until there is much to hand back."""
    carried = 0
    worker = f"{os.uname().nodename}:{os.getpid()}"
    outcomes = []
    _leave_terminal()
    with _rendering:
        replace_if_worn(batch[0].group, recycle)
        for item, attempt in zip(batch, attempts, strict=True):
            started = time.perf_counter()
            value, words, fatal = None, "", False
            try:
                with _time_limit(time_limit):
                    setup(threads)
                    value = work(item.payload)
            except MachineError as error:
                words, fatal = str(error), True
            except Exception as error:
                words = _words(error)
            seconds = time.perf_counter() - started
            ended = datetime.now(UTC)
            outcomes.append(Outcome(item.key, value, words, fatal, seconds, worker, attempt, ended))
            files = value.get("files", {}) if isinstance(value, dict) else {}
            carried += sum(len(file.content) for file in files.values())
            if fatal or carried > _CARRIED:
                break
    return outcomes


@contextlib.contextmanager
def _time_limit(seconds: int) -> Iterator[None]:
    """End this process if the block takes longer (0: never).

    By the interpreter's own watchdog, which is no Python thread: an endless kernel in native code
    may hold the interpreter's lock.
    """
    if not seconds:
        yield
        return
    with Path(os.devnull).open("w") as nowhere:  # the traceback would say nothing of the kernel
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _words(error: Exception) -> str:
    """An error in one line, with the place it came from unless it was meant for the reader."""
    text = " ".join(str(error).split()) or type(error).__name__
    frames = traceback.extract_tb(error.__traceback__)
    if hasattr(error, "exit_code") or not frames:
        return text
    return f"{type(error).__name__}: {text} (in {frames[-1].name}, line {frames[-1].lineno})"
