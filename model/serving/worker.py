"""Hand-over of shots from the server's threads to the one thread that renders."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

from pbrnet.model.serving.gallery import Shot, Shown

# Seconds after which a waiting main thread looks for signals: native code may leave handlers in a
# state in which a signal does not interrupt a wait.
_WAKE = 0.5
Waiting = tuple[Shot, "Future[Shown]"]


class Superseded(Exception):
    """A newer shot took the place of one that was waiting, or the server ends."""


class NewestFirst:
    """Queue of one shot: the newest waits while another is drawn, older ones are dropped."""

    def __init__(self, draw: Callable[[Shot], Shown]) -> None:
        self._draw = draw
        self._waiting: Waiting | None = None
        self._changed, self._ended = threading.Condition(), False

    def ask(self, shot: Shot) -> Shown:
        """Wait for the picture of a shot; raises `Superseded`, or what drawing raises."""
        future: Future[Shown] = Future()
        with self._changed:
            self._drop()
            if self._ended:
                raise Superseded
            self._waiting = shot, future
            self._changed.notify()
        return future.result()

    def run(self) -> None:
        """Draw what is asked for, in the calling thread, until `end`."""
        while True:
            with self._changed:
                while not (self._waiting or self._ended):
                    self._changed.wait(_WAKE)
                if self._waiting is None or self._ended:
                    self._drop()
                    return
                (shot, future), self._waiting = self._waiting, None
            try:
                future.set_result(self._draw(shot))
            except Exception as error:
                future.set_exception(error)

    def end(self) -> None:
        """Let `run` return, after the picture in progress; a signal's handler may call it."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _drop(self) -> None:
        if self._waiting is not None:
            self._waiting[1].set_exception(Superseded())
            self._waiting = None
