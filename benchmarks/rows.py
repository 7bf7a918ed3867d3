"""Rows of the benchmark tables: a measured figure, its goal, and whether it is met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from benchmarks.timing import Clock, Spread


@dataclass(frozen=True)
class Goal:
    """Upper or lower limit of a figure."""

    sense: Literal["<=", ">="]
    limit: float

    def __str__(self) -> str:
        return f"{self.sense} {self.limit:g}"

    def met(self, value: float) -> bool:
        """Return whether a figure is within the limit."""
        return value <= self.limit if self.sense == "<=" else value >= self.limit


def at_most(limit: float) -> Goal:
    """Return a goal with an upper limit."""
    return Goal("<=", limit)


def at_least(limit: float) -> Goal:
    """Return a goal with a lower limit."""
    return Goal(">=", limit)


@dataclass(frozen=True)
class Row:
    """One figure: median and range of its repeats, in `unit` ("x" for a ratio).

    `clock` is the clock it was measured with, "" for none (errors, figures computed from others).
    A row that could not be measured has no `spread`; `missing` is the reason.
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
        """Goal and result as text; empty without a goal."""
        if self.goal is None:
            return ""
        if self.spread is None:
            return f"{self.goal}: not measured"
        return f"{self.goal}: {'met' if self.goal.met(self.spread.value) else 'MISSED'}"

    def plain(self) -> dict[str, Any]:
        """Return the row as JSON data."""
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
    """Return a row that could not be measured on this machine."""
    return Row(name, meaning, None, goal=goal, missing=why)
