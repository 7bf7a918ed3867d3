"""The report stage: one self-contained HTML page that shows what happened.

It reads whatever is there (data, models, metrics, plots) and puts a sentence in the place of what
is not, naming the command that makes it. Pictures are embedded; the page asks the network for
nothing.
"""

from __future__ import annotations

import base64
import csv
import json
import platform
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pipeline.charts import TALL, WIDE, Node, chain, line_chart, panorama_guide, strip_plot
from pipeline.checks import REASONS
from pipeline.cost_charts import cost_drawings
from pipeline.ledger import read_ledger
from pipeline.params import Params
from pipeline.pictures import (
    Picture,
    contact_sheet,
    depth_picture,
    distance_picture,
    enlarge,
    fit,
    intensity_picture,
    jpeg_bytes,
    normal_picture,
    png_bytes,
    png_facts,
    read_picture,
    reflectance_picture,
    tone_picture,
)
from pipeline.tonemap import Exposure
from pipeline.views import load_cameras
from scenes.checked import plain
from scenes.contract import Scene, load_scene, scene_folders
from scenes.errors import InputError
from scenes.files import read_json, write_text

SHEET_VIEWS = 12
THUMBNAIL = 320  # pixels wide at most
MODALITIES = {
    "color": ("Colour", "The finished image, path traced; tone-mapped to look at."),
    "shading": ("Shading", "The same light on the same shapes, every colour removed."),
    "reflectance": ("Reflectance", "Base colour, without any light."),
    "normal": ("Normal", "Where surfaces face: red right, green up, blue towards the camera."),
    "depth": (
        "Depth",
        "Distance along the optical axis, logarithmic: near is bright, far is violet.",
    ),
    "intensity": ("Illumination: intensity", "Light sources all around the camera, logarithmic."),
    "distance": ("Illumination: distance", "How far away each of them is: near is bright."),
}
METHODS = {
    "pbrnet": "Both networks (shading, then composition)",
    "product": "Reflectance × predicted shading",
    "product_linear": "Reflectance × predicted shading, projected linearly",
    "unet": "One direct U-Net",
    "can": "CAN, trained with our loss",
    "can_own": "CAN, with its own loss: mean squares",
    "pix2pix": "pix2pix's generator, trained with our loss",
    "pix2pix_own": "pix2pix, with its own loss: adversarial and L1",
    "cyclegan": "CycleGAN's generator, trained with our loss",
    "cyclegan_own": "CycleGAN, with its own loss: unpaired, adversarial and cycles",
    "ceiling": "Reflectance × true shading: what the product could reach at best",
}
NETWORKS = {
    "shading": "Shading network",
    "composition": "Composition network",
    "unet": "Direct U-Net",
    "can": "CAN, our loss",
    "can_own": "CAN, its own loss",
    "pix2pix": "pix2pix, our loss",
    "pix2pix_own": "pix2pix, its own loss",
    "cyclegan": "CycleGAN, our loss",
    "cyclegan_own": "CycleGAN, its own loss",
}
METRICS = {
    "ssim": ("SSIM", True, 3),
    "psnr": ("PSNR (dB)", True, 2),
    "flip": ("ꟻLIP", False, 3),
    "lpips": ("LPIPS", False, 3),
}
EXAMPLE_PARTS = {
    "prediction": "Prediction",
    "shading": "Predicted shading",
    "error": "Error (ꟻLIP): bright is wrong",
    **{name: words for name, words in NETWORKS.items() if name not in ("shading", "composition")},
    "product": "Reflectance × shading",
}
PACKAGES = ("pbrnet", "mitsuba", "drjit", "numpy", "torch", "OpenEXR", "pyarrow", "dask")


@dataclass(frozen=True)
class Places:
    """Where the stages have left things."""

    data: Path = Path("data")
    models: Path = Path("models")
    metrics: Path = Path("metrics")
    plots: Path = Path("plots")
    predictions: Path = Path("predictions")


def write_report(places: Places, params: Params, out: Path) -> list[str]:
    """Write the page to `out` by rename; returns a sentence for each part that is missing."""
    page = _Page(places, params)
    write_text(out, page.render())
    return page.missing


class _Page:
    """Gathers the parts one after the other; what is not there goes into `missing`."""

    def __init__(self, places: Places, params: Params) -> None:
        self.places, self.params = places, params
        self.missing: list[str] = []
        self._tables: dict[Path, list[dict[str, Any]]] = {}
        self.scenes = self._scenes()
        self.cameras = self._cameras()
        self.shards = self._shards()
        self.evaluation: dict[str, Any] = self._json(
            places.metrics / "evaluation.json", "No evaluation yet; it is made by: pbrnet evaluate"
        )
        self.models = {
            path.stem: self._json(path, "") for path in sorted(places.models.glob("*.json"))
        }

    def render(self) -> str:
        """The whole page."""
        wanted = self._spread(SHEET_VIEWS)
        examples = self._example_keys()
        rows = self._rows({*wanted, *(key for group in examples.values() for key in group)})
        sheet = [rows[key] for key in wanted if key in rows]
        environment = Environment(
            loader=PackageLoader("pipeline"),
            undefined=StrictUndefined,
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.filters["thousands"] = lambda number: f"{number:,}".replace(",", " ")
        environment.filters["seconds"] = _duration
        return environment.get_template("report.html").render(
            headline=self._headline(),
            chain=self._chain(sheet),
            sheets=self._sheets(sheet),
            guide=self._guide(sheet),
            candidates=self._candidates(),
            rejected=self._rejected(),
            reasons=REASONS,
            dataset=self._dataset(),
            curves=self._curves(),
            results=self._results(),
            strips=self._strips(),
            examples=self._examples(examples, rows),
            predictions=self._predictions(),
            costs=self._costs(),
            imports=self._imports(),
            credits=self._credits(),
            backbone=self._backbone(),
            parameters=yaml.safe_dump(plain(self.params), sort_keys=False, allow_unicode=True),
            versions=_versions(),
            notes=self.missing,
        )

    # What is on the disk

    def _scenes(self) -> list[Scene]:
        scenes = []
        for folder in scene_folders(self.places.data / "scenes"):
            try:
                scenes.append(load_scene(folder))
            except InputError as error:
                self.missing.append(f"A scene cannot be read: {error}")
        if not scenes:
            self.missing.append("No scenes yet; they are made by: pbrnet scenes")
        return scenes

    def _cameras(self) -> list[Any]:
        cameras = []
        for path in sorted((self.places.data / "cameras").glob("*.json")):
            try:
                cameras.append(load_cameras(path))
            except InputError as error:
                self.missing.append(f"A camera file cannot be read: {error}")
        if not cameras:
            self.missing.append("No cameras yet; they are made by: pbrnet cameras")
        return cameras

    def _shards(self) -> list[pq.ParquetFile]:
        shards = []
        for path in sorted((self.places.data / "dataset").glob("*.parquet")):
            try:
                shards.append(pq.ParquetFile(path))
            except (pa.ArrowInvalid, OSError) as error:
                self.missing.append(f"{path} cannot be read ({error}); run: pbrnet dataset")
        if not shards:
            self.missing.append("No dataset yet; it is made by: pbrnet dataset")
        return shards

    def _json(self, path: Path, absent: str) -> dict[str, Any]:
        """A JSON object; empty and noted if the file is absent or damaged."""
        if not path.is_file():
            if absent:
                self.missing.append(absent)
            return {}
        try:
            content = read_json(path)
        except InputError as error:
            self.missing.append(str(error))
            return {}
        if not isinstance(content, dict):
            self.missing.append(f"{path} is damaged (no JSON object); make it again")
            return {}
        return content

    def _csv(self, path: Path, *numbers: str) -> list[dict[str, Any]]:
        """Lines of a CSV file; the columns `numbers` as floats, None where they are empty.

        Nothing if the file is absent; damaged files are noted once and count as absent.
        """
        if path not in self._tables:
            self._tables[path] = []
            if path.is_file():
                try:
                    self._tables[path] = _read_csv(path, numbers)
                except (UnicodeDecodeError, csv.Error, KeyError, ValueError) as error:
                    self.missing.append(f"{path} is damaged ({error}); make it again")
        return self._tables[path]

    def _index(self) -> list[tuple[str, str]]:
        """(scene_id, view_id) of all rows, in the order of the shards."""
        keys = []
        for shard in self.shards:
            table = shard.read(columns=["scene_id", "view_id"])
            keys += list(
                zip(table["scene_id"].to_pylist(), table["view_id"].to_pylist(), strict=True)
            )
        return keys

    def _spread(self, count: int) -> list[tuple[str, str]]:
        """Keys of rows spread evenly over all scenes."""
        keys = sorted(self._index())
        if not keys:
            return []
        places = np.unique(np.linspace(0, len(keys) - 1, min(count, len(keys))).round())
        return [keys[int(place)] for place in places]

    def _rows(self, wanted: set[tuple[str, str]]) -> dict[tuple[str, str], dict[str, Any]]:
        """The wanted rows, images as arrays; reads one row group at a time."""
        rows = {}
        for shard in self.shards:
            for group in range(shard.num_row_groups):
                ids = shard.read_row_group(group, columns=["scene_id", "view_id"]).to_pylist()
                chosen = [
                    index
                    for index, row in enumerate(ids)
                    if (row["scene_id"], row["view_id"]) in wanted
                ]
                if chosen:
                    table = shard.read_row_group(group).take(chosen)
                    for index in range(table.num_rows):
                        row = _unpack(table, index)
                        rows[row["scene_id"], row["view_id"]] = row
        return rows

    # The parts of the page

    def _headline(self) -> list[tuple[str, str]]:
        views = sum(len(file.views) for file in self.cameras)
        rows = sum(shard.metadata.num_rows for shard in self.shards)
        figures = [
            (str(len(self.scenes)), "scenes"),
            (str(views), "views sampled"),
            (str(rows), "views in the dataset"),
        ]
        methods = self.evaluation.get("methods", {})
        for name, (label, _, digits) in METRICS.items():
            value = _figure(methods.get("pbrnet", {}), name)
            if value is not None:
                figures.append((f"{value['mean']:.{digits}f}", f"{label} on unseen scenes"))
        return figures

    def _chain(self, sheet: Sequence[dict[str, Any]]) -> dict[str, Markup]:
        views = sum(len(file.views) for file in self.cameras)
        rooms = sum(len(scene.rooms) for scene in self.scenes)
        rows = sum(shard.metadata.num_rows for shard in self.shards)
        size = f"{self.params.image.width}×{self.params.image.height}"
        row = max(sheet, key=lambda row: np.count_nonzero(row["intensity"]), default=None)
        picture = {name: _uri(fit(_draw(name, row), 200)) for name in MODALITIES} if row else {}
        scenes, many = _mosaic(sheet, 2, 2), _mosaic(sheet, 4, 3)
        flip = _figure(self.evaluation.get("methods", {}).get("pbrnet", {}), "flip")
        epochs = {
            name: _first(card, ("epochs",), ("training", "epochs"))
            for name, card in self.models.items()
        }
        backbone = self._backbone()
        nodes = {
            "scenes": Node("Scenes", f"{len(self.scenes)} with {rooms} rooms", scenes),
            "cameras": Node("Cameras", f"{views} views", picture.get("color", "")),
            "inputs": Node("Inputs", size, picture.get("normal", "")),
            "illumination": Node(
                "Illumination",
                f"{self.params.illumination.width} wide",
                picture.get("intensity", ""),
            ),
            "groundtruth": Node(
                "Ground truth", f"{self.params.groundtruth.spp} samples", picture.get("shading", "")
            ),
            "dataset": Node("Dataset", f"{rows} rows", many),
            "backbone": Node("Backbone", backbone.get("network", "not there yet")),
            "shading": Node(
                "Shading network", _epochs(epochs.get("shading")), self._shown("shading")
            ),
            "composition": Node(
                "Composition", _epochs(epochs.get("composition")), self._shown("prediction")
            ),
            "evaluate": Node(
                "Evaluation",
                f"ꟻLIP {flip['mean']:.3f}" if flip else "not there yet",
                self._shown("error"),
            ),
        }
        return {"wide": chain(nodes, WIDE, "wide"), "tall": chain(nodes, TALL, "tall")}

    def _shown(self, part: str) -> str:
        """A small version of the best example's picture of that kind, if there is one."""
        for scene_id, view_id in self._example_keys().get("best", []):
            picture = self._example_picture(scene_id, view_id, part)
            if picture is not None:
                return _uri(fit(picture, 200))
        return ""

    def _sheets(self, sheet: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        if not sheet:
            return []
        return [
            {
                "title": title,
                "words": words,
                "wide": name in ("intensity", "distance"),
                "pictures": [
                    {"uri": _uri(_shrink(_draw(name, row))), "label": _row_label(row)}
                    for row in sheet
                ],
            }
            for name, (title, words) in MODALITIES.items()
        ]

    def _guide(self, sheet: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
        """One panorama, large, with its directions: the one that shows most light sources."""
        if not sheet:
            return None
        row = max(sheet, key=lambda row: np.count_nonzero(row["intensity"]))
        width = 960
        pictures = {name: enlarge(_draw(name, row), width) for name in ("intensity", "distance")}
        height, width = pictures["intensity"].shape[:2]
        lit = row["distance"][row["distance"] > 0]
        return {
            "label": _row_label(row),
            "color": _uri(_shrink(_draw("color", row))),
            "svg": panorama_guide(
                _uri(pictures["intensity"], png=True),
                (width, height),
                row["K"],
                (row["width"], row["height"]),
            ),
            "distance": _uri(pictures["distance"], png=True),
            "share": float(np.mean(row["intensity"] > 0)),
            "near": float(lit.min()) if lit.size else 0.0,
            "far": float(lit.max()) if lit.size else 0.0,
        }

    def _candidates(self) -> dict[str, Any]:
        dropped: Counter[str] = Counter()
        for file in self.cameras:
            dropped.update(file.rejected)
        total = sum(file.candidates for file in self.cameras)
        kept = sum(len(file.views) for file in self.cameras)
        return {"total": total, "kept": kept, "bars": _bars(dropped.most_common())}

    def _rejected(self) -> dict[str, Any] | None:
        path = self.places.data / "dataset" / "rejected.csv"
        if not path.is_file():
            return None
        lines = self._csv(path)
        counts = Counter(line.get("reason", "unknown") for line in lines)
        return {"total": len(lines), "bars": _bars(counts.most_common()), "lines": lines[:50]}

    def _dataset(self) -> dict[str, Any] | None:
        if not self.shards:
            return None
        tables = [
            shard.read(columns=["scene_id", "split", "room_type", "lighting", "licence"])
            for shard in self.shards
        ]
        rows = pa.concat_tables(tables).to_pylist()
        splits = Counter(row["split"] for row in rows)
        folder = self.places.data / "dataset"
        return {
            "splits": [
                {
                    "name": split,
                    "views": splits[split],
                    "scenes": len({row["scene_id"] for row in rows if row["split"] == split}),
                }
                for split in ("train", "validation", "test")
            ],
            "rooms": _bars(Counter(row["room_type"] for row in rows).most_common()),
            "lighting": _bars(Counter(row["lighting"] for row in rows).most_common()),
            "licences": Counter(row["licence"] for row in rows).most_common(),
            "shards": len(self.shards),
            "megabytes": sum(path.stat().st_size for path in folder.glob("*.parquet")) / 1e6,
        }

    def _curves(self) -> list[dict[str, Any]]:
        curves = []
        columns = {"training": "train_loss", "validation": "validation_loss"}
        paths = {
            path.stem.removeprefix("train_"): path
            for path in sorted(self.places.plots.glob("train_*.csv"))
        }
        # Those of the chain first, in its order, then whatever else was trained.
        for name in _known_first(paths, NETWORKS):
            path = paths[name]
            lines = self._csv(path, "step", *columns.values())
            series = {
                label: [(line["step"], line[column]) for line in lines if line[column] is not None]
                for label, column in columns.items()
            }
            series = {label: points for label, points in series.items() if points}
            if series:
                curves.append(
                    {
                        "title": NETWORKS.get(name, name),
                        "svg": line_chart(series, "step", "loss"),
                        "series": list(series),
                        "last": {label: points[-1][1] for label, points in series.items()},
                    }
                )
        if not curves:
            self.missing.append(
                "No learning curves yet; they are made by: pbrnet train shading, "
                "pbrnet train composition"
            )
        return curves

    def _results(self) -> dict[str, Any] | None:
        if not self.evaluation:
            return None
        methods: dict[str, Any] = self.evaluation.get("methods", {})
        best = {}
        for name, (_, higher, _) in METRICS.items():
            means = {
                method: figure["mean"]
                for method, values in methods.items()
                if method != "ceiling" and (figure := _figure(values, name))
            }
            if means:
                best[name] = (max if higher else min)(means, key=lambda method: means[method])
        table = []
        for method in _known_first(methods, METHODS):
            values = methods[method]
            cells = []
            for name, (_, _, digits) in METRICS.items():
                figure = _figure(values, name)
                cells.append(
                    None
                    if figure is None
                    else {
                        "mean": f"{figure['mean']:.{digits}f}",
                        "interval": _interval(figure, digits),
                        "best": best.get(name) == method,
                    }
                )
            table.append(
                {
                    "name": method,
                    "words": METHODS.get(method, method),
                    "cells": cells,
                    "seconds": values.get("seconds"),
                }
            )
        return {
            "split": self.evaluation.get("split", ""),
            "views": self.evaluation.get("views", 0),
            "scenes": self.evaluation.get("scenes", 0),
            "exposure": self.evaluation.get("exposure", ""),
            "metrics": [
                {"label": label, "better": "higher" if higher else "lower"}
                for label, higher, _ in METRICS.values()
            ],
            "table": table,
            "no_lpips": all(row["cells"][-1] is None for row in table),
            "timing": sorted(self.evaluation.get("timing", {}).items()),
        }

    def _strips(self) -> list[dict[str, Any]]:
        groups: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
        for line in self._scores():
            for name in ("flip", "ssim"):
                if line[name] is not None:
                    groups[name][line["method"]].append(line[name])
        return [
            {
                "name": METRICS[name][0],
                "svg": strip_plot(
                    {method: values[method] for method in _known_first(values, METHODS)},
                    f"{METRICS[name][0]} of every view",
                ),
            }
            for name, values in groups.items()
        ]

    def _scores(self) -> list[dict[str, Any]]:
        return self._csv(self.places.metrics / "evaluation.csv", *METRICS)

    def _example_keys(self) -> dict[str, list[tuple[str, str]]]:
        chosen = self.evaluation.get("examples", {})
        return {
            group: [(str(key[0]), str(key[1])) for key in chosen.get(group, []) if len(key) == 2]
            for group in ("best", "worst")
        }

    def _example_picture(self, scene_id: str, view_id: str, part: str) -> Picture | None:
        path = self.places.metrics / "examples" / f"{scene_id}--{view_id}--{part}.png"
        if not path.is_file():
            return None
        try:
            return read_picture(path.read_bytes())
        except (OSError, ValueError):
            note = f"{path} is damaged; make it again with: pbrnet evaluate"
            if note not in self.missing:
                self.missing.append(note)
            return None

    def _examples(
        self,
        keys: Mapping[str, Sequence[tuple[str, str]]],
        rows: Mapping[tuple[str, str], dict[str, Any]],
    ) -> dict[str, list[dict[str, Any]]]:
        scores = {
            (line["scene_id"], line["view_id"]): line
            for line in self._scores()
            if line["method"] == "pbrnet"
        }
        shared = self.evaluation.get("exposure") == "shared"
        return {
            group: [
                self._example(key, rows.get(key), scores.get(key, {}), shared) for key in members
            ]
            for group, members in keys.items()
        }

    def _example(
        self,
        key: tuple[str, str],
        row: dict[str, Any] | None,
        score: Mapping[str, Any],
        shared: bool,
    ) -> dict[str, Any]:
        parts = {part: self._example_picture(*key, part) for part in EXAMPLE_PARTS}
        drawn: dict[str, Picture | None] = {}
        if row is not None:
            for name in ("depth", "normal", "reflectance", "intensity", "distance"):
                drawn[MODALITIES[name][0]] = _draw(name, row)
            drawn["True shading"] = _draw("shading", row)
        drawn[EXAMPLE_PARTS["shading"]] = parts.pop("shading")
        if row is not None:
            # As the networks saw it: under the exposure policy they were trained with.
            drawn["Truth"] = _draw("color", row, shared)
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
                {"label": label, "uri": _uri(_shrink(picture))}
                for label, picture in drawn.items()
                if picture is not None
            ],
        }

    def _predictions(self) -> list[dict[str, Any]]:
        """What `pbrnet predict` left behind."""
        shown = []
        for path in sorted(self.places.predictions.glob("*.png")):
            try:
                content = path.read_bytes()
                facts, picture = png_facts(content), read_picture(content)
            except (OSError, ValueError):
                self.missing.append(f"{path} is damaged; make it again with: pbrnet predict")
                continue
            if facts is None or "prediction" not in facts:
                self.missing.append(f"{path} was not made by pbrnet predict and is not shown")
                continue
            shown.append(
                {
                    "label": str(facts["prediction"]),
                    "figures": ", ".join(filter(None, (facts.get("words"), facts.get("models")))),
                    "credits": "; ".join(facts.get("credits", ())),
                    "uri": _uri(fit(picture, 3 * THUMBNAIL)),
                }
            )
        return shown

    def _costs(self) -> dict[str, Any] | None:
        try:
            rows = read_ledger(self.places.data).to_pylist()
        except InputError as error:
            rows = []
            self.missing.append(str(error))
        seconds: dict[str, dict[tuple[str, str], float]] = defaultdict(dict)
        for row in rows:
            seconds[row["stage"]][row["scene_id"], row["view_id"]] = row["seconds"]
        again = sum(row["times"] > 1 for row in rows)
        if not seconds:
            self.missing.append("No costs yet; the rendering stages write data/ledger.parquet")
            return None
        table = [
            {
                "stage": stage,
                "count": len(costs),
                "total": sum(costs.values()),
                "mean": mean(costs.values()),
                "median": median(costs.values()),
                "most": max(costs.values()),
                "slowest": "/".join(max(costs.items(), key=lambda item: item[1])[0]).strip("/"),
            }
            for stage, costs in seconds.items()
        ]
        table.sort(key=lambda line: -float(str(line["total"])))
        per_view: Counter[tuple[str, str]] = Counter()
        for costs in seconds.values():
            for key, cost in costs.items():
                if key[1]:
                    per_view[key] += cost  # type: ignore[assignment]
        return {
            "table": table,
            "bars": _bars([(str(line["stage"]), float(str(line["total"]))) for line in table]),
            "drawings": cost_drawings(rows),
            "again": again,
            "views": len(per_view),
            "each": mean(per_view.values()) if per_view else 0.0,
        }

    def _imports(self) -> list[dict[str, Any]]:
        return [
            {
                "id": scene.scene_id,
                "kind": scene.source.get("kind", "unknown"),
                "licences": sorted({credit.licence for credit in scene.credits}),
                "authors": sorted({credit.author for credit in scene.credits}),
                "changes": scene.changes,
                "rooms": len(scene.rooms),
                "lights": len(scene.lights),
            }
            for scene in self.scenes
            if scene.source.get("kind") != "procedural"
        ]

    def _credits(self) -> list[dict[str, Any]]:
        uses: Counter[tuple[str, str, str, str]] = Counter()
        for scene in self.scenes:
            uses.update({(c.title, c.author, c.licence, c.source) for c in scene.credits})
        names = ("title", "author", "licence", "source")
        return [
            {**dict(zip(names, key, strict=True)), "scenes": count}
            for key, count in sorted(uses.items(), key=lambda item: (-item[1], item[0]))
        ]

    def _backbone(self) -> dict[str, str]:
        card = self.models.get("backbone")
        if not card:
            return {}
        return {
            key: str(card[key]) for key in ("network", "source", "licence", "sha256") if key in card
        }


def _read_csv(path: Path, numbers: Sequence[str]) -> list[dict[str, Any]]:
    with path.open(newline="", encoding="utf-8") as stream:
        lines: list[dict[str, Any]] = list(csv.DictReader(stream))
    for line in lines:
        if None in line or None in line.values():
            raise ValueError("a line has too many or too few values")
        for name in numbers:
            line[name] = float(line[name]) if line[name] else None
    return lines


def _unpack(table: pa.Table, index: int) -> dict[str, Any]:
    """Row `index`, image columns as arrays of their own shape."""
    row = {}
    for field in table.schema:
        cell = table[field.name][index]
        shape = (field.metadata or {}).get(b"shape")
        row[field.name] = (
            cell.values.to_numpy(zero_copy_only=False).reshape(json.loads(shape))
            if shape
            else cell.as_py()
        )
    return row


def _draw(name: str, row: Mapping[str, Any], shared: bool = False) -> Picture:
    """One image column of a row as a picture; `shared` shows colour under shading's exposure."""
    values = row[name]
    if name in ("color", "shading"):
        by = "shading" if shared else name
        return tone_picture(values, Exposure(row[f"exposure_{by}"], row[f"white_{by}"]))
    if name == "normal":
        return normal_picture(values, row["valid"])
    if name == "depth":
        return depth_picture(values, row["valid"])
    if name == "intensity":
        return intensity_picture(values)
    return distance_picture(values) if name == "distance" else reflectance_picture(values)


def _mosaic(sheet: Sequence[Mapping[str, Any]], columns: int, rows: int) -> str:
    """So many previews side by side as one small data URI; nothing if there are too few."""
    if len(sheet) < columns * rows:
        return ""
    places = np.linspace(0, len(sheet) - 1, columns * rows).astype(int)
    previews = [
        fit(read_picture(sheet[place]["preview"]["bytes"]), 240 // columns) for place in places
    ]
    return _uri(contact_sheet(previews, columns, gap=2))


def _shrink(picture: Picture) -> Picture:
    """Thumbnail size; what is much smaller keeps hard pixel edges."""
    return enlarge(fit(picture, THUMBNAIL), THUMBNAIL)


def _uri(picture: Picture, png: bool = False) -> str:
    content = png_bytes(picture) if png else jpeg_bytes(picture)
    kind = "png" if png else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _row_label(row: Mapping[str, Any]) -> str:
    return f"{row['scene_id']} {row['view_id']} · {row['room_type']}, {row['lighting']}"


def _bars(counts: Iterable[tuple[str, float]]) -> list[dict[str, Any]]:
    pairs = list(counts)
    most = max((count for _, count in pairs), default=1) or 1
    return [
        {"name": name, "count": count, "percent": round(100 * count / most, 1)}
        for name, count in pairs
    ]


def _figure(values: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """A metric's mean and interval; a bare number stands for a mean alone."""
    figure = values.get(name)
    if isinstance(figure, (int, float)):
        return {"mean": float(figure), "low": None, "high": None}
    return figure if isinstance(figure, dict) and figure.get("mean") is not None else None


def _interval(figure: Mapping[str, Any], digits: int) -> str:
    low, high = figure.get("low"), figure.get("high")
    return "" if low is None or high is None else f"{low:.{digits}f} to {high:.{digits}f}"


def _first(card: Mapping[str, Any], *paths: tuple[str, ...]) -> Any:
    """The first of several places in nested mappings that holds something."""
    for path in paths:
        value: Any = card
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if value is not None:
            return value
    return None


def _known_first(names: Iterable[str], known: Iterable[str]) -> list[str]:
    """`names` in the order of `known`, then those it does not hold, sorted."""
    order = list(known)
    return sorted(names, key=lambda name: (order.index(name) if name in order else 99, name))


def _epochs(epochs: Any) -> str:
    if epochs is None:
        return "not there yet"
    return f"{epochs} epoch{'' if epochs == 1 else 's'}"


def _duration(seconds: float) -> str:
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 120:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _versions() -> list[tuple[str, str]]:
    found = [("Python", platform.python_version())]
    for package in PACKAGES:
        try:
            found.append((package, version(package)))
        except PackageNotFoundError:
            found.append((package, "not installed"))
    return found
