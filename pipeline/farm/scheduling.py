"""Order of the items and size of the batches that each worker is given."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Item:
    """A unit of work.

    `payload` is the argument of the work function; `group` names the costly state (an opened
    scene) that items share; `weight` is the expected duration, in any unit.
    """

    key: str
    group: str
    payload: Any
    weight: float = 1.0


class BatchQueue:
    """Items that are not submitted yet: the heaviest group first, its longest items first.

    A worker stays on its last group; once that is empty it opens the next group that no worker
    has opened, and at the end it helps with the heaviest one left. Batches shrink towards the end
    so that all workers finish at about the same time.
    """

    def __init__(self, items: Sequence[Item], batch: int, window: int) -> None:
        groups: dict[str, list[Item]] = {}
        for item in items:
            groups.setdefault(item.group, []).append(item)
        self.weight = {name: sum(item.weight for item in group) for name, group in groups.items()}
        order = sorted(groups, key=lambda name: (-self.weight[name], name))
        # A stable sort: items of equal weight stay in the order given.
        self.groups = {
            name: deque(sorted(groups[name], key=lambda item: -item.weight)) for name in order
        }
        self.unopened = deque(order)
        self.batch, self.window = batch, window
        self.total_weight = sum(self.weight.values())
        self.count = len(items)
        self.last_group: dict[str, str] = {}  # by worker

    def __bool__(self) -> bool:
        return self.count > 0

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
            if load > fair * (1 + 1e-9):
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
