"""Diagrams of the report as inline SVG: the chain of stages, and the guide to a panorama.

They are layouts of boxes, pictures and labels, not charts of data (`pbrnet.model.figures.charts`),
so they are written as SVG elements. Each function returns one `<svg>` element with escaped text;
its classes (`box`, `flow`, `outline`, ...) get their colours from the page's style sheet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from pbrnet.scenes.arrays import Float64Array

Box = tuple[float, float, float, float]  # x, y, width, height


@dataclass(frozen=True)
class Node:
    """A stage of the chain; `image` is a data URI or empty."""

    title: str
    note: str
    image: str = ""


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
    """Draw the stages as boxes with arrows; `layout` is `WIDE` or `TALL`, `name` its CSS class."""
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


def panorama_guide(
    image: str, size: tuple[int, int], intrinsics: Float64Array | None, frame: tuple[int, int]
) -> Markup:
    """Draw a panorama (data URI, shown at `size`) with directions and the outline of the view.

    `frame` is the (width, height) of the view in pixels; a view without `intrinsics` shows all
    directions and has no outline. Equirectangular in the camera's frame:
    u = 1/2 + atan2(x, z) / 2π, v = 1/2 + asin(y / |r|) / π, axes x right, y down, z forward.
    """
    width, height = size
    foot = 0.06 * height
    parts = [
        f'<svg class="guide" viewBox="0 0 {width} {height + 2 * foot:g}" role="img">',
        f'<image width="{width}" height="{height}" preserveAspectRatio="none" href="{image}"/>',
    ]
    if intrinsics is not None:
        parts.append(_outline(size, intrinsics, frame))
    marks = ((0.0, "behind"), (0.25, "left"), (0.5, "forward"), (0.75, "right"), (1.0, "behind"))
    for share, word in marks:
        place = "start" if share == 0 else "end" if share == 1 else "middle"
        parts.append(f'<path class="rule" d="M{share * width:g},0 V{height}"/>')
        parts.append(
            f'<text class="mark" text-anchor="{place}" x="{share * width:g}" '
            f'y="{height + 1.4 * foot:g}">{word}</text>'
        )
    for share, word in ((0.0, "up"), (0.5, "view direction"), (1.0, "down")):
        y_text = min(max(share * height - 0.3 * foot, 1.0 * foot), height - 0.4 * foot)
        parts.append(f'<text class="mark over" x="{0.006 * width:g}" y="{y_text:g}">{word}</text>')
    parts.append(f'<path class="rule" d="M0,{height / 2:g} H{width}"/>')
    return Markup("".join(parts) + "</svg>")


def _outline(size: tuple[int, int], intrinsics: Float64Array, frame: tuple[int, int]) -> str:
    """Return the border of a view in its panorama, an SVG polygon."""
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
    return f'<polygon class="outline" points="{outline}"/>'


def _connect(start: Box, end: Box) -> str:
    """Return a smooth path between the facing sides of two boxes."""
    (x0, y0, w0, h0), (x1, y1, w1, h1) = start, end
    if x1 >= x0 + w0:  # to the right
        a, b = (x0 + w0, y0 + h0 / 2), (x1 - 2, y1 + h1 / 2)
        bend = (a[0] + b[0]) / 2
        return f"M{a[0]:g},{a[1]:g} C{bend:g},{a[1]:g} {bend:g},{b[1]:g} {b[0]:g},{b[1]:g}"
    a, b = (x0 + w0 / 2, y0 + h0), (x1 + w1 / 2, y1 - 2)
    bend = (a[1] + b[1]) / 2
    return f"M{a[0]:g},{a[1]:g} C{a[0]:g},{bend:g} {b[0]:g},{bend:g} {b[0]:g},{b[1]:g}"
