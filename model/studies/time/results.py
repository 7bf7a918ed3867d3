"""Results of the time study: the JSON contract, comparisons, and the report section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.results import known_first
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.files import study_section
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.scenes.checked import within

Clock = Literal["wall", "cpu"]
CLOCKS: dict[Clock, str] = {
    "wall": "seconds",
    "cpu": "CPU seconds, sum of all threads",
}
HYBRID_SAMPLES = (1, 2, 4, 8)  # per pixel, for networks that take noisy samples
# Per pixel, of light transport with fewer samples than it has by itself, and with fewer surfels.
TRANSPORT_SAMPLES = (1, 2, 4, 8)
PARTS = {
    "inputs": "Depth, normal, reflectance",
    "illumination": "Panorama",
    "surfaces": "The same, with roughness and metalness",
    "transport": "Light transport",
    **{f"transport_{n}": f"Light transport, {n} samples per pixel" for n in TRANSPORT_SAMPLES},
    "shading": "Shading network",
    "composition": "Composition network",
    "product": "Reflectance × shading",
    **{
        f"samples_{spp}": f"Samples, {spp} per pixel, denoised with known guides"
        for spp in HYBRID_SAMPLES
    },
    "truths": "Mitsuba with the dataset's parameters: shading and colour of one view",
    "guides": "Guide images of the denoiser",
    "denoiser": "Denoiser",
}
# Seconds reported by Dai et al. (TIP 2020), by the corresponding part.
PAPER = {"inputs": 0.040, "illumination": 10.2, "networks": 0.145, "truths": 180.0}
RENDERERS = {
    "mitsuba": "Mitsuba's path tracer",
    "mitsuba_denoised": "Mitsuba's path tracer, denoised",
    "planned": "Mitsuba with planned light sampling",
    "planned_denoised": "Mitsuba with planned light sampling, denoised",
}


@dataclass(frozen=True)
class PartSeconds:
    """Seconds per view: the mean over views of the median of the turns, and of their range.

    `truths` is timed once, in one view.
    """

    seconds: float = field(metadata=within(0))
    low: float = field(metadata=within(0))
    high: float = field(metadata=within(0))


@dataclass(frozen=True)
class MethodPoint:
    """Time and quality of one method, and one number of samples; means over views."""

    method: str
    spp: int | None  # None: without samples, or light transport with as many as it has by itself
    seconds: float = field(metadata=within(0))  # per view, with all parts that it needs
    flip: float = field(metadata=within(0, 1))
    ssim: float = field(metadata=within(-1, 1))


@dataclass(frozen=True)
class TimeResult:
    """Contract of `metrics/studies/time.json`."""

    seed: int
    split: str
    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    size: tuple[int, int]  # width, height
    panorama: int = field(metadata=within(1))  # width, pixels
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
    parts: dict[str, PartSeconds]
    points: tuple[MethodPoint, ...]
    # by method and samples, "hybrid 4": views with a lower FLIP than the joint trace, denoised, has
    # with as many samples
    better: dict[str, int] = field(default_factory=dict)
    timed_views: int = 0  # of `views`, whose times were taken; 0: all, in older results


def fastest_better(point: MethodPoint, points: tuple[MethodPoint, ...]) -> MethodPoint | None:
    """Return the fastest renderer that is no slower than `point` and has a lower error, or None."""
    better = [
        other
        for other in points
        if other.method in RENDERERS and other.seconds <= point.seconds and other.flip < point.flip
    ]
    return min(better, key=lambda other: other.seconds, default=None)


def verdicts(result: TimeResult) -> list[str]:
    """Return a sentence for every network: is the renderer better in the same time?"""
    lines = [
        f"{name.replace(' ', ' at ')} spp: better than as many denoised samples in {count} of "
        f"{result.views} views"
        for name, count in sorted(result.better.items())
    ]
    for point in result.points:
        if point.method in RENDERERS:
            continue
        better = fastest_better(point, result.points)
        samples = "" if point.spp is None else f" at {point.spp} spp"
        network = f"{point.method}{samples} (ꟻLIP {point.flip:.3f} in {point.seconds:.2f} s)"
        if better is None:
            lines.append(f"{network}: the renderer is not better in the same time")
        else:
            lines.append(
                f"{network}: the renderer is better, {RENDERERS[better.method]} at {better.spp} "
                f"spp (ꟻLIP {better.flip:.3f} in {better.seconds:.2f} s)"
            )
    return lines


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    result = records.study("time", TimeResult)
    if result is None:
        return None
    titles = {**METHOD_TITLES, **RENDERERS}
    return study_section(
        "time",
        "Equal time",
        result=result,
        unit=CLOCKS[result.clock],
        rows=part_rows(result),
        points=[
            {"title": titles.get(point.method, point.method), "point": point}
            for point in result.points
        ],
        verdicts=verdicts(result),
        picture=records.study_picture("time", width=1000, png=True),
    )


def part_rows(result: TimeResult) -> list[dict[str, Any]]:
    """Return a row for each part and for both networks together, with the paper's figures."""
    rows: list[dict[str, Any]] = [
        {
            "name": name,
            "title": PARTS.get(name, METHOD_TITLES.get(name, name)),
            "spent": result.parts[name],
            "paper": PAPER.get(name),
        }
        for name in known_first(result.parts, PARTS)
    ]
    pair = [result.parts.get(name) for name in ("shading", "composition")]
    both = [part for part in pair if part is not None]
    if len(both) == 2:
        total = PartSeconds(*(sum(getattr(p, n) for p in both) for n in ("seconds", "low", "high")))
        title = "Both networks"
        row = {"name": "networks", "title": title, "spent": total, "paper": PAPER["networks"]}
        place = next(i for i, row in enumerate(rows) if row["name"] == "composition") + 1
        rows.insert(place, row)
    return rows
