"""Transfer of files through dask to workers that do not see the command's data folder.

A worker sends a request as an event, which the scheduler passes on to the command. The command
answers with bundles of chunks (`pbrnet.pipeline.farm.content_store`) and sends each bundle when the
previous one has been taken. A few threads serve all requests in turn, one bundle at a time: the
command never holds more than those bundles in memory.
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

from pbrnet.scenes.errors import PbrnetError, in_one_line

PATIENCE = 120.0  # seconds that a worker waits for the next bundle
_THREADS = 4

Answer = Callable[[Mapping[str, Any]], Iterable[Any]]  # a request -> its bundles
_END = "end"
_ERROR = "error"
_inboxes: dict[str, queue.Queue[tuple[str, Any]]] = {}  # on workers: open requests by id


@dataclass(frozen=True)
class TransferService:
    """Topic of the workers' requests and the function that answers them."""

    topic: str
    answer: Answer


class TransferServer:
    """The command's side of the transfer: answers requests until it is closed."""

    def __init__(self, client: Client, service: TransferService) -> None:
        self.client, self.service = client, service
        self._queue: deque[_Request | None] = deque()
        self._available = threading.Semaphore(0)
        self._threads = [
            threading.Thread(target=self._serve, name="transfer", daemon=True)
            for _ in range(_THREADS)
        ]
        for thread in self._threads:
            thread.start()
        client.subscribe_topic(service.topic, self._on_request)

    def close(self) -> None:
        """Stop answering requests."""
        with contextlib.suppress(Exception):
            self.client.unsubscribe_topic(self.service.topic)
        self._queue.clear()
        for _ in self._threads:
            self._add(None)

    def _on_request(self, event: tuple[float, dict[str, Any]]) -> None:
        message = event[1]
        bundles = iter(self.service.answer(message["request"]))
        self._add(_Request(message["worker"], message["id"], bundles))

    def _add(self, request: _Request | None) -> None:
        self._queue.append(request)
        self._available.release()

    def _serve(self) -> None:
        while True:
            self._available.acquire()
            try:
                request = self._queue.popleft()
            except IndexError:  # closed meanwhile
                continue
            if request is None:
                return
            kind, content = request.next_message()
            try:
                arrived = self.client.run(
                    _deliver, request.id, kind, content, workers=[request.worker]
                )
            except Exception:  # the worker or the scheduler has gone: nobody waits any more
                continue
            if kind == "" and arrived.get(request.worker):
                self._add(request)


@dataclass(frozen=True)
class _Request:
    """A worker's open request and the bundles that are still to be sent."""

    worker: str
    id: str
    bundles: Iterator[Any]

    def next_message(self) -> tuple[str, Any]:
        try:
            return "", next(self.bundles)
        except StopIteration:
            return _END, None
        except Exception as error:  # reading the command's files failed: the worker reports it
            return _ERROR, in_one_line(error)


def request_bundles(topic: str, request: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the bundles with which the command answers a request; call it on a worker, in a task.

    `request` holds what msgpack can carry. Raises `PbrnetError` with the command's message if it
    cannot answer, or if nothing arrives for `PATIENCE` seconds.
    """
    request_id = uuid.uuid4().hex
    inbox: queue.Queue[tuple[str, Any]] = queue.Queue(1)
    _inboxes[request_id] = inbox
    try:
        worker = get_worker()
        message = {"worker": worker.address, "id": request_id, "request": dict(request)}
        worker.log_event(topic, message)
        while True:
            try:
                kind, content = inbox.get(timeout=PATIENCE)
            except queue.Empty:
                raise PbrnetError(
                    f"a worker requested {dict(request).get('scene', 'files')} and the command "
                    f"sent nothing for {PATIENCE:.0f} s; run the same command again to resume"
                ) from None
            if kind == _END:
                return
            if kind == _ERROR:
                raise PbrnetError(content)
            yield content
    finally:
        del _inboxes[request_id]
        with contextlib.suppress(queue.Empty):
            inbox.get_nowait()  # unblocks a delivery that waits for room in the inbox


async def _deliver(request_id: str, kind: str, content: Any) -> bool:
    """Put a message into a request's inbox, on the worker; False if the request is closed."""
    inbox = _inboxes.get(request_id)
    if inbox is None:
        return False
    await asyncio.to_thread(inbox.put, (kind, content))
    return True
