"""Results of the pairs study: the JSON contract and the report section."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.results import known_first
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.files import study_section
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.scenes.checked import within
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json


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
        _verify_rate(self, "mistaken", self.mistaken, where)


@dataclass(frozen=True)
class ChosenRate:
    """Rate at which people chose a folder's picture."""

    answers: int = field(metadata=within(0))  # in time, to pairs with a picture of the folder
    chosen: int = field(metadata=within(0))  # answers that chose it
    timeouts: int = field(metadata=within(0))
    rate: float | None = field(metadata=within(0, 1))  # chosen / answers; None without answers
    low: float | None = field(metadata=within(0, 1))  # Wilson's 95 % interval of the rate
    high: float | None = field(metadata=within(0, 1))

    def verify(self, where: str) -> None:
        """Raise ValueError unless the figures are consistent."""
        _verify_rate(self, "chosen", self.chosen, where)


def _verify_rate(figure: MistakenRate | ChosenRate, name: str, count: int, where: str) -> None:
    if count > figure.answers:
        raise ValueError(f"{where}.{name}: {count} of {figure.answers} answers")
    known = [value is not None for value in (figure.rate, figure.low, figure.high)]
    if known != [figure.answers > 0] * 3:
        raise ValueError(
            f"{where}: rate, low and high must be null exactly if there are no answers"
        )
    if figure.rate is not None and not math.isclose(figure.rate, count / figure.answers):
        raise ValueError(f"{where}.rate: {figure.rate} is not {count} / {figure.answers}")


@dataclass(frozen=True)
class PairsResult:
    """Contract of `metrics/studies/pairs.json` for a page of methods and the renderer."""

    page: str  # id of the page
    seed: int
    split: str
    seconds: float  # a pair was shown
    people: int = field(metadata=within(1))
    pairs: int = field(metadata=within(1))  # per person
    methods: dict[str, MistakenRate]


@dataclass(frozen=True)
class FoldersResult:
    """Contract of `metrics/studies/pairs.json` for a page of folders of pictures."""

    page: str  # id of the page
    seed: int
    question: str
    seconds: float  # a pair was shown
    people: int = field(metadata=within(1))
    pairs: int = field(metadata=within(1))  # per person
    folders: dict[str, ChosenRate]  # of all pairs with a picture of the folder
    against: dict[str, dict[str, ChosenRate]]  # folder -> other folder -> of their pairs


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    kind = _kind_of(records.places.metrics / "studies" / "pairs.json")
    result = records.study("pairs", kind, "pbrnet study pairs --score")
    if result is None:
        return None
    if isinstance(result, FoldersResult):
        rows = [_row(title, "", figure) for title, figure in folder_figures(result).items()]
    else:
        rows = [
            _row(METHOD_TITLES.get(name, name), name, result.methods[name])
            for name in known_first(result.methods, METHOD_TITLES)
        ]
    return study_section(
        "pairs",
        "Blind pairs",
        result=result,
        folders=isinstance(result, FoldersResult),
        rows=rows,
    )


def folder_figures(result: FoldersResult) -> dict[str, ChosenRate]:
    """Return the figures by title: each folder, and of three or more also against each other."""
    figures = {}
    for name, figure in result.folders.items():
        figures[name] = figure
        if len(result.folders) > 2:
            others = result.against.get(name, {})
            figures |= {f"{name} against {other}": one for other, one in others.items()}
    return figures


def _kind_of(path: Path) -> type[PairsResult | FoldersResult]:
    try:
        content = read_json(path)
    except (InputError, OSError):  # missing, or damaged, which the records note
        return PairsResult
    return FoldersResult if isinstance(content, dict) and "folders" in content else PairsResult


def _row(title: str, name: str, figure: MistakenRate | ChosenRate) -> dict[str, object]:
    return {
        "name": name,
        "title": title,
        "rate": percent(figure.rate),
        "interval": interval(figure),
        "answers": figure.answers,
        "timeouts": figure.timeouts,
    }


def percent(share: float | None) -> str:
    """Format a share as per cent; a dash for None."""
    return "–" if share is None else f"{100 * share:.1f} %"


def interval(figure: MistakenRate | ChosenRate) -> str:
    """Format the interval of a rate; empty without answers."""
    return "" if figure.rate is None else f"{percent(figure.low)} to {percent(figure.high)}"
