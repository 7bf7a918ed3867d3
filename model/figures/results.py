"""Results of the evaluation for the report: learning curves, table of methods, example views."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pbrnet.model.figures.charts import line_chart, strip_plot
from pbrnet.model.figures.estimates import interval
from pbrnet.model.figures.records import METRICS, Records
from pbrnet.model.figures.row_pictures import MODALITIES, shrink, tone_mapped, uri
from pbrnet.model.titles import METHOD_TITLES, NETWORK_TITLES
from pbrnet.pipeline.images import Picture
from pbrnet.pipeline.photograph import channel_picture

EXAMPLE_PARTS = {
    "prediction": "Prediction",
    "shading": "Predicted shading",
    "error": "Error (ꟻLIP): bright is wrong",
    **{
        name: title
        for name, title in NETWORK_TITLES.items()
        if name not in ("shading", "composition")
    },
    "product": "Reflectance × shading",
}


def result_table(records: Records) -> dict[str, Any] | None:
    """Return the table of methods for the report's template; None without an evaluation."""
    evaluation = records.evaluation
    if not evaluation:
        return None
    kept_back = evaluation.get("kept_back")
    table = _rows(evaluation.get("methods", {}))
    return {
        "split": evaluation.get("split", ""),
        "views": evaluation.get("views", 0),
        "scenes": evaluation.get("scenes", 0),
        "exposure": evaluation.get("exposure", ""),
        "metrics": [
            {"label": label, "better": "higher" if higher else "lower"}
            for label, higher, _ in METRICS.values()
        ],
        "table": table,
        "kept_back": kept_back and {**kept_back, "table": _rows(kept_back["methods"])},
        "no_lpips": all(row["cells"][-1] is None for row in table),
        "timing": sorted(evaluation.get("timing", {}).items()),
    }


def _rows(methods: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row per method with formatted figures; the best of each column is marked."""
    best = {}
    for name, (_, higher, _) in METRICS.items():
        means = {
            method: figure["mean"]
            for method, values in methods.items()
            if method != "ceiling" and (figure := figure_of(values, name))
        }
        if means:
            best[name] = (max if higher else min)(means, key=lambda method: means[method])
    return [
        {
            "name": method,
            "title": METHOD_TITLES.get(method, method),
            "cells": [
                _cell(figure_of(methods[method], name), digits, best.get(name) == method)
                for name, (_, _, digits) in METRICS.items()
            ],
            "seconds": methods[method].get("seconds"),
        }
        for method in known_first(methods, METHOD_TITLES)
    ]


def _cell(figure: Mapping[str, Any] | None, digits: int, best: bool) -> dict[str, Any] | None:
    if figure is None:
        return None
    around = interval(figure.get("low"), figure.get("high"), digits)
    return {"mean": f"{figure['mean']:.{digits}f}", "interval": around, "best": best}


def score_strips(records: Records) -> list[dict[str, Any]]:
    """Return strip plots of FLIP and SSIM of every view, by method."""
    groups: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for line in records.scores():
        for name in ("flip", "ssim"):
            if line[name] is not None:
                groups[name][line["method"]].append(line[name])
    return [
        {
            "name": METRICS[name][0],
            "svg": strip_plot(
                {method: values[method] for method in known_first(values, METHOD_TITLES)},
                f"{METRICS[name][0]} of every view",
            ),
        }
        for name, values in groups.items()
    ]


def learning_curves(records: Records) -> list[dict[str, Any]]:
    """Return the learning curves of all trained networks, with their last losses."""
    curves = []
    columns = {"training": "train_loss", "validation": "validation_loss"}
    paths = {
        path.stem.removeprefix("train_"): path
        for path in sorted(records.places.plots.glob("train_*.csv"))
    }
    for name in known_first(paths, NETWORK_TITLES):
        path = paths[name]
        lines = records.csv(path, "step", *columns.values())
        series = {
            label: [(line["step"], line[column]) for line in lines if line[column] is not None]
            for label, column in columns.items()
        }
        series = {label: points for label, points in series.items() if points}
        if series:
            curves.append(
                {
                    "title": NETWORK_TITLES.get(name, name),
                    "svg": line_chart(series, "step", "loss"),
                    "last": {label: points[-1][1] for label, points in series.items()},
                }
            )
    if not curves:
        records.missing.append(
            "No learning curves yet; make them with: pbrnet train shading, pbrnet train composition"
        )
    return curves


def best_and_worst(
    records: Records,
    keys: Mapping[str, Sequence[tuple[str, str]]],
    rows: Mapping[tuple[str, str], dict[str, Any]],
) -> dict[str, list[dict[str, Any]]]:
    """Return the pictures of the best and worst views; `keys`: group -> views."""
    method = records.evaluation.get("examples_of", "pbrnet")
    scores = {
        (line["scene_id"], line["view_id"]): line
        for line in records.scores()
        if line["method"] == method
    }
    shared = records.evaluation.get("exposure") == "shared"
    return {
        group: [
            _example(records, key, rows.get(key), scores.get(key, {}), shared) for key in members
        ]
        for group, members in keys.items()
    }


def _example(
    records: Records,
    key: tuple[str, str],
    row: dict[str, Any] | None,
    score: Mapping[str, Any],
    shared: bool,
) -> dict[str, Any]:
    parts = {part: records.example_picture(*key, part) for part in EXAMPLE_PARTS}
    drawn: dict[str, Picture | None] = {}
    if row is not None:
        for name in ("depth", "normal", "reflectance", "intensity", "distance"):
            drawn[MODALITIES[name][0]] = channel_picture(name, row)
        drawn["True shading"] = tone_mapped("shading", row)
    drawn[EXAMPLE_PARTS["shading"]] = parts.pop("shading")
    if row is not None:
        # Under the exposure policy of the training.
        drawn["Truth"] = tone_mapped("color", row, shared)
    drawn.update({EXAMPLE_PARTS[part]: picture for part, picture in parts.items()})
    figures = [
        f"{label} {score[name]:.{digits}f}"
        for name, (label, _, digits) in METRICS.items()
        if score.get(name) is not None
    ]
    return {
        "label": " / ".join(key),
        "figures": ", ".join(figures),
        "pictures": [
            {"label": label, "uri": uri(shrink(picture))}
            for label, picture in drawn.items()
            if picture is not None
        ],
    }


def known_first(names: Iterable[str], known: Iterable[str]) -> list[str]:
    """Sort `names`: in the order of `known`, then unknown names alphabetically."""
    order = list(known)
    return sorted(names, key=lambda name: (order.index(name) if name in order else 99, name))


def figure_of(values: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """Return mean and interval of a metric; None if missing. A bare number is a mean."""
    figure = values.get(name)
    if isinstance(figure, (int, float)):
        return {"mean": float(figure), "low": None, "high": None}
    return figure if isinstance(figure, dict) and figure.get("mean") is not None else None
