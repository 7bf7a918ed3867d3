"""What is not yet handed to a worker, and who gets which of it next."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Item:
    """A piece of work: `payload` goes to the work function; `group` names the costly state
    (an opened scene) that items share."""

    key: str
    group: str
    payload: Any


class Waiting:
    """Items not yet submitted, by group, the biggest group first.

    A worker is kept on the group it had before; a worker that has none left opens the next
    untouched group, and at the end helps with the one that has most left. Batches shrink
    towards the end so that all workers finish at about the same time.
    """

    def __init__(self, items: Sequence[Item], batch: int, window: int) -> None:
        groups: dict[str, deque[Item]] = {}
        for item in items:
            groups.setdefault(item.group, deque()).append(item)
        order = sorted(groups, key=lambda name: (-len(groups[name]), name))
        self.groups = {name: groups[name] for name in order}
        self.untouched = deque(order)
        self.batch, self.window = batch, window
        self.left = len(items)
        self.home: dict[str, str] = {}  # worker -> the group it had last

    def __bool__(self) -> bool:
        return self.left > 0

    def take(self, worker: str, workers: int) -> tuple[Item, ...]:
        """The next batch for `worker`, one of `workers`; empty when nothing is left."""
        if not self.left:
            return ()
        group = self.home.get(worker, "")
        if not self.groups.get(group):
            while self.untouched and not self.groups[self.untouched[0]]:
                self.untouched.popleft()
            if self.untouched:
                group = self.untouched.popleft()
            else:
                group = max(self.groups, key=lambda name: len(self.groups[name]))
            self.home[worker] = group
        fair = -(-self.left // (self.window * max(1, workers)))
        size = min(self.batch, fair, len(self.groups[group]))
        self.left -= size
        return tuple(self.groups[group].popleft() for _ in range(size))
