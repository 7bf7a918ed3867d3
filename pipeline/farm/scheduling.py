"""What is not yet handed to a worker, and who gets which of it next."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Item:
    """A piece of work: `payload` goes to the work function; `group` names the costly state
    (an opened scene) that items share; `weight` is how long it may take, in any unit."""

    key: str
    group: str
    payload: Any
    weight: float = 1.0


class Waiting:
    """Items not yet submitted, by group: the group with most to do first, its longest items first.

    A worker is kept on the group it had before; a worker that has none left opens the next
    untouched group, and at the end helps with the one that has most left. Batches shrink
    towards the end so that all workers finish at about the same time.
    """

    def __init__(self, items: Sequence[Item], batch: int, window: int) -> None:
        groups: dict[str, list[Item]] = {}
        for item in items:
            groups.setdefault(item.group, []).append(item)
        self.weight = {name: sum(item.weight for item in group) for name, group in groups.items()}
        order = sorted(groups, key=lambda name: (-self.weight[name], name))
        # A stable sort: items as long as each other stay in the order given.
        self.groups = {
            name: deque(sorted(groups[name], key=lambda item: -item.weight)) for name in order
        }
        self.untouched = deque(order)
        self.batch, self.window = batch, window
        self.left = sum(self.weight.values())
        self.count = len(items)
        self.home: dict[str, str] = {}  # worker -> the group it had last

    def __bool__(self) -> bool:
        return self.count > 0

    def take(self, worker: str, workers: int) -> tuple[Item, ...]:
        """The next batch for `worker`, one of `workers`; empty when nothing is left."""
        if not self.count:
            return ()
        group = self.home.get(worker, "")
        if not self.groups.get(group):
            while self.untouched and not self.groups[self.untouched[0]]:
                self.untouched.popleft()
            if self.untouched:
                group = self.untouched.popleft()
            else:
                group = max(self.groups, key=lambda name: self.weight[name])
            self.home[worker] = group
        fair = self.left / (self.window * max(1, workers))
        batch = [self._pop(group)]
        load = batch[0].weight
        while self.groups[group] and len(batch) < self.batch:
            load += self.groups[group][0].weight
            if load > fair * (1 + 1e-9):
                break
            batch.append(self._pop(group))
        return tuple(batch)

    def _pop(self, group: str) -> Item:
        item = self.groups[group].popleft()
        self.left -= item.weight
        self.count -= 1
        # A group that is done weighs nothing, whatever rounding has left of it.
        self.weight[group] = self.weight[group] - item.weight if self.groups[group] else -1.0
        return item
