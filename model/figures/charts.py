"""Charts of the report: line charts and strip plots, drawn by matplotlib as inline SVG."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from pbrnet.pipeline.plotting import INK, RULE, SERIES, SIZE, SOFT_INK, add_legend, new_chart

Points = Sequence[tuple[float, float]]
_THEME = {
    INK: "var(--ink)",
    SOFT_INK: "var(--soft)",
    RULE: "var(--rule)",
    **{color: f"var(--s{index})" for index, color in enumerate(SERIES)},
    "#ffffff": "none",  # background
    "#000000": "var(--ink)",
}
_SVG = {"svg.fonttype": "none", "svg.hashsalt": "pbrnet"}  # text as text; reproducible ids
_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))


def inline_svg(figure: Figure) -> Markup:
    """Return a figure as an `<svg>` element in the colours of the page's theme.

    The result is reproducible: it has no date, and its ids do not depend on chance.
    """
    stream = io.StringIO()
    with mpl.rc_context(_SVG):
        figure.savefig(stream, format="svg", metadata=_NO_METADATA)
    return Markup(_themed(stream.getvalue()))


def _themed(text: str) -> str:
    """Return matplotlib's SVG as a small element without fixed colours, fonts and global styles."""
    text = text[text.index("<svg") :].replace("xlink:href", "href")
    text = re.sub(
        r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', r'<svg class="chart" role="img" \1>', text, count=1
    )
    text = re.sub(r"<!--.*?-->\s*|<style.*?</style>\s*", "", text, flags=re.DOTALL)
    used = set(re.findall(r"#([\w.-]+)", text))
    text = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", text)
    text = re.sub(r"font-family: [^;\"]*", "font-family: inherit", text)
    text = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\.\d\d)\d+", r"\1", tag[0]), text)
    colors = "|".join(map(re.escape, _THEME))
    return re.sub(rf"(?<=: )({colors})\b", lambda found: _THEME[found[1]], text)


def line_chart(series: Mapping[str, Points], x_label: str, y_label: str) -> Markup:
    """Draw lines over a common x axis; empty without finite points."""
    figure = line_figure(series, x_label, y_label)
    return inline_svg(figure) if figure else Markup("")


def line_figure(series: Mapping[str, Points], x_label: str, y_label: str) -> Figure | None:
    """Return the figure of `line_chart`; y is logarithmic if it spans more than a decade."""
    lines = {label: [point for point in line if _finite(point)] for label, line in series.items()}
    values = [y for line in lines.values() for _, y in line]
    if not values:
        return None
    figure, axes = new_chart()
    for index, (label, line) in enumerate(lines.items()):
        if line:
            marker = "." if len(line) <= 30 else ""
            color = SERIES[index % len(SERIES)]
            axes.plot(*np.transpose(line), color=color, marker=marker, label=label)
    if min(values) > 0 and max(values) / min(values) > 10:
        axes.set_yscale("log")
        y_label += ", logarithmic"
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    add_legend(axes)
    return figure


def strip_plot(groups: Mapping[str, Sequence[float]], label: str) -> Markup:
    """Draw a row of ticks per group, one per value, and a bar at the mean; empty without values."""
    figure = strip_figure(groups, label)
    return inline_svg(figure) if figure else Markup("")


def strip_figure(groups: Mapping[str, Sequence[float]], label: str) -> Figure | None:
    """Return the figure of `strip_plot`."""
    finite = {name: [v for v in values if math.isfinite(v)] for name, values in groups.items()}
    if not any(finite.values()):
        return None
    figure, axes = new_chart((SIZE[0], 0.8 + 0.3 * len(finite)))
    for row, values in enumerate(finite.values()):
        if values:
            color = SERIES[row % len(SERIES)]
            ticks = np.array([(value, value, np.nan) for value in values]).ravel()
            heights = np.tile([row - 0.25, row + 0.25, np.nan], len(values))
            axes.plot(ticks, heights, color=color, alpha=0.4, linewidth=1)
            mean = np.mean(values)
            axes.plot([mean, mean], [row - 0.4, row + 0.4], color=color, linewidth=3)
    axes.set_yticks(range(len(finite)), list(finite))
    axes.set_ylim(len(finite) - 0.4, -0.6)
    axes.set_xlabel(label)
    return figure


def _finite(point: tuple[float, float]) -> bool:
    return math.isfinite(point[0]) and math.isfinite(point[1])
