"""Style of the charts that matplotlib draws: colours, sizes and grid, for PNG files and the report.

Colours of series and ink are fixed values, which the report replaces by colours of its light or
dark theme (`pbrnet.model.figures.charts.inline_svg`).
"""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

SERIES = ("#1f6fb2", "#c9541a", "#2c8a4b", "#8b4fae", "#a37c00", "#4f5d6b")
INK, SOFT_INK, RULE = "#1d1d1e", "#62636c", "#dedbd4"  # text, secondary text, grid
SIZE = (6.0, 2.9)  # of a chart, inches
_LEGEND_CHARACTERS = 76  # in a row of a legend, with 8 for each marker


def new_chart(size: tuple[float, float] = SIZE) -> tuple[Figure, Axes]:
    """Return a figure of `size` inches with one styled pair of axes."""
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    axes = figure.subplots()
    style_axes(axes)
    return figure, axes


def style_axes(axes: Axes) -> None:
    """Apply the style: light grid, no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["bottom", "left"]].set_color(SOFT_INK)
    axes.tick_params(colors=SOFT_INK, labelcolor=SOFT_INK, labelsize=9)
    axes.grid(True, color=RULE)
    axes.set_axisbelow(True)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_color(SOFT_INK)
        label.set_fontsize(9)


def add_legend(axes: Axes) -> None:
    """Add a legend above the axes if a series has a label; the figure grows by its height."""
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        columns = max(1, int(_LEGEND_CHARACTERS / (max(map(len, labels)) + 8)))
        figure = axes.get_figure(root=True)
        assert isinstance(figure, Figure)
        figure.set_figheight(figure.get_figheight() + 0.2 * -(-len(labels) // columns))
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=columns,
            fontsize=9,
            frameon=False,
            labelcolor=INK,
            borderaxespad=0.2,
        )
