"""Small drawings for the report, as inline SVG whose colours follow the page's light or dark look.

Every function returns one `<svg>` element, safe to put into a page: text is escaped. Classes
(`axis`, `s0` to `s5`, `box`, `flow`, ...) are coloured by the page's style sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from scenes.arrays import Float64Array

Points = Sequence[tuple[float, float]]
Box = tuple[float, float, float, float]  # x, y, width, height


@dataclass(frozen=True)
class Node:
    """A stage in the picture of the chain; `image` is a data URI or nothing."""

    title: str
    note: str
    image: str = ""


@dataclass(frozen=True)
class Bar:
    """A stretch of time on a row of a timeline; `group` names its colour."""

    row: int
    begin: float
    end: float
    group: int


WIDE: dict[str, Box] = {
    "scenes": (8, 118, 132, 124),
    "cameras": (164, 118, 132, 124),
    "inputs": (320, 8, 132, 108),
    "illumination": (320, 126, 132, 108),
    "groundtruth": (320, 244, 132, 108),
    "dataset": (476, 118, 132, 124),
    "backbone": (632, 8, 132, 66),
    "shading": (632, 118, 132, 124),
    "composition": (788, 118, 132, 124),
    "evaluate": (944, 118, 132, 124),
}
TALL: dict[str, Box] = {
    "scenes": (24, 6, 140, 118),
    "cameras": (196, 6, 140, 118),
    "inputs": (6, 152, 112, 108),
    "illumination": (124, 152, 112, 108),
    "groundtruth": (242, 152, 112, 108),
    "dataset": (24, 288, 140, 118),
    "backbone": (196, 314, 140, 66),
    "shading": (24, 434, 140, 118),
    "composition": (196, 434, 140, 118),
    "evaluate": (110, 580, 140, 118),
}
EDGES = (
    ("scenes", "cameras"),
    ("cameras", "inputs"),
    ("cameras", "illumination"),
    ("cameras", "groundtruth"),
    ("inputs", "dataset"),
    ("illumination", "dataset"),
    ("groundtruth", "dataset"),
    ("dataset", "shading"),
    ("backbone", "shading"),
    ("shading", "composition"),
    ("composition", "evaluate"),
)


def chain(nodes: Mapping[str, Node], layout: Mapping[str, Box], name: str) -> Markup:
    """The stages as boxes with arrows; `layout` is `WIDE` or `TALL`, `name` its CSS class."""
    width = max(x + w for x, _, w, _ in layout.values()) + 8
    height = max(y + h for _, y, _, h in layout.values()) + 8
    parts = [
        f'<svg class="chain {name}" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'aria-label="The chain of stages">',
        f'<defs><marker id="arrow-{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        f'markerHeight="7" orient="auto"><path d="M0,0 L8,4 L0,8 z" class="tip"/></marker></defs>',
    ]
    for start, end in EDGES:
        path = _connect(layout[start], layout[end])
        parts.append(f'<path class="flow" d="{path}" marker-end="url(#arrow-{name})"/>')
    for key, (x, y, w, h) in layout.items():
        node = nodes[key]
        parts.append(f'<rect class="box" x="{x}" y="{y}" width="{w}" height="{h}" rx="8"/>')
        middle = x + w / 2
        parts.append(
            f'<text class="title" x="{middle:g}" y="{y + 17:g}">{escape(node.title)}</text>'
        )
        parts.append(
            f'<text class="note" x="{middle:g}" y="{y + h - 8:g}">{escape(node.note)}</text>'
        )
        if node.image and h > 90:
            parts.append(
                f'<image x="{x + 6:g}" y="{y + 24:g}" width="{w - 12:g}" height="{h - 46:g}" '
                f'preserveAspectRatio="xMidYMid slice" href="{escape(node.image)}"/>'
            )
        elif h > 90:
            line = f"M{x + 20:g},{y + h / 2:g} h{w - 40:g}"
            parts.append(f'<path class="empty" d="{line}"/>')
    return Markup("".join(parts) + "</svg>")


def line_chart(series: Mapping[str, Points], x_label: str, y_label: str) -> Markup:
    """Lines over a common x axis; y is logarithmic where the values span more than a decade."""
    points = [point for line in series.values() for point in line if _usable(point)]
    if not points:
        return Markup("")
    parts, place = _frame(points, x_label, y_label)
    for index, line in enumerate(series.values()):
        placed = [place(x, y) for x, y in line if _usable((x, y))]
        path = " L".join(f"{x:.1f},{y:.1f}" for x, y in placed)
        if len(placed) > 1:
            parts.append(f'<path class="line s{index % 6}" d="M{path}"/>')
        if len(placed) <= 30:
            parts += [
                f'<circle class="dot s{index % 6}" cx="{x:.1f}" cy="{y:.1f}" r="3"/>'
                for x, y in placed
            ]
    return Markup("".join(parts) + "</svg>")


def scatter_plot(
    points: Points,
    x_label: str,
    y_label: str,
    groups: Sequence[int] = (),
    zero: bool = False,
) -> Markup:
    """A dot for each point, coloured by its group; y from 0 on if `zero`, else as `line_chart`."""
    usable = [index for index, point in enumerate(points) if _usable(point)]
    if not usable:
        return Markup("")
    parts, place = _frame([points[index] for index in usable], x_label, y_label, zero)
    for index in usable:
        x, y = place(*points[index])
        group = groups[index] % 6 if groups else 0
        parts.append(f'<circle class="dot faint s{group}" cx="{x:.1f}" cy="{y:.1f}" r="2.5"/>')
    return Markup("".join(parts) + "</svg>")


def _frame(
    points: Points, x_label: str, y_label: str, zero: bool = False
) -> tuple[list[str], Callable[[float, float], tuple[float, float]]]:
    """The start of a chart with axes that hold the points, and where a point lies in it."""
    width, height, left, bottom, top, right = 480.0, 250.0, 56.0, 42.0, 12.0, 16.0
    xs, ys = [x for x, _ in points], [y for _, y in points]
    if zero:
        ys = [0.0, *ys]
    logarithmic = min(ys) > 0 and max(ys) / min(ys) > 10
    scale = math.log10 if logarithmic else float
    low_x, high_x = min(xs), max(xs)
    low_y, high_y = scale(min(ys)), scale(max(ys))
    margin = 0.06 * (high_y - low_y or abs(high_y) or 1.0)
    low_y, high_y = low_y - (0.0 if zero else margin), high_y + margin

    def place(x: float, y: float) -> tuple[float, float]:
        across = (x - low_x) / (high_x - low_x or 1.0)
        up = (scale(y) - low_y) / (high_y - low_y)
        return left + across * (width - left - right), height - bottom - up * (
            height - bottom - top
        )

    parts = [f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img">']
    for shown in _decade_ticks(low_y, high_y) if logarithmic else _ticks(low_y, high_y, 5):
        value = scale(shown)
        y = height - bottom - (value - low_y) / (high_y - low_y) * (height - bottom - top)
        parts.append(f'<path class="grid" d="M{left:g},{y:.1f} H{width - right:g}"/>')
        parts.append(f'<text class="tick end" x="{left - 6:g}" y="{y + 4:.1f}">{shown:.3g}</text>')
    for value in _ticks(low_x, high_x, 6):
        x = left + (value - low_x) / (high_x - low_x or 1.0) * (width - left - right)
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{height - bottom + 17:g}">{value:g}</text>'
        )
    axis = f"M{left:g},{top:g} V{height - bottom:g} H{width - right:g}"
    parts.append(f'<path class="axis" d="{axis}"/>')
    parts.append(
        f'<text class="label" x="{(left + width) / 2:g}" y="{height - 5:g}">'
        f"{escape(x_label)}</text>"
    )
    middle = (height - bottom + top) / 2
    words = y_label + (", logarithmic" if logarithmic else "")
    parts.append(
        f'<text class="label" transform="translate(12 {middle:g}) rotate(-90)">'
        f"{escape(words)}</text>"
    )
    return parts, place


def timeline(bars: Sequence[Bar], rows: int, cuts: Sequence[float], x_label: str) -> Markup:
    """Bars over a common time axis that starts at 0; a dashed rule at each cut."""
    if not bars:
        return Markup("")
    step = 18.0 if rows <= 8 else 11.0
    width, left, right, top, bottom = 480.0, 26.0, 16.0, 8.0, 42.0
    height = top + step * rows + bottom
    last = max(bar.end for bar in bars) or 1.0

    def place(value: float) -> float:
        return left + max(0.0, value) / last * (width - left - right)

    parts = [f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img">']
    foot = height - bottom
    for value in _ticks(0, last, 6):
        parts.append(f'<path class="grid" d="M{place(value):.1f},{top:g} V{foot:g}"/>')
        parts.append(
            f'<text class="tick" x="{place(value):.1f}" y="{foot + 17:g}">{value:g}</text>'
        )
    for row in range(rows):
        if rows <= 8 or row % 4 == 0:
            y = top + step * (row + 0.5) + 4
            parts.append(f'<text class="tick end" x="{left - 6:g}" y="{y:g}">{row + 1}</text>')
    for bar in bars:
        x, y = place(bar.begin), top + step * bar.row + 0.15 * step
        wide = max(0.4, place(bar.end) - x - 0.3)
        parts.append(
            f'<rect class="dot s{bar.group % 6}" x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" '
            f'height="{0.7 * step:.1f}"/>'
        )
    parts += [f'<path class="cut" d="M{place(cut):.1f},{top:g} V{foot:g}"/>' for cut in cuts]
    parts.append(f'<path class="axis" d="M{left:g},{foot:g} H{width - right:g}"/>')
    parts.append(f'<text class="label" x="{(left + width) / 2:g}" y="{height - 5:g}">')
    return Markup("".join(parts) + f"{escape(x_label)}</text></svg>")


def strip_plot(groups: Mapping[str, Sequence[float]], label: str) -> Markup:
    """One row of dots a group over a common axis, with a bar at each mean."""
    values = [value for group in groups.values() for value in group if math.isfinite(value)]
    if not values:
        return Markup("")
    row, left, right, width, bottom = 32.0, 92.0, 16.0, 480.0, 42.0
    height = row * len(groups) + bottom + 6
    low, high = min(values), max(values)
    margin = 0.04 * (high - low or 1.0)
    low, high = low - margin, high + margin

    def place(value: float) -> float:
        return left + (value - low) / (high - low) * (width - left - right)

    parts = [f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img">']
    for value in _ticks(low, high, 6):
        x = place(value)
        parts.append(f'<path class="grid" d="M{x:.1f},4 V{height - bottom:g}"/>')
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{height - bottom + 16:g}">{value:.3g}</text>'
        )
    for index, (name, group) in enumerate(groups.items()):
        y = 4 + row * (index + 0.5)
        parts.append(
            f'<text class="tick end" x="{left - 10:g}" y="{y + 4:g}">{escape(name)}</text>'
        )
        parts += [
            f'<circle class="dot faint s{index % 6}" cx="{place(value):.1f}" cy="{y:g}" r="4"/>'
            for value in group
            if math.isfinite(value)
        ]
        if len(group):
            x = place(float(np.mean(group)))
            parts.append(f'<path class="mean s{index % 6}" d="M{x:.1f},{y - 11:g} v22"/>')
    parts.append(f'<text class="label" x="{(left + width) / 2:g}" y="{height - 5:g}">')
    return Markup("".join(parts) + f"{escape(label)}</text></svg>")


def panorama_guide(
    image: str, size: tuple[int, int], intrinsics: Float64Array, frame: tuple[int, int]
) -> Markup:
    """A panorama (data URI, shown at `size`) with its directions and the image's outline in it.

    `frame` is the image's (width, height) in pixels. Equirectangular in the camera's frame:
    u = 1/2 + atan2(x, z) / 2π, v = 1/2 + asin(y / |r|) / π, axes x right, y down, z forward.
    """
    width, height = size
    step = np.linspace(0, 1, 25)
    zero, one = np.zeros_like(step), np.ones_like(step)
    border = np.concatenate(
        [
            np.stack([step, zero], -1),
            np.stack([one, step], -1),
            np.stack([step[::-1], one], -1),
            np.stack([zero, step[::-1]], -1),
        ]
    )
    pixels = np.concatenate([border * np.array(frame), np.ones((len(border), 1))], -1)
    x, y, z = (pixels @ np.linalg.inv(intrinsics).T).T
    u = (0.5 + np.arctan2(x, z) / (2 * np.pi)) * width
    v = (0.5 + np.arctan2(y, np.hypot(x, z)) / np.pi) * height
    outline = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(u, v, strict=True))
    foot = 0.06 * height
    parts = [
        f'<svg class="guide" viewBox="0 0 {width} {height + 2 * foot:g}" role="img">',
        f'<image width="{width}" height="{height}" preserveAspectRatio="none" href="{image}"/>',
        f'<polygon class="outline" points="{outline}"/>',
    ]
    marks = ((0.0, "behind"), (0.25, "left"), (0.5, "ahead"), (0.75, "right"), (1.0, "behind"))
    for share, word in marks:
        place = "start" if share == 0 else "end" if share == 1 else "middle"
        parts.append(f'<path class="rule" d="M{share * width:g},0 V{height}"/>')
        parts.append(
            f'<text class="mark" text-anchor="{place}" x="{share * width:g}" '
            f'y="{height + 1.4 * foot:g}">{word}</text>'
        )
    for share, word in ((0.0, "up"), (0.5, "level with the view"), (1.0, "down")):
        y_text = min(max(share * height - 0.3 * foot, 1.0 * foot), height - 0.4 * foot)
        parts.append(f'<text class="mark over" x="{0.006 * width:g}" y="{y_text:g}">{word}</text>')
    parts.append(f'<path class="rule" d="M0,{height / 2:g} H{width}"/>')
    return Markup("".join(parts) + "</svg>")


def _connect(start: Box, end: Box) -> str:
    """A smooth path from the nearest side of one box to the facing side of the other."""
    (x0, y0, w0, h0), (x1, y1, w1, h1) = start, end
    if x1 >= x0 + w0:  # to the right
        a, b = (x0 + w0, y0 + h0 / 2), (x1 - 2, y1 + h1 / 2)
        bend = (a[0] + b[0]) / 2
        return f"M{a[0]:g},{a[1]:g} C{bend:g},{a[1]:g} {bend:g},{b[1]:g} {b[0]:g},{b[1]:g}"
    a, b = (x0 + w0 / 2, y0 + h0), (x1 + w1 / 2, y1 - 2)
    bend = (a[1] + b[1]) / 2
    return f"M{a[0]:g},{a[1]:g} C{a[0]:g},{bend:g} {b[0]:g},{bend:g} {b[0]:g},{b[1]:g}"


def _ticks(low: float, high: float, about: int) -> list[float]:
    """Round values inside [low, high], 1, 2 or 5 times a power of ten apart."""
    span = high - low
    if span <= 0:
        return [low]
    rough = span / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough)
    first = math.ceil(low / step)
    return [round(index * step, 12) for index in range(first, math.floor(high / step) + 1)]


def _decade_ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of ten whose logarithms lie inside [low, high]."""
    values = [
        factor * 10.0**power
        for power in range(math.floor(low), math.ceil(high) + 1)
        for factor in ((1, 2, 5) if high - low < 2.5 else (1,))
    ]
    return [value for value in values if low <= math.log10(value) <= high]


def _usable(point: tuple[float, float]) -> bool:
    return math.isfinite(point[0]) and math.isfinite(point[1])
