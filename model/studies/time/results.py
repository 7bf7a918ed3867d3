"""The time study: its file's contract, what follows from it, and its part of the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from model.figures.records import Records
from model.figures.results import METHODS, known_first
from scenes.checked import within

Clock = Literal["wall", "cpu"]
CLOCKS: dict[Clock, str] = {
    "wall": "seconds",
    "cpu": "seconds of the processor, all threads together",
}
PARTS = {
    "inputs": "Depth, normal, reflectance",
    "illumination": "Panorama",
    "visibility": "Shadows of its lights",
    "shading": "Shading network",
    "composition": "Composition network",
    "product": "Reflectance × shading",
    "truths": "Mitsuba as the dataset has it: shading and colour",
    "guides": "The denoiser's guides",
    "denoiser": "The denoiser",
}
# Seconds that Dai et al. (TIP 2020) give, by the part of ours that does the same.
PAPER = {"inputs": 0.040, "illumination": 10.2, "networks": 0.145, "truths": 180.0}
RENDERERS = {
    "mitsuba": "Mitsuba's path tracer",
    "mitsuba_denoised": "Mitsuba's path tracer, denoised",
    "planned": "Mitsuba with planned lights, shading and colour",
    "planned_denoised": "Mitsuba with planned lights, denoised",
}


@dataclass(frozen=True)
class Spent:
    """Seconds a view: the mean over views of the median of the repeats, and their range."""

    seconds: float = field(metadata=within(0))
    low: float = field(metadata=within(0))
    high: float = field(metadata=within(0))


@dataclass(frozen=True)
class Point:
    """A way to a picture: what it takes and how far it is from the reference, means over views."""

    method: str
    spp: int | None  # of a renderer
    seconds: float = field(metadata=within(0))  # a view, with all that it needs
    flip: float = field(metadata=within(0, 1))
    ssim: float = field(metadata=within(-1, 1))


@dataclass(frozen=True)
class TimeResult:
    """`metrics/studies/time.json`."""

    seed: int
    split: str
    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    size: tuple[int, int]  # width, height
    panorama: int = field(metadata=within(1))  # its width
    repeats: int = field(metadata=within(1))
    clock: Clock
    dataset_spp: int = field(metadata=within(1))
    reference_spp: int = field(metadata=within(1))
    reference_denoised: bool
    # relative standard error before denoising, mean over views
    reference_noise: float = field(metadata=within(0))
    exposure: str
    machine: dict[str, str]
    versions: dict[str, str]
    models: dict[str, str]  # name -> SHA-256 of the weights
    parts: dict[str, Spent]
    points: tuple[Point, ...]


def beaten_by(point: Point, points: tuple[Point, ...]) -> Point | None:
    """The renderer's fastest way that is no slower than `point` and nearer to the reference."""
    better = [
        other
        for other in points
        if other.method in RENDERERS and other.seconds <= point.seconds and other.flip < point.flip
    ]
    return min(better, key=lambda other: other.seconds, default=None)


def verdicts(result: TimeResult) -> list[str]:
    """For every network, whether the renderer gives a better picture in no more time."""
    lines = []
    for point in result.points:
        if point.method in RENDERERS:
            continue
        better = beaten_by(point, result.points)
        ours = f"{point.method} (ꟻLIP {point.flip:.3f} in {point.seconds:.2f} s)"
        if better is None:
            lines.append(f"{ours}: the renderer has nothing better in that time")
        else:
            lines.append(
                f"{ours}: beaten by {RENDERERS[better.method]} at {better.spp} spp "
                f"(ꟻLIP {better.flip:.3f} in {better.seconds:.2f} s)"
            )
    return lines


def time_study(records: Records) -> dict[str, Any] | None:
    """What the report shows of the study; None, and a note if damaged, without a result."""
    result = records.study("time", TimeResult)
    if result is None:
        return None
    return {
        "result": result,
        "unit": CLOCKS[result.clock],
        "rows": part_rows(result),
        "points": [
            {"words": {**METHODS, **RENDERERS}.get(point.method, point.method), "point": point}
            for point in result.points
        ],
        "verdicts": verdicts(result),
        "picture": records.study_picture("time", wide=1000, png=True),
    }


def part_rows(result: TimeResult) -> list[dict[str, Any]]:
    """A row a part, the paper's figure beside it; both networks together too."""
    rows: list[dict[str, Any]] = [
        {
            "name": name,
            "words": PARTS.get(name, METHODS.get(name, name)),
            "spent": result.parts[name],
            "paper": PAPER.get(name),
        }
        for name in known_first(result.parts, PARTS)
    ]
    pair = [result.parts.get(name) for name in ("shading", "composition")]
    both = [part for part in pair if part is not None]
    if len(both) == 2:
        total = Spent(*(sum(getattr(p, n) for p in both) for n in ("seconds", "low", "high")))
        words = "Both networks"
        row = {"name": "networks", "words": words, "spent": total, "paper": PAPER["networks"]}
        place = next(i for i, row in enumerate(rows) if row["name"] == "composition") + 1
        rows.insert(place, row)
    return rows
