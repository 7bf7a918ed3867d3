"""Timing by turns: what is compared runs one after the other, again and again, never in blocks.

Two clocks are read. `cpu` is user and system time of this process and of its children that have
ended, threads together: what other processes do on the machine hardly changes it, so ratios of
cost are taken from it. `wall` is what a waiting person feels; it is right on a quiet machine
only, and taken where parallel work is the question.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Clock = Literal["cpu", "wall"]


@dataclass(frozen=True)
class Spent:
    """Seconds that something took, by both clocks."""

    cpu: float
    wall: float

    def by(self, clock: Clock) -> float:
        """Seconds by one of them."""
        return self.cpu if clock == "cpu" else self.wall


@dataclass(frozen=True)
class Spread:
    """Repeats of one figure: the middle one and the range."""

    value: float
    low: float
    high: float
    repeats: int


def now() -> Spent:
    """Both clocks; only differences mean anything."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = time.process_time() + children.ru_utime + children.ru_stime
    return Spent(cpu, time.perf_counter())


def spend(work: Callable[[], object], clock: Callable[[], Spent] = now) -> Spent:
    """Do the work once and say what it took."""
    before = clock()
    work()
    after = clock()
    return Spent(after.cpu - before.cpu, after.wall - before.wall)


def by_turns(
    ways: Mapping[str, Callable[[], object]],
    repeats: int,
    warm: bool = True,
    clock: Callable[[], Spent] = now,
) -> dict[str, list[Spent]]:
    """Each of the `ways` `repeats` times, by turns; `warm`: a first turn is not counted."""
    spent: dict[str, list[Spent]] = {name: [] for name in ways}
    for turn in range(-1 if warm else 0, repeats):
        for name, work in ways.items():
            took = spend(work, clock)
            if turn >= 0:
                spent[name].append(took)
    return spent


def spread(values: Sequence[float]) -> Spread:
    """Median and range of repeated figures; ValueError if there are none."""
    if not values:
        raise ValueError("no repeats to take a median of")
    return Spread(statistics.median(values), min(values), max(values), len(values))


def ratio(above: Sequence[Spent], below: Sequence[Spent], clock: Clock) -> Spread:
    """Seconds of one way over those of the other, turn by turn."""
    pairs = zip(above, below, strict=True)
    return spread([a.by(clock) / b.by(clock) for a, b in pairs])
