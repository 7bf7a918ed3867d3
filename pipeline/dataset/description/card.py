"""Card of the dataset: a README with a datasheet.

It follows the Hugging Face dataset card (YAML front matter, then Markdown) and depends on the data
alone: no date of packing, no machine.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import yaml

from pbrnet.pipeline.dataset.checks import REASONS
from pbrnet.pipeline.dataset.columns import NAMES, PREVIEW, Column
from pbrnet.pipeline.dataset.description.facts import NAME, VERSION, DatasetFacts, bibtex, percent
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.photograph import FORMULA, SHARPENING_RADIUS
from pbrnet.pipeline.templating import templates
from pbrnet.pipeline.terminal import visible
from pbrnet.reader import TASKS, chosen_columns
from pbrnet.scenes.contract import Credit, Scene

# SPDX identifiers that the Hugging Face hub knows under its own, lower-case names.
HUB_LICENCES = ("CC0-1.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-4.0", "MIT", "Apache-2.0")


@dataclass(frozen=True)
class DatasetSummary:
    """Numbers of rows, scenes and rejected views, and the shards of a packed dataset."""

    rows: dict[str, int]  # per split
    scenes: dict[str, int]  # per split, scenes with rows
    rejected: dict[str, int]  # per reason
    unlit: int  # rows whose panorama holds no light
    files: tuple[str, ...]  # names of the shards, sorted
    bytes: int  # of the shards together
    facts: DatasetFacts
    # Walks with rejected frames, by scene and name: how many.
    walks: dict[tuple[str, str], int] = field(default_factory=dict)
    packed: bool = True  # False: kept as it was, without `facts`

    @property
    def total(self) -> int:
        """Number of rows in all splits."""
        return sum(self.rows.values())

    @property
    def sampled(self) -> int:
        """Number of sampled views: rows and rejected views."""
        return self.total + sum(self.rejected.values())


def dataset_card(
    summary: DatasetSummary, columns: Sequence[Column], scenes: Sequence[Scene], params: Params
) -> str:
    """Return the README: front matter, loading, columns, counts, sources, limits."""
    licences = sorted({credit.licence for scene in scenes for credit in scene.credits})
    sources = Counter(str(scene.source.get("kind", "unknown")) for scene in scenes)
    # The split that everyone wants first.
    example = min(summary.files, key=lambda name: (not name.startswith("train"), name))
    environment = templates("pbrnet.pipeline.dataset.description", markup=False)
    return environment.get_template("dataset_card.md").render(
        front_matter=_front_matter(summary, licences, columns),
        summary=summary,
        columns=columns,
        shapes={column.name: " x ".join(map(str, column.shape)) for column in columns},
        types={column.name: _type_name(column) for column in columns},
        reasons=REASONS,
        is_whole={"color", "shading", "intensity", "depth"} <= {one.name for one in columns},
        credits=_credits(scenes),
        sources=sources,
        lighting=Counter(scene.lighting for scene in scenes),
        licences=licences,
        params=params,
        megabytes=summary.bytes / 1e6,
        example=example,
        tasks=dict(_tasks(columns)),
        photograph=FORMULA,
        sharpening_radius=SHARPENING_RADIUS,
        facts=summary.facts,
        noise=_noise(summary.facts),
        scenes=sum(summary.scenes.values()),
        sources_text=", ".join(f"{name} {count}" for name, count in sorted(sources.items())),
        rejected_share=percent(summary.sampled - summary.total, summary.sampled),
        unlit_share=percent(summary.unlit, summary.total),
        version=VERSION,
        bibtex=bibtex(),
    )


def _noise(facts: DatasetFacts) -> str:
    told = f"median {facts.noise[0]} as traced"
    if facts.residual[0] != "unknown":
        told += f", {facts.residual[0]} after the denoiser (an estimate)"
    return told


def _tasks(columns: Sequence[Column]) -> Iterator[tuple[str, list[str]]]:
    """Yield the tasks of the reader that the dataset serves, with their columns in its order."""
    names = [column.name for column in columns]
    for task in TASKS:
        with suppress(KeyError):
            chosen = chosen_columns(task, names)
            yield task, [name for name in names if name in chosen]


def _front_matter(
    summary: DatasetSummary, licences: Sequence[str], columns: Sequence[Column]
) -> str:
    single = licences[0] if len(licences) == 1 else ""
    known = single.lower() if single in HUB_LICENCES else "other"
    matter: dict[str, Any] = {
        "pretty_name": NAME,
        "license": known,
        "annotations_creators": ["machine-generated"],
        "task_categories": ["image-to-image", "depth-estimation"],
        "tags": ["rendering", "indoor", "global-illumination", "intrinsic-images", "synthetic"],
        "size_categories": [_size_category(summary.total)],
        "configs": [
            {"config_name": "default", "default": True, "data_files": _data_files(summary)},
            *(
                {"config_name": task, "data_files": _data_files(summary), "columns": names}
                for task, names in _tasks(columns)
            ),
        ],
    }
    if known == "other":
        matter["license_name"] = visible(" AND ".join(licences))
    options = {"sort_keys": False, "allow_unicode": True, "default_flow_style": None, "width": 100}
    return yaml.safe_dump(matter, **options).strip()


def _data_files(summary: DatasetSummary) -> list[dict[str, str]]:
    return [
        {"split": split, "path": f"{split}-*.parquet"}
        for split, rows in summary.rows.items()
        if rows
    ]


def _size_category(rows: int) -> str:
    bounds = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"))
    for bound, name in bounds:
        if rows < bound:
            return name
    return "100K<n<1M" if rows < 1_000_000 else "n>1M"


def _credits(scenes: Sequence[Scene]) -> list[tuple[Credit, int]]:
    """Return each distinct work with its number of scenes, the most used first."""
    uses: Counter[tuple[str, str, str, str]] = Counter()
    for scene in scenes:
        uses.update(
            {
                (credit.title, credit.author, credit.licence, credit.source)
                for credit in scene.credits
            }
        )
    order = sorted(uses.items(), key=lambda item: (-item[1], item[0]))
    return [
        (Credit("", title, author, licence, source), count)
        for (title, author, licence, source), count in order
    ]


def _type_name(column: Column) -> str:
    if column.dtype == PREVIEW:
        return "image"
    return "list of string" if column.dtype == NAMES else column.dtype_name
