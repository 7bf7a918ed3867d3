"""What the studies found: their files' contract, and their part of the report."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from model.figures.records import Records
from model.figures.results import METHODS, known_first
from scenes.checked import within


@dataclass(frozen=True)
class PairsFigure:
    """How often people took a method's picture for the renderer's."""

    answers: int = field(metadata=within(0))  # without those that ran out of time
    mistaken: int = field(metadata=within(0))  # of them, took the method's picture for the truth
    timeouts: int = field(metadata=within(0))
    rate: float | None = field(metadata=within(0, 1))  # mistaken / answers; None without answers
    low: float | None = field(metadata=within(0, 1))  # Wilson's 95 % interval of the rate
    high: float | None = field(metadata=within(0, 1))

    def verify(self, where: str) -> None:
        """Raises ValueError unless the figures can be of one count."""
        if self.mistaken > self.answers:
            raise ValueError(f"{where}.mistaken: {self.mistaken} of {self.answers} answers")
        known = [value is not None for value in (self.rate, self.low, self.high)]
        if known != [self.answers > 0] * 3:
            raise ValueError(f"{where}: rate, low and high are there when there are answers")
        if self.rate is not None and not math.isclose(self.rate, self.mistaken / self.answers):
            raise ValueError(f"{where}.rate: {self.rate} is not {self.mistaken} / {self.answers}")


@dataclass(frozen=True)
class PairsResult:
    """`metrics/studies/pairs.json`: the blind pairs, after the paper's Table II."""

    page: str  # id of the page that was answered
    seed: int
    split: str
    seconds: float  # that the pictures were shown
    people: int = field(metadata=within(1))
    pairs: int = field(metadata=within(1))  # that each of them saw
    methods: dict[str, PairsFigure]


def pairs_table(records: Records) -> dict[str, Any] | None:
    """What the report shows of the pairs study; None, and a note if damaged, without a result."""
    result = records.study("pairs", PairsResult, "pbrnet study pairs --score")
    if result is None:
        return None
    return {
        "people": result.people,
        "pairs": result.pairs,
        "seconds": f"{result.seconds:g}",
        "split": result.split,
        "rows": [
            {
                "name": name,
                "words": METHODS.get(name, name),
                "rate": percent(result.methods[name].rate),
                "interval": interval(result.methods[name]),
                "answers": result.methods[name].answers,
                "timeouts": result.methods[name].timeouts,
            }
            for name in known_first(result.methods, METHODS)
        ],
    }


def percent(share: float | None) -> str:
    """A share in words; a dash for none."""
    return "–" if share is None else f"{100 * share:.1f} %"


def interval(figure: PairsFigure) -> str:
    """From low to high; nothing without answers."""
    return "" if figure.rate is None else f"{percent(figure.low)} to {percent(figure.high)}"
