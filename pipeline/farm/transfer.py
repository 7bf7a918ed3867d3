"""How files of the command's machine reach workers that do not see them: through dask.

A worker asks by an event that the scheduler passes on to the command; the command answers with
bundles of parts (`pipeline.farm.content_store`), each sent when the one before has been taken.
Requests are answered in turns, a bundle each, by a few threads: the command never holds more than
those bundles in memory.
"""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from distributed import Client, get_worker

from scenes.errors import PbrnetError

PATIENCE = 120.0  # seconds that a worker waits for the next bundle
_THREADS = 4

Answer = Callable[[Mapping[str, Any]], Iterable[Any]]  # a request -> its bundles
_END = "end"
_ERROR = "error"
_inboxes: dict[str, queue.Queue[tuple[str, Any]]] = {}  # on workers: requests that wait


@dataclass(frozen=True)
class Supply:
    """What a command offers to its workers: by which name they ask, and who answers."""

    line: str
    answer: Answer


class Courier:
    """The command's side: answers requests until it is closed."""

    def __init__(self, client: Client, supply: Supply) -> None:
        self.client, self.supply = client, supply
        self._turns: deque[_Request | None] = deque()
        self._there = threading.Semaphore(0)
        self._threads = [
            threading.Thread(target=self._work, name="courier", daemon=True)
            for _ in range(_THREADS)
        ]
        for thread in self._threads:
            thread.start()
        client.subscribe_topic(supply.line, self._asked)

    def close(self) -> None:
        """Answer no more."""
        with contextlib.suppress(Exception):
            self.client.unsubscribe_topic(self.supply.line)
        self._turns.clear()
        for _ in self._threads:
            self._add(None)

    def _asked(self, event: tuple[float, dict[str, Any]]) -> None:
        message = event[1]
        bundles = iter(self.supply.answer(message["request"]))
        self._add(_Request(message["worker"], message["ticket"], bundles))

    def _add(self, request: _Request | None) -> None:
        self._turns.append(request)
        self._there.release()

    def _work(self) -> None:
        while True:
            self._there.acquire()
            try:
                request = self._turns.popleft()
            except IndexError:  # closed meanwhile
                continue
            if request is None:
                return
            kind, content = request.next_message()
            try:
                arrived = self.client.run(
                    _deliver, request.ticket, kind, content, workers=[request.worker]
                )
            except Exception:  # the worker or the scheduler has gone: nobody waits any more
                continue
            if kind == "" and arrived.get(request.worker):
                self._add(request)


@dataclass(frozen=True)
class _Request:
    """Somebody who waits, and what is still to be sent."""

    worker: str
    ticket: str
    bundles: Iterator[Any]

    def next_message(self) -> tuple[str, Any]:
        try:
            return "", next(self.bundles)
        except StopIteration:
            return _END, None
        except Exception as error:  # of the command's files: it is the worker who must be told
            return _ERROR, " ".join(str(error).split()) or type(error).__name__


def ask(line: str, request: Mapping[str, Any]) -> Iterator[Any]:
    """On a worker, inside a task: the bundles that the command answers with.

    `request` holds what msgpack can carry. Raises `PbrnetError` with the command's own words if
    it cannot answer, or if nothing comes for `PATIENCE` seconds.
    """
    ticket = uuid.uuid4().hex
    inbox: queue.Queue[tuple[str, Any]] = queue.Queue(1)
    _inboxes[ticket] = inbox
    try:
        worker = get_worker()
        message = {"worker": worker.address, "ticket": ticket, "request": dict(request)}
        worker.log_event(line, message)
        while True:
            try:
                kind, content = inbox.get(timeout=PATIENCE)
            except queue.Empty:
                raise PbrnetError(
                    f"the command has sent nothing for {PATIENCE:.0f} s, though it was asked for "
                    f"{dict(request).get('scene', 'files')}"
                ) from None
            if kind == _END:
                return
            if kind == _ERROR:
                raise PbrnetError(content)
            yield content
    finally:
        del _inboxes[ticket]
        with contextlib.suppress(queue.Empty):
            inbox.get_nowait()  # lets a bundle in that was waiting at the door


async def _deliver(ticket: str, kind: str, content: Any) -> bool:
    """Runs on a worker: whether somebody still waits for this; returns when it is taken in."""
    inbox = _inboxes.get(ticket)
    if inbox is None:
        return False
    await asyncio.to_thread(inbox.put, (kind, content))
    return True
