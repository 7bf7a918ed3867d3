"""Plot of the time study: error against the reference over seconds per view."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pbrnet.model.studies.time.results import CLOCKS, RENDERERS, TimeResult
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.pipeline.terminal import views_of

_LINES = {
    "mitsuba": ("#7f7f7f", "-"),
    "mitsuba_denoised": ("#1f77b4", "-"),
    "planned": ("#7f7f7f", "--"),
    "planned_denoised": ("#1f77b4", "--"),
}
_COLUMNS = 2  # of the legend
_MARKS = ("o", "s", "D", "^", "v", "P", "X", "*", "<", ">")
_COLOURS = (
    *("#d62728", "#ff7f0e", "#2ca02c", "#9467bd", "#8c564b"),
    *("#e377c2", "#bcbd22", "#17becf", "#111111", "#1b5e20"),
)


def time_plot(result: TimeResult) -> bytes:
    """Return a PNG with two panels, FLIP and SSIM over seconds per view.

    Seconds and FLIP are logarithmic.
    """
    figure = time_figure(result)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def time_figure(result: TimeResult) -> Figure:
    """Return the figure that `time_plot` encodes."""
    figure = Figure(figsize=(12, 5.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2)
    _panel(axes[0], result, "flip", "ꟻLIP: lower is nearer to the reference")
    _panel(axes[1], result, "ssim", "SSIM: higher is nearer to the reference")
    width, height = result.size
    handles, labels = axes[0].get_legend_handles_labels()
    rows = -(-len(labels) // _COLUMNS)
    figure.set_figheight(4.4 + 0.2 * rows)
    figure.legend(handles, labels, loc="outside lower center", ncols=_COLUMNS, fontsize=9)
    figure.suptitle(
        f"{width}x{height}, {views_of(result.views, result.scenes, result.split)}; "
        f"numbers: samples per pixel, reference {result.reference_spp}",
        fontsize=11,
    )
    return figure


def _panel(axes: Axes, result: TimeResult, measure: str, words: str) -> None:
    for method, (colour, dashes) in _LINES.items():
        line = [point for point in result.points if point.method == method]
        if not line:
            continue
        line.sort(key=lambda point: point.spp or 0)
        seconds, values = [p.seconds for p in line], [getattr(p, measure) for p in line]
        label = RENDERERS[method]
        axes.plot(seconds, values, dashes, color=colour, marker=".", label=label)
        for point, x, y in zip(line, seconds, values, strict=True):
            axes.annotate(
                str(point.spp), (x, y), (3, 4), textcoords="offset points", fontsize=7, color=colour
            )
    networks = dict.fromkeys(p.method for p in result.points if p.method not in RENDERERS)
    for index, method in enumerate(networks):
        line = [point for point in result.points if point.method == method]
        line.sort(key=lambda point: point.seconds)
        axes.plot(
            [point.seconds for point in line],
            [getattr(point, measure) for point in line],
            "-" + _MARKS[index % len(_MARKS)],
            color=_COLOURS[index % len(_COLOURS)],
            markersize=9 if len(line) == 1 else 5,
            label=METHOD_TITLES.get(method, method),
        )
    axes.set_xscale("log")
    if measure == "flip":
        axes.set_yscale("log")
    for axis in (axes.xaxis, *([axes.yaxis] if measure == "flip" else [])):
        for set_formatter in (axis.set_major_formatter, axis.set_minor_formatter):
            set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.tick_params(which="both", labelsize=8)
    axes.set_xlabel(f"{CLOCKS[result.clock]} per view, with all parts that it needs")
    axes.set_ylabel(words)
    axes.grid(True, which="both", alpha=0.25)
