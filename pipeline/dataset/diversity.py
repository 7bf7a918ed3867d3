"""Diversity of a dataset: statistics of every view, and their distributions by source.

The statistics are quantities in which indoor views differ visibly: number of objects, depth,
luminance, saturation, and number and extent of lights around the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage

from pbrnet.pipeline.dataset.parquet import (
    check_filled,
    check_rows,
    check_types,
    images_of,
    open_parquet,
    reading,
)
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.errors import InputError

_COLUMNS = ("source", "objects", "depth", "valid", "color", "reflectance", "intensity")
_BINS = 24


@dataclass(frozen=True)
class Quantity:
    """A statistic of a view: its name in tables, its axis label, and its binning."""

    name: str
    label: str
    logarithmic: bool = False
    whole: bool = False


QUANTITIES = (
    Quantity("objects", "objects in view", whole=True),
    Quantity("depth", "mean depth, metres"),
    Quantity("luminance", "log-average luminance of colour", logarithmic=True),
    Quantity("saturation", "mean saturation of reflectance"),
    Quantity("lights", "lights in the panorama", whole=True),
    Quantity("lit", "share of the panorama that shines", logarithmic=True),
)


def view_figures(row: dict[str, Any]) -> dict[str, float]:
    """Return the statistics of one view, by the names of `QUANTITIES`.

    `row` holds `objects` and, as arrays, `depth` (H, W) in metres, `valid` (H, W), `color` and
    `reflectance` (H, W, 3), linear, and `intensity` (h, 2 h). Depth is averaged over valid pixels;
    saturation is (max - min) / max of linear reflectance, averaged over pixels; a light is a
    connected region of the panorama, whose left and right edges meet; `lit` is a share of the
    sphere's solid angle.
    """
    valid = np.asarray(row["valid"]) > 0
    colors = np.asarray(row["reflectance"], dtype=np.float64)[valid]
    high, low = (colors.max(-1), colors.min(-1)) if len(colors) else (np.zeros(1), np.zeros(1))
    light = luminance(np.asarray(row["color"], dtype=np.float64))
    shining = np.asarray(row["intensity"]) > 0
    rows = np.sin((np.arange(shining.shape[0]) + 0.5) * np.pi / shining.shape[0])
    return {
        "objects": float(row["objects"]),
        "depth": float(np.asarray(row["depth"])[valid].mean()) if valid.any() else 0.0,
        "luminance": float(np.exp(np.log(np.maximum(light, 1e-8)).mean())),
        "saturation": float(np.mean((high - low) / np.maximum(high, 1e-3))),
        "lights": float(count_lights(shining)),
        "lit": float((shining * rows[:, None]).sum() / (rows.sum() * shining.shape[1])),
    }


def count_lights(shining: BoolArray) -> int:
    """Return the number of connected regions (also by corners) of a panorama mask (h, w)."""
    labels, count = ndimage.label(shining, structure=np.ones((3, 3)))
    # Regions that touch across the seam are one: union by walking their pairs.
    parent = list(range(count + 1))

    def root(label: int) -> int:
        while parent[label] != label:
            label = parent[label]
        return label

    for shift in (-1, 0, 1):
        right = np.roll(labels[:, -1], shift)
        inside = np.ones(len(right), bool)
        if shift:
            inside[0 if shift > 0 else -1] = False
        for a, b in zip(labels[:, 0][inside], right[inside], strict=True):
            if a and b:
                parent[root(int(a))] = root(int(b))
    return len({root(label) for label in range(1, count + 1)})


def dataset_figures(shards: Sequence[Path]) -> dict[str, dict[str, Float64Array]]:
    """Return source -> quantity -> values (N,) over all views; reads one row group at a time.

    Raises `InputError` for shards that lack a column, such as those of an older version.
    """
    found: dict[str, list[dict[str, float]]] = {}
    for shard in shards:
        file = open_parquet(shard)
        missing = sorted(set(_COLUMNS) - set(file.schema_arrow.names))
        if missing:
            raise InputError(f"{shard}: has no column {missing[0]!r}; pack the dataset again")
        check_types(shard, file.schema_arrow, _COLUMNS)
        check_rows(shard, file)
        for group in range(file.metadata.num_row_groups):
            with reading(shard):
                table = file.read_row_group(group, columns=list(_COLUMNS))
            check_filled(shard, table, _COLUMNS)
            images = {name: images_of(shard, table, name) for name in _COLUMNS[2:]}
            for index in range(table.num_rows):
                row = {name: values[index] for name, values in images.items()}
                row["objects"] = table["objects"][index].as_py()
                source = str(table["source"][index].as_py())
                found.setdefault(source, []).append(view_figures(row))
    return {
        source: {
            quantity.name: np.array([view[quantity.name] for view in views])
            for quantity in QUANTITIES
        }
        for source, views in sorted(found.items())
    }


def summary_table(figures: dict[str, dict[str, Float64Array]]) -> list[dict[str, Any]]:
    """Return a row per source and quantity: views, 5 %, 50 % and 95 % quantiles, and mean."""
    return [
        {
            "source": source,
            "quantity": quantity.name,
            "views": len(values[quantity.name]),
            **summary_of(values[quantity.name]),
        }
        for source, values in figures.items()
        for quantity in QUANTITIES
    ]


def summary_of(values: Float64Array) -> dict[str, float]:
    """Return quantiles and mean of values (N,), to three digits."""
    low, median, high = np.quantile(values, (0.05, 0.5, 0.95))
    numbers = {"5 %": low, "median": median, "95 %": high, "mean": values.mean()}
    return {name: float(f"{number:.3g}") for name, number in numbers.items()}


def draw_figures(figures: dict[str, dict[str, Float64Array]]) -> Figure:
    """Draw histograms of every quantity, one outline per source, as shares of its views."""
    page = Figure(figsize=(12, 6.5), dpi=100, layout="constrained")
    colors = ("#3b76af", "#c9682d", "#4f9a54", "#a5435e", "#7a5ea8", "#6b6b6b")
    for axes, quantity in zip(page.subplots(2, 3).flat, QUANTITIES, strict=True):
        edges = _edges(quantity, np.concatenate([one[quantity.name] for one in figures.values()]))
        for number, (source, values) in enumerate(figures.items()):
            counts, _ = np.histogram(np.clip(values[quantity.name], edges[0], edges[-1]), edges)
            axes.stairs(
                counts / max(1, counts.sum()),
                edges,
                label=f"{source} ({len(values[quantity.name])})",
                color=colors[number % len(colors)],
                linewidth=1.8,
            )
        if quantity.logarithmic:
            axes.set_xscale("log")
        axes.set_xlabel(quantity.label)
        axes.set_ylim(bottom=0)
    page.axes[0].set_ylabel("share of views")
    page.axes[3].set_ylabel("share of views")
    page.axes[0].legend(fontsize=9)
    return page


def _edges(quantity: Quantity, values: Float64Array) -> Float64Array:
    low, high = np.quantile(values, (0.005, 0.995))
    if quantity.whole:
        return np.arange(np.floor(values.min()), np.ceil(high) + 2) - 0.5
    if quantity.logarithmic:
        floor = max(low, high * 1e-6, 1e-12)
        return np.geomspace(floor, max(high, floor * 1.01), _BINS + 1)
    return np.linspace(low, max(high, low + 1e-6), _BINS + 1)
