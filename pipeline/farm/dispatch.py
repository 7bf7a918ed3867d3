"""Dispatch of items to dask workers: batches in flight, retries and isolation of crashing items.

A worker ends itself when an item takes too long (`pbrnet.pipeline.farm.worker`). A process that is
stopped, or whose machine swaps, cannot. Its heartbeats to the scheduler stop too: such a worker is
found by its silence, and replaced.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from typing import Any

from distributed import Client, Future, KilledWorker
from distributed.comm import CommClosedError

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.worker import Item, Outcome, run_batch
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.errors import MachineError, in_one_line

WORKER_PATIENCE = 300.0  # seconds without a single worker before the run is given up
FIRST_PATIENCE = 60.0  # the same for an external scheduler that has had none in this run
_NOTE_AFTER = 5.0  # seconds until a missing first worker is mentioned
_FETCH = 10.0  # seconds for finished outcomes to arrive
_RESUME = "run the same command again to resume"
GRACE = 20.0  # seconds of silence beyond an item's time limit
_RESTART = 10.0  # seconds for a nanny to kill its worker


class BatchQueue:
    """Items that are not submitted yet: the heaviest group first, its longest items first.

    Phases come one after the other within a group.

    A worker stays on its last group; once that is empty it opens the next group that no worker
    has opened, and at the end it helps with the heaviest one left. Batches shrink towards the end
    so that all workers finish at about the same time.
    """

    def __init__(self, items: Sequence[Item], batch: int, window: int) -> None:
        self.batch, self.window = batch, window
        self.groups: dict[str, deque[Item]] = {}
        self.weight: dict[str, float] = {}
        self.unopened: deque[str] = deque()
        self.last_group: dict[str, str] = {}  # by worker
        self.total_weight, self.count = 0.0, 0
        self.add(items)

    def __bool__(self) -> bool:
        return self.count > 0

    def add(self, items: Sequence[Item]) -> None:
        """Add items; a worker that is on their group goes on with them."""
        known, added = set(self.groups), dict[str, list[Item]]()
        for item in items:
            added.setdefault(item.group, []).append(item)
        for name, group in added.items():
            waiting = [*self.groups.get(name, ()), *group]
            # A stable sort: items of equal weight stay in the order given.
            self.groups[name] = deque(sorted(waiting, key=lambda one: (one.phase, -one.weight)))
            self.weight[name] = sum(item.weight for item in waiting)
            self.total_weight += sum(item.weight for item in group)
        self.count += len(items)
        new = added.keys() - known
        self.unopened.extend(sorted(new, key=lambda name: (-self.weight[name], name)))

    def take(self, worker: str, workers: int) -> tuple[Item, ...]:
        """Remove and return the next batch for `worker`, one of `workers`; () if none is left."""
        if not self.count:
            return ()
        group = self.last_group.get(worker, "")
        if not self.groups.get(group):
            while self.unopened and not self.groups[self.unopened[0]]:
                self.unopened.popleft()
            if self.unopened:
                group = self.unopened.popleft()
            else:
                group = max(self.groups, key=lambda name: self.weight[name])
            self.last_group[worker] = group
        fair = self.total_weight / (self.window * max(1, workers))
        batch = [self._pop(group)]
        load = batch[0].weight
        while self.groups[group] and len(batch) < self.batch:
            load += self.groups[group][0].weight
            if load > fair * (1 + 1e-9) or self.groups[group][0].phase != batch[0].phase:
                break
            batch.append(self._pop(group))
        return tuple(batch)

    def _pop(self, group: str) -> Item:
        item = self.groups[group].popleft()
        self.total_weight -= item.weight
        self.count -= 1
        # An empty group must never be the heaviest, whatever rounding leaves of its weight.
        self.weight[group] = self.weight[group] - item.weight if self.groups[group] else -1.0
        return item


class Dispatch:
    """One pass over a list of items on a dask client.

    `setup` runs on a worker before each item with the number of `threads` it may use; `refill`
    starts lost workers again; `external` says that other runs may use the same scheduler.
    `finished` is called with the key and the seconds of each item that a worker has finished, from
    another thread and before the outcome of its batch arrives.
    """

    def __init__(
        self,
        client: Client,
        params: FarmParams,
        setup: Callable[[int], None],
        threads: int,
        work: Callable[[Any], Any],
        items: Sequence[Item],
        refill: Callable[[], None],
        external: bool,
        finished: Callable[[str, float], None] | None = None,
    ) -> None:
        self.client, self.params, self.setup, self.threads = client, params, setup, threads
        self.work, self.refill, self.external = work, refill, external
        self.finished = finished
        self.attempts: dict[str, int] = {}
        self.queue = BatchQueue([], params.batch, params.window)
        self.add(items)
        self.retries: deque[Item] = deque()  # failed before: a batch of its own for each
        self.suspects: deque[Item] = deque()  # were on workers that died: run in isolation, last
        self.isolated = ""  # key of the suspect that is now the only item in flight
        self.isolated_since = 0.0
        self.flight: dict[Future, tuple[tuple[Item, ...], str]] = {}
        self.done: queue.Queue[Future] = queue.Queue()
        self.name = f"pbrnet-{uuid.uuid4().hex[:12]}"  # a shared scheduler sees other runs' keys
        self.submitted = 0
        self.last_worker_seen = time.monotonic()
        self.had_worker = self.noted = False
        self.liveness = Liveness()

    def add(self, items: Sequence[Item]) -> None:
        """Add items to the work, also between two outcomes."""
        for item in items:
            if item.key in self.attempts:
                raise ValueError("two items have the same key")
            self.attempts[item.key] = 0
        self.queue.add(items)

    def outcomes(self) -> Iterator[Outcome]:
        """Yield one final outcome per item, in order of completion.

        Raises `MachineError` when the scheduler or all workers are gone, or an item reports that
        its worker's machine cannot do the work.
        """
        if self.finished is not None:
            finished = self.finished
            self.client.subscribe_topic(self.name, lambda event: finished(*event[1]))
        try:
            while True:
                self.fill_windows()
                if not self.flight and not (self.queue or self.retries or self.suspects):
                    return
                future = self.next_done()
                if future is not None and future in self.flight:
                    yield from self.collect(future)
        finally:
            with contextlib.suppress(Exception):
                self.client.unsubscribe_topic(self.name)
            with contextlib.suppress(Exception):
                if self.external and self.flight and self.client.status == "running":
                    self.client.cancel(list(self.flight))

    def fill_windows(self) -> None:
        """Submit batches until every worker's window is full; suspects wait for an empty farm.

        dask chooses the worker of a batch: the least busy one, which is nearly always the one
        whose window had room, as long as the workers are served in turn. (A batch that is tied to
        a worker, even loosely, waits for ever if all workers die at once.)
        """
        workers = self.workers()
        load = dict.fromkeys(workers, 0)
        for _, worker in self.flight.values():
            if worker in load:
                load[worker] += 1
        while workers:
            worker = min(workers, key=lambda name: (load[name], name))
            if load[worker] >= self.params.window:
                break
            batch = self.queue.take(worker, len(workers))
            if not batch and self.retries:
                batch = (self.retries.popleft(),)
            if not batch:
                break
            self.submit(batch, worker)
            load[worker] += 1
        if workers and not self.flight and self.suspects:
            suspect = self.suspects.popleft()
            self.isolated, self.isolated_since = suspect.key, time.monotonic()
            self.submit((suspect,), workers[0])

    def submit(self, batch: tuple[Item, ...], worker: str) -> None:
        """Submit a batch; `worker` is the one whose window it counts against."""
        self.submitted += 1
        attempts = []
        for item in batch:
            self.attempts[item.key] += 1
            attempts.append(self.attempts[item.key])
        future = self.client.submit(
            run_batch,
            self.setup,
            self.threads,
            self.params.time_limit,
            self.params.recycle,
            self.work,
            batch,
            attempts,
            self.name,
            key=f"{self.name}-{self.submitted}",
            pure=False,
        )
        self.flight[future] = (batch, worker)
        future.add_done_callback(self.done.put)

    def next_done(self) -> Future | None:
        """Return the next finished batch, or None after a second without one.

        Raises `MachineError` when the scheduler or all workers are gone.
        """
        if self.client.status not in ("running", "newly-created"):
            raise MachineError(f"the dask scheduler has gone; {_RESUME}")
        self.check_for_workers()
        try:
            return self.done.get(timeout=1)
        except queue.Empty:  # dask calls back once only: not when it runs a lost batch again
            return next((future for future in self.flight if future.done()), None)

    def check_for_workers(self) -> None:
        """Raise `MachineError` after too long a time without any worker."""
        alone = time.monotonic() - self.last_worker_seen
        if self.external and not self.had_worker:
            missing = (
                f"the dask scheduler at {self.client.scheduler.address} has no worker (workers end "
                "with their scheduler); start one with: dask worker "
                f"{self.client.scheduler.address}"
            )
            if alone > FIRST_PATIENCE:
                raise MachineError(f"{missing}; then {_RESUME}")
            if alone > _NOTE_AFTER and not self.noted:
                self.noted = True
                say(f"note: {missing}; waiting {FIRST_PATIENCE:.0f} s", err=True)
        elif alone > WORKER_PATIENCE:
            advice = "start one with 'dask worker ADDRESS', then " if self.external else ""
            raise MachineError(f"no dask worker for {WORKER_PATIENCE:.0f} s; {advice}{_RESUME}")

    def collect(self, future: Future) -> Iterator[Outcome]:
        """Yield the final outcomes of a finished batch and queue its other items again."""
        if not future.done():
            return  # its worker died with the outcomes: dask runs it again
        batch, worker = self.flight.pop(future)
        isolated, self.isolated = self.isolated, ""
        try:
            outcomes = future.result(timeout=_FETCH)
        except TimeoutError:  # its worker died while the outcomes were fetched
            self.flight[future], self.isolated = (batch, worker), isolated
            return
        except KilledWorker:
            if batch[0].key == isolated:
                yield Outcome(
                    key=batch[0].key,
                    error=self.worker_loss_reason(),
                    worker=worker,
                    attempt=self.attempts[batch[0].key],
                )
            else:
                self.suspects.extend(batch)
            return
        except (CancelledError, CommClosedError):
            raise MachineError(f"the dask scheduler has gone; {_RESUME}") from None
        except Exception as error:
            reason = in_one_line(error)
            raise MachineError(
                f"the dask scheduler or a worker cannot run the work function ({reason}); both "
                "need the same version of pbrnet as this command"
            ) from error
        by_key = {item.key: item for item in batch}
        for key in by_key.keys() - {outcome.key for outcome in outcomes}:
            if not any(outcome.fatal for outcome in outcomes):  # the batch ended early
                self.attempts[key] -= 1
                self.retries.append(by_key[key])
        for outcome in outcomes:
            if outcome.fatal:
                raise MachineError(outcome.error)
            if outcome.error and outcome.attempt <= self.params.retries:
                self.retries.append(by_key[outcome.key])
            else:
                yield outcome

    def worker_loss_reason(self) -> str:
        """Return why the isolated item ended its workers, as an error message."""
        limit, tries = self.params.time_limit, self.params.retries + 1
        if limit and time.monotonic() - self.isolated_since >= tries * limit:
            return f"it ran longer than farm.time_limit allows ({limit} s) in every attempt"
        return "its worker process died each time (out of memory, or a crash)"

    def workers(self) -> list[str]:
        """Return the sorted addresses of the workers, after starting lost ones again."""
        self.refill()
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        if workers:
            self.last_worker_seen, self.had_worker = time.monotonic(), True
        frozen = self.frozen(workers)
        if frozen:
            restart_workers(self.client, frozen)
        return sorted(set(workers) - set(frozen))

    def frozen(self, workers: dict[str, Any]) -> list[str]:
        """Return the workers that have been silent for longer than an item may take."""
        limit = self.params.time_limit
        return self.liveness.silent(workers, limit + GRACE) if limit else []


class Liveness:
    """Silence of each worker: seconds since its heartbeat last changed, by this process's clock.

    Clocks of other machines do not matter: `last_seen` values are only compared for equality.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[str, tuple[float, float]] = {}  # address: last heartbeat, when it changed

    def silent(self, workers: Mapping[str, Mapping[str, Any]], limit: float) -> list[str]:
        """Return the sorted addresses of workers whose silence exceeds `limit` seconds.

        `workers` are those of dask's scheduler information.
        """
        now = self._clock()
        for address, facts in workers.items():
            heartbeat = float(facts["last_seen"])
            if self._seen.get(address, (None, 0.0))[0] != heartbeat:
                self._seen[address] = (heartbeat, now)
        self._seen = {address: self._seen[address] for address in workers}
        return sorted(one for one, (_, since) in self._seen.items() if now - since > limit)


def restart_workers(client: Client, addresses: Collection[str]) -> None:
    """Let the scheduler replace workers: their nannies kill them and start fresh processes.

    A worker without a nanny is removed. Its items, too, run again on other workers.
    """
    with contextlib.suppress(Exception):  # the scheduler may have gone: the dispatch reports that
        client.sync(
            client.scheduler.restart_workers,
            workers=list(addresses),
            timeout=_RESTART,
            wait_for_workers=False,
            on_error="return",
            stimulus_id="pbrnet-frozen-worker",
        )
