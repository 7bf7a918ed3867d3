"""Results of the pairs study: the JSON contract and the report section."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from model.figures.records import Records
from model.figures.results import known_first
from model.figures.section import Section, render_section
from model.titles import METHOD_TITLES
from scenes.checked import within


@dataclass(frozen=True)
class MistakenRate:
    """Rate at which people took a method's picture for the renderer's."""

    answers: int = field(metadata=within(0))  # in time
    mistaken: int = field(metadata=within(0))  # answers that chose the method's picture
    timeouts: int = field(metadata=within(0))
    rate: float | None = field(metadata=within(0, 1))  # mistaken / answers; None without answers
    low: float | None = field(metadata=within(0, 1))  # Wilson's 95 % interval of the rate
    high: float | None = field(metadata=within(0, 1))

    def verify(self, where: str) -> None:
        """Raise ValueError unless the figures are consistent."""
        if self.mistaken > self.answers:
            raise ValueError(f"{where}.mistaken: {self.mistaken} of {self.answers} answers")
        known = [value is not None for value in (self.rate, self.low, self.high)]
        if known != [self.answers > 0] * 3:
            raise ValueError(
                f"{where}: rate, low and high must be null exactly if there are no answers"
            )
        if self.rate is not None and not math.isclose(self.rate, self.mistaken / self.answers):
            raise ValueError(f"{where}.rate: {self.rate} is not {self.mistaken} / {self.answers}")


@dataclass(frozen=True)
class PairsResult:
    """Contract of `metrics/studies/pairs.json`."""

    page: str  # id of the page
    seed: int
    split: str
    seconds: float  # a pair was shown
    people: int = field(metadata=within(1))
    pairs: int = field(metadata=within(1))  # per person
    methods: dict[str, MistakenRate]


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    result = records.study("pairs", PairsResult, "pbrnet study pairs --score")
    if result is None:
        return None
    return render_section(
        "model.studies.pairs",
        "study-pairs",
        "Blind pairs",
        result=result,
        rows=[
            {
                "name": name,
                "title": METHOD_TITLES.get(name, name),
                "rate": percent(result.methods[name].rate),
                "interval": interval(result.methods[name]),
                "answers": result.methods[name].answers,
                "timeouts": result.methods[name].timeouts,
            }
            for name in known_first(result.methods, METHOD_TITLES)
        ],
    )


def percent(share: float | None) -> str:
    """Format a share as per cent; a dash for None."""
    return "–" if share is None else f"{100 * share:.1f} %"


def interval(figure: MistakenRate) -> str:
    """Format the interval of a rate; empty without answers."""
    return "" if figure.rate is None else f"{percent(figure.low)} to {percent(figure.high)}"
