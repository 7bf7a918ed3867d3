"""Scores of a submission: metrics of each view, means with intervals over scenes, seconds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pbrnet.model.benchmark.metrics import local_rmse, normal_errors, scale_invariant_rmse
from pbrnet.model.benchmark.pictures import SUFFIXES, Task, find_picture, read_picture, read_seconds
from pbrnet.model.benchmark.views import ViewList, truths
from pbrnet.model.evaluation.metrics import bootstrap, measure
from pbrnet.pipeline.export.rows import Content, DatasetRows, ViewRow
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.terminal import visible
from pbrnet.pipeline.tonemap import ToneParams, exposure_of, tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.checked import plain
from pbrnet.scenes.color import luminance
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json

# Metrics of each task in the order of the table, and the digits of each.
METRICS: dict[Task, dict[str, int]] = {
    "color": {"ssim": 3, "psnr": 1, "flip": 3, "stops": 2},
    "albedo": {"si_rmse": 4, "local_rmse": 4},
    "normal": {
        "mean_angle": 2,
        "median_angle": 2,
        "within_11.25": 3,
        "within_22.5": 3,
        "within_30": 3,
    },
}
ExposureRule = Literal["own", "truth"]
_LEAST_SIDE = 11  # pixels: SSIM's window


@dataclass(frozen=True)
class ViewScore:
    """Metrics of a view; seconds are None where the submission does not say them."""

    scene_id: str
    view_id: str
    values: dict[str, float]
    seconds: float | None


@dataclass(frozen=True)
class Score:
    """A submission's scores; `about` is its own description of itself."""

    name: str
    task: Task
    exposure: ExposureRule
    views: tuple[ViewScore, ...]
    about: dict[str, Any]

    def summary(self, seed: int = 0) -> dict[str, Any]:
        """Return means with 95 % intervals over scenes, CPU seconds a view, and every view."""
        return {
            "name": self.name,
            "about": self.about,
            "task": self.task,
            **({"exposure": self.exposure} if self.task == "color" else {}),
            "views": len(self.views),
            "scenes": len({view.scene_id for view in self.views}),
            "metrics": {name: self._interval(name, seed) for name in METRICS[self.task]},
            "seconds": self.seconds,
            "per_view": [plain(view) for view in self.views],
        }

    @property
    def seconds(self) -> float | None:
        """Mean CPU seconds a view; None unless every view has them."""
        spent = [view.seconds for view in self.views if view.seconds is not None]
        return float(np.mean(spent)) if len(spent) == len(self.views) else None

    def _interval(self, name: str, seed: int) -> dict[str, float | None] | None:
        scenes: dict[str, list[float]] = {}
        for view in self.views:
            if name in view.values:
                scenes.setdefault(view.scene_id, []).append(view.values[name])
        return None if not scenes else plain(bootstrap(scenes, seed))


def score_folder(
    folder: Path,
    rows: DatasetRows,
    views: ViewList | None,
    task: Task,
    exposure: ExposureRule = "own",
    tone: ToneParams | None = None,
) -> Score:
    """Score the pictures in a folder; one view is in memory at a time.

    Raises `InputError` if a view has no picture, or a picture cannot be read or compared.
    """
    tone = tone or ToneParams()
    wanted = _wanted(rows, views)
    missing = [row.name for row in wanted if find_picture(folder, row) is None]
    if missing:
        kinds = " or ".join(SUFFIXES)
        raise InputError(
            f"{folder}: {len(missing)} of {len(wanted)} views have no image; first: "
            f"{missing[0]}, expected as SCENE--VIEW or SCENE/VIEW with {kinds}"
        )
    seconds = read_seconds(folder)
    scores = []
    with Progress(len(wanted), "score") as progress:
        for row, content in truths(rows, views):
            path = find_picture(folder, row)
            if path is None:  # gone since
                raise InputError(f"{folder}: the image of {row.name} is missing")
            values = _values(path, row, content, task, exposure, tone)
            for name, value in values.items():
                if math.isnan(value):
                    raise InputError(f"{path}: {name} is not a number, of this and the truth")
            spent = seconds
            if isinstance(seconds, dict):
                spent = seconds.get(f"{row.scene_id}--{row.view_id}")
            found = spent if isinstance(spent, float) else None
            scores.append(ViewScore(row.scene_id, row.view_id, values, found))
            progress.advance()
    return Score(folder.resolve().name, task, exposure, tuple(scores), _about(folder))


def _wanted(rows: DatasetRows, views: ViewList | None) -> list[ViewRow]:
    """Return the rows to score; `InputError` for a listed view that is missing."""
    if views is None:
        return rows.rows
    known = {(row.scene_id, row.view_id): row for row in rows.rows}
    names = [(view.scene_id, view.view_id) for view in views.views]
    for name in names:
        if name not in known:
            raise InputError(
                f"{rows.folder}: the view {'/'.join(name)} of the list {views.name} is not in "
                "this dataset"
            )
    return [known[name] for name in names]


def _values(
    path: Path, row: ViewRow, content: Content, task: Task, exposure: ExposureRule, tone: ToneParams
) -> dict[str, float]:
    truth = content.images
    height, width = truth["valid"].shape
    picture, linear = read_picture(path, task, (width, height))
    mask = truth["valid"] > 0
    if task == "albedo":
        return {
            "si_rmse": scale_invariant_rmse(truth["reflectance"], picture, mask),
            "local_rmse": local_rmse(truth["reflectance"], picture, mask),
        }
    if task == "normal":
        return normal_errors(truth["normal"], picture, mask)
    if min(width, height) < _LEAST_SIDE:
        raise InputError(
            f"{path}: {width} x {height} pixels; SSIM requires {_LEAST_SIDE} on a side"
        )
    if (picture < 0).any():
        picture = np.maximum(picture, 0)  # a filter's ringing
    values = {}
    pair = [tonemap(truth["color"], row.exposure), picture]
    if linear:
        both = (truth["color"], picture)
        by_own = exposure == "own"
        pair = [tonemap(one, exposure_of(one, tone) if by_own else row.exposure) for one in both]
        values["stops"] = _stops(*both)
    found = measure(*pair)
    return {name: value for name, value in found.items() if value is not None} | values


def _stops(truth: AnyArray, picture: AnyArray) -> float:
    """Return how far the picture's mean luminance is from the truth's, in stops."""
    means = [float(luminance(image.astype(np.float64)).mean()) for image in (truth, picture)]
    return abs(float(np.log2(max(means[1], 1e-12) / max(means[0], 1e-12))))


def _about(folder: Path) -> dict[str, Any]:
    """Return `about.json` of a submission: method, samples, machine, as its maker says."""
    path = folder / "about.json"
    if not path.is_file():
        return {}
    found = read_json(path)
    if not isinstance(found, dict):
        raise InputError(f"{path}: expected an object, such as {{'samples': 4}}")
    return found


def table(scores: Iterable[Score], seed: int = 0) -> list[str]:
    """Return submissions of one task as the lines of a table: means, intervals, seconds."""
    scores = list(scores)
    task = scores[0].task
    names = METRICS[task]
    lines = [["", *names, "CPU s"]]
    for score in scores:
        summary = score.summary(seed)
        cells = [visible(score.name)]
        for name, digits in names.items():
            interval = summary["metrics"][name]
            if interval is None:
                cells.append("-")
                continue
            text = f"{interval['mean']:.{digits}f}"
            if interval["low"] is not None:
                text += f" ({interval['low']:.{digits}f} to {interval['high']:.{digits}f})"
            cells.append(text)
        cells.append("-" if score.seconds is None else f"{score.seconds:.3g}")
        lines.append(cells)
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]
