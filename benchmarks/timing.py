"""Timing of candidates that run alternately, with two clocks.

`cpu` is the user and system time of this process and of its ended children, over all threads. Other
processes on the machine hardly change it, so cost ratios are measured with it. `wall` is elapsed
time; it is right only on an idle machine and is used for parallel work.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

Clock = Literal["cpu", "wall"]
A = TypeVar("A")


@dataclass(frozen=True)
class Spent:
    """Seconds by both clocks."""

    cpu: float
    wall: float

    def by(self, clock: Clock) -> float:
        """Return the seconds by one clock."""
        return self.cpu if clock == "cpu" else self.wall


@dataclass(frozen=True)
class Spread:
    """Median and range of repeated measurements."""

    value: float
    low: float
    high: float
    repeats: int


def now() -> Spent:
    """Return both clocks; only differences are meaningful."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = time.process_time() + children.ru_utime + children.ru_stime
    return Spent(cpu, time.perf_counter())


def spend(work: Callable[[], object], clock: Callable[[], Spent] = now) -> Spent:
    """Run the work once; return the seconds it took."""
    before = clock()
    work()
    after = clock()
    return Spent(after.cpu - before.cpu, after.wall - before.wall)


def timed(work: Callable[[], A]) -> tuple[A, Spent]:
    """Run the work once; return its result and the seconds it took."""
    found: list[A] = []
    spent = spend(lambda: found.append(work()))
    return found[0], spent


def by_turns(
    ways: Mapping[str, Callable[[], object]],
    repeats: int,
    warm: bool = True,
    clock: Callable[[], Spent] = now,
) -> dict[str, list[Spent]]:
    """Run each candidate `repeats` times, alternately; return their seconds by name.

    With `warm` a first round is not counted.
    """
    spent: dict[str, list[Spent]] = {name: [] for name in ways}
    for turn in range(-1 if warm else 0, repeats):
        for name, work in ways.items():
            took = spend(work, clock)
            if turn >= 0:
                spent[name].append(took)
    return spent


def sums(*parts: Sequence[Spent]) -> list[Spent]:
    """Return the seconds of several candidates together, round by round."""
    rounds = zip(*parts, strict=True)
    return [Spent(sum(s.cpu for s in each), sum(s.wall for s in each)) for each in rounds]


def beyond(whole: Sequence[Spent], part: Sequence[Spent]) -> list[Spent]:
    """Return what one candidate takes more than another, round by round; at least nothing."""
    pairs = zip(whole, part, strict=True)
    return [Spent(max(a.cpu - b.cpu, 0), max(a.wall - b.wall, 0)) for a, b in pairs]


def spread(values: Sequence[float]) -> Spread:
    """Return median and range; raises ValueError if there are no values."""
    if not values:
        raise ValueError("no repeats to take a median of")
    return Spread(statistics.median(values), min(values), max(values), len(values))


def ratio(above: Sequence[Spent], below: Sequence[Spent], clock: Clock) -> Spread:
    """Return the ratio of seconds of two candidates, round by round."""
    pairs = zip(above, below, strict=True)
    return spread([a.by(clock) / b.by(clock) for a, b in pairs])
