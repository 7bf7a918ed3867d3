"""A measured figure, the goal it was measured for, and whether that is met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from benchmarks.timing import Clock, Spread


@dataclass(frozen=True)
class Goal:
    """At most or at least so much."""

    sense: Literal["<=", ">="]
    limit: float

    def __str__(self) -> str:
        return f"{self.sense} {self.limit:g}"

    def met(self, value: float) -> bool:
        """Whether a figure reaches it."""
        return value <= self.limit if self.sense == "<=" else value >= self.limit


def at_most(limit: float) -> Goal:
    """A goal that small figures meet."""
    return Goal("<=", limit)


def at_least(limit: float) -> Goal:
    """A goal that large figures meet."""
    return Goal(">=", limit)


@dataclass(frozen=True)
class Row:
    """One figure: median and range of its repeats, in `unit` ("x" for a ratio).

    `clock` says which clock it was taken by, "" for none (errors, figures computed from others).
    A row that could not be measured has no `spread`, and `missing` says why.
    """

    name: str
    meaning: str
    spread: Spread | None
    unit: str = "x"
    clock: Clock | Literal[""] = ""
    goal: Goal | None = None
    missing: str = ""

    @property
    def verdict(self) -> str:
        """The goal and what became of it, in words; empty without a goal."""
        if self.goal is None:
            return ""
        if self.spread is None:
            return f"{self.goal}: not measured"
        return f"{self.goal}: {'met' if self.goal.met(self.spread.value) else 'MISSED'}"

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        row: dict[str, Any] = {"name": self.name, "meaning": self.meaning, "unit": self.unit}
        if self.clock:
            row["clock"] = self.clock
        if self.spread is None:
            row["missing"] = self.missing
        else:
            figure = self.spread
            row |= {"value": figure.value, "low": figure.low, "high": figure.high}
            row["repeats"] = figure.repeats
        if self.goal is not None:
            row["goal"] = str(self.goal)
            row["met"] = None if self.spread is None else self.goal.met(self.spread.value)
        return row


def missing(name: str, meaning: str, why: str, goal: Goal | None = None) -> Row:
    """A row that this machine could not measure."""
    return Row(name, meaning, None, goal=goal, missing=why)
