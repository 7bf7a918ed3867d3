"""Report stage: one self-contained HTML page about a run.

The page shows the outputs that exist (data, models, metrics, plots); for missing ones it names the
command that makes them. Pictures are embedded, so the page needs no network.
"""

from __future__ import annotations

import platform
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from markupsafe import Markup

from pbrnet.model.figures.charts import inline_svg
from pbrnet.model.figures.diagrams import TALL, WIDE, Node, chain, panorama_guide
from pbrnet.model.figures.records import METRICS, Places, Records
from pbrnet.model.figures.results import (
    best_and_worst,
    figure_of,
    learning_curves,
    result_table,
    score_strips,
)
from pbrnet.model.figures.row_pictures import (
    MODALITIES,
    THUMBNAIL,
    environment_pictures,
    light_pictures,
    mosaic,
    row_label,
    rows_with,
    shrink,
    uri,
)
from pbrnet.model.figures.section import page_templates
from pbrnet.model.studies.registry import report_sections
from pbrnet.pipeline.channels import column_channel
from pbrnet.pipeline.costs.charts import LedgerChart, ledger_charts
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.dataset.checks import REASONS
from pbrnet.pipeline.images import Picture, enlarge, fit, png_facts, read_picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.photograph import channel_picture
from pbrnet.pipeline.plotting import new_chart
from pbrnet.pipeline.terminal import counted
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_bytes, write_text

SHEET_VIEWS = 12
_FURTHER_VIEWS = 3  # of which the parts of the light and the surroundings are shown
_MISSING = "not made yet"
PACKAGES = ("pbrnet", "mitsuba", "drjit", "numpy", "torch", "OpenEXR", "pyarrow", "dask")


def write_report(places: Places, params: Params, out: Path) -> list[str]:
    """Write the page to `out` by rename; return a sentence for each missing or damaged part."""
    page = _Page(params, Records(places))
    write_text(out, page.render())
    return page.records.missing


@dataclass(frozen=True)
class _Page:
    """Content of the page, section by section."""

    params: Params
    records: Records

    def render(self) -> str:
        """Render the page."""
        wanted = self.records.spread(SHEET_VIEWS)
        examples = self.records.example_keys()
        rows = self.records.rows({*wanted, *(key for group in examples.values() for key in group)})
        sheet = [rows[key] for key in wanted if key in rows]
        return (
            page_templates("pbrnet.model.report")
            .get_template("report.html")
            .render(
                headline=self._headline(),
                chain=self._chain(sheet),
                sheets=self._sheets(sheet),
                lights=_further(sheet, light_pictures),
                surroundings=_further(sheet, environment_pictures),
                guide=self._guide(sheet),
                candidates=self._candidates(),
                rejected=self._rejected(),
                reasons=REASONS,
                dataset=self._dataset(),
                curves=learning_curves(self.records),
                results=result_table(self.records),
                strips=score_strips(self.records),
                studies=report_sections(self.records),
                examples=best_and_worst(self.records, examples, rows),
                predictions=self._predictions(),
                costs=self._costs(),
                imported=self._imported_scenes(),
                credits=self._credits(),
                backbone=self._backbone(),
                parameters=yaml.safe_dump(plain(self.params), sort_keys=False, allow_unicode=True),
                versions=_versions(),
                notes=self.records.missing,
            )
        )

    def _headline(self) -> list[tuple[str, str]]:
        views = sum(len(file.views) for file in self.records.cameras)
        rows = sum(shard.metadata.num_rows for shard in self.records.shards)
        figures = [
            (str(len(self.records.scenes)), "scenes"),
            (str(views), "views sampled"),
            (str(rows), "views in the dataset"),
        ]
        methods = self.records.evaluation.get("methods", {})
        for name, (label, _, digits) in METRICS.items():
            value = figure_of(methods.get("pbrnet", {}), name)
            if value is not None:
                words = f"{label} of both networks (pbrnet), on test scenes"
                figures.append((f"{value['mean']:.{digits}f}", words))
        return figures

    def _chain(self, sheet: Sequence[dict[str, Any]]) -> dict[str, Markup]:
        views = sum(len(file.views) for file in self.records.cameras)
        rooms = sum(len(scene.rooms) for scene in self.records.scenes)
        rows = sum(shard.metadata.num_rows for shard in self.records.shards)
        size = f"{self.params.image.width}×{self.params.image.height}"
        row = max(sheet, key=lambda row: np.count_nonzero(row["intensity"]), default=None)
        shown = [name for name in MODALITIES if row and name in row]
        picture = {name: uri(fit(channel_picture(name, row), 200)) for name in shown} if row else {}
        scenes, many = mosaic(sheet, 2, 2), mosaic(sheet, 4, 3)
        flip = figure_of(self.records.evaluation.get("methods", {}).get("pbrnet", {}), "flip")
        epochs = {
            name: _first(card, ("epochs",), ("training", "epochs"))
            for name, card in self.records.models.items()
        }
        backbone = self._backbone()
        nodes = {
            "scenes": Node(
                "Scenes", f"{len(self.records.scenes)}, {counted(rooms, 'room')}", scenes
            ),
            "cameras": Node("Cameras", counted(views, "view"), picture.get("color", "")),
            "inputs": Node("Inputs", size, picture.get("normal", "")),
            "illumination": Node(
                "Illumination",
                f"{self.params.illumination.width} wide",
                picture.get("intensity", ""),
            ),
            "groundtruth": Node(
                "Ground truth", f"{self.params.groundtruth.spp} samples", picture.get("shading", "")
            ),
            "dataset": Node("Dataset", counted(rows, "row"), many),
            "backbone": Node("Backbone", backbone.get("network", _MISSING)),
            "shading": Node(
                "Shading network",
                _epochs(epochs.get("shading")),
                self._example_thumbnail("shading"),
            ),
            "composition": Node(
                "Composition",
                _epochs(epochs.get("composition")),
                self._example_thumbnail("prediction"),
            ),
            "evaluate": Node(
                "Evaluation",
                f"ꟻLIP {flip['mean']:.3f}" if flip else _MISSING,
                self._example_thumbnail("error"),
            ),
        }
        return {"wide": chain(nodes, WIDE, "wide"), "tall": chain(nodes, TALL, "tall")}

    def _example_thumbnail(self, part: str) -> str:
        """Return a small picture of the best example as a data URI; empty if there is none."""
        for scene_id, view_id in self.records.example_keys().get("best", []):
            picture = self.records.example_picture(scene_id, view_id, part)
            if picture is not None:
                return uri(fit(picture, 200))
        return ""

    def _sheets(self, sheet: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        if not sheet:
            return []
        shown = {name: rows_with(name, sheet) for name in MODALITIES}
        return [
            {
                "title": title,
                "description": words,
                "wide": column_channel(name).is_panorama,
                "pictures": [
                    {"uri": uri(shrink(channel_picture(name, row))), "label": row_label(row)}
                    for row in shown[name]
                ],
            }
            for name, (title, words) in MODALITIES.items()
            if shown[name]
        ]

    def _guide(self, sheet: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
        """Return the panorama with most light sources, with its directions."""
        if not sheet:
            return None
        row = max(sheet, key=lambda row: np.count_nonzero(row["intensity"]))
        width = 960
        pictures = {
            name: enlarge(channel_picture(name, row), width) for name in ("intensity", "distance")
        }
        height, width = pictures["intensity"].shape[:2]
        lit = row["distance"][row["distance"] > 0]
        return {
            "label": row_label(row),
            "outlined": not self.params.image.is_panorama,
            "color": uri(shrink(channel_picture("color", row))),
            "svg": panorama_guide(
                uri(pictures["intensity"], png=True),
                (width, height),
                None if self.params.image.is_panorama else row["K"],
                (row["width"], row["height"]),
            ),
            "distance": uri(pictures["distance"], png=True),
            "share": float(np.mean(row["intensity"] > 0)),
            "near": float(lit.min()) if lit.size else 0.0,
            "far": float(lit.max()) if lit.size else 0.0,
        }

    def _candidates(self) -> dict[str, Any]:
        rejected: Counter[str] = Counter()
        for file in self.records.cameras:
            rejected.update(file.rejected)
        total = sum(file.candidates for file in self.records.cameras)
        kept = sum(len(file.views) for file in self.records.cameras)
        return {"total": total, "kept": kept, "bars": _bars(rejected.most_common())}

    def _rejected(self) -> dict[str, Any] | None:
        path = self.records.places.data / "dataset" / "rejected.csv"
        if not path.is_file():
            return None
        lines = self.records.csv(path)
        counts = Counter(line.get("reason", "unknown") for line in lines)
        return {"total": len(lines), "bars": _bars(counts.most_common()), "lines": lines[:50]}

    def _dataset(self) -> dict[str, Any] | None:
        if not self.records.shards:
            return None
        tables = [
            shard.read(columns=["scene_id", "split", "room_type", "lighting", "licence"])
            for shard in self.records.shards
        ]
        rows = pa.concat_tables(tables).to_pylist()
        splits = Counter(row["split"] for row in rows)
        folder = self.records.places.data / "dataset"
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
            "shards": len(self.records.shards),
            "megabytes": sum(path.stat().st_size for path in folder.glob("*.parquet")) / 1e6,
        }

    def _predictions(self) -> list[dict[str, Any]]:
        """Return the pictures that `pbrnet predict` has written."""
        shown: list[dict[str, Any]] = []
        missing = self.records.missing
        for path in sorted(self.records.places.predictions.glob("*.png")):
            try:
                content = read_bytes(path)
                facts, picture = png_facts(content), read_picture(content)
            except (InputError, OSError, ValueError):
                missing.append(f"{path} is damaged; remake it with: pbrnet predict")
                continue
            if facts is None or "prediction" not in facts:
                missing.append(f"{path} was not written by pbrnet predict and is not shown")
                continue
            shown.append(
                {
                    "label": str(facts["prediction"]),
                    "figures": ", ".join(filter(None, (facts.get("words"), facts.get("models")))),
                    "credits": "; ".join(facts.get("credits", ())),
                    "uri": uri(fit(picture, 3 * THUMBNAIL)),
                }
            )
        return shown

    def _costs(self) -> dict[str, Any] | None:
        try:
            rows = read_ledger(self.records.places.data).to_pylist()
        except InputError as error:
            rows = []
            self.records.missing.append(str(error))
        seconds: dict[str, dict[tuple[str, str], float]] = defaultdict(dict)
        for row in rows:
            seconds[row["stage"]][row["scene_id"], row["view_id"]] = row["seconds"]
        again = sum(row["times"] > 1 for row in rows)
        if not seconds:
            self.records.missing.append(
                "No costs yet; the rendering stages write data/ledger.parquet"
            )
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
            "charts": [_cost_chart(chart) for chart in ledger_charts(rows)],
            "again": again,
            "views": len(per_view),
            "each": mean(per_view.values()) if per_view else 0.0,
        }

    def _imported_scenes(self) -> list[dict[str, Any]]:
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
            for scene in self.records.scenes
            if scene.source.get("kind") != "procedural"
        ]

    def _credits(self) -> list[dict[str, Any]]:
        uses: Counter[tuple[str, str, str, str]] = Counter()
        for scene in self.records.scenes:
            uses.update({(c.title, c.author, c.licence, c.source) for c in scene.credits})
        names = ("title", "author", "licence", "source")
        return [
            {**dict(zip(names, key, strict=True)), "scenes": count}
            for key, count in sorted(uses.items(), key=lambda item: (-item[1], item[0]))
        ]

    def _backbone(self) -> dict[str, str]:
        card = self.records.models.get("backbone")
        if not card:
            return {}
        return {
            key: str(card[key]) for key in ("network", "source", "licence", "sha256") if key in card
        }


def _further(
    sheet: Sequence[dict[str, Any]],
    pictures: Callable[[Mapping[str, Any]], list[tuple[str, Picture]]],
) -> list[dict[str, Any]]:
    """Return titled pictures of the few views that have them."""
    drawn = [(row, pictures(row)) for row in sheet[:: max(1, len(sheet) // _FURTHER_VIEWS)]]
    return [
        {
            "label": row_label(row),
            "pictures": [{"uri": uri(shrink(one)), "label": title} for title, one in made],
        }
        for row, made in drawn[:_FURTHER_VIEWS]
        if made
    ]


def _cost_chart(chart: LedgerChart) -> dict[str, Any]:
    figure, axes = new_chart()
    chart.draw(axes)
    return {"title": chart.title, "caption": chart.caption, "svg": inline_svg(figure)}


def _bars(counts: Iterable[tuple[str, float]]) -> list[dict[str, Any]]:
    pairs = list(counts)
    most = max((count for _, count in pairs), default=1) or 1
    return [
        {"name": name, "count": count, "percent": round(100 * count / most, 1)}
        for name, count in pairs
    ]


def _first(card: Mapping[str, Any], *paths: tuple[str, ...]) -> Any:
    """Return the first value that exists at one of several paths in nested mappings."""
    for path in paths:
        value: Any = card
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if value is not None:
            return value
    return None


def _epochs(epochs: Any) -> str:
    if epochs is None:
        return _MISSING
    return f"{epochs} epoch{'' if epochs == 1 else 's'}"


def _versions() -> list[tuple[str, str]]:
    found = [("Python", platform.python_version())]
    for package in PACKAGES:
        try:
            found.append((package, version(package)))
        except PackageNotFoundError:
            found.append((package, "not installed"))
    return found
