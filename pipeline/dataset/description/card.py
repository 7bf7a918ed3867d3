"""Description of the dataset: a README card and a Croissant file.

The card follows the Hugging Face dataset card (YAML front matter, then Markdown); the description
is Croissant 1.0, JSON-LD after the specification of MLCommons. Both depend on the data alone: they
contain no date and no machine.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import yaml

from pipeline.dataset.checks import REASONS
from pipeline.dataset.columns import NAMES, PREVIEW, Column
from pipeline.params import Params
from pipeline.templating import templates
from scenes.contract import Credit, Scene
from scenes.files import digest_file, write_json

NAME = "pbrnet"
VERSION = "1.0.0"
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

    @property
    def total(self) -> int:
        """Number of rows in all splits."""
        return sum(self.rows.values())

    @property
    def sampled(self) -> int:
        """Number of sampled views: rows and rejected views."""
        return self.total + sum(self.rejected.values())


def licence_of(scene: Scene) -> str:
    """Return the SPDX expression over all parts of a scene, e.g. "CC-BY-3.0 AND CC0-1.0"."""
    return " AND ".join(sorted({credit.licence for credit in scene.credits}))


def attribution_of(scene: Scene) -> str:
    """Return one line with title, author and licence of every part of a scene."""
    return "; ".join(
        sorted(
            {f"{credit.title} by {credit.author} ({credit.licence})" for credit in scene.credits}
        )
    )


def dataset_card(
    summary: DatasetSummary, columns: Sequence[Column], scenes: Sequence[Scene], params: Params
) -> str:
    """Return the README: front matter, loading, columns, counts, sources, limits."""
    licences = sorted({credit.licence for scene in scenes for credit in scene.credits})
    environment = templates("pipeline.dataset.description", markup=False)
    environment.filters["cell"] = _table_cell
    return environment.get_template("dataset_card.md").render(
        front_matter=_front_matter(summary, licences),
        summary=summary,
        columns=columns,
        shapes={column.name: " x ".join(map(str, column.shape)) for column in columns},
        types={column.name: _type_name(column) for column in columns},
        reasons=REASONS,
        credits=_credits(scenes),
        sources=Counter(str(scene.source.get("kind", "unknown")) for scene in scenes),
        lighting=Counter(scene.lighting for scene in scenes),
        licences=licences,
        params=params,
        megabytes=summary.bytes / 1e6,
        # The split that everyone wants first.
        example=min(summary.files, key=lambda name: (not name.startswith("train"), name)),
    )


def write_croissant(folder: Path, columns: Sequence[Column], scenes: Sequence[Scene]) -> None:
    """Write `croissant.json` for the shards in `folder`, with their checksums."""
    shards = sorted(folder.glob("*.parquet"))
    licences = sorted({credit.licence for scene in scenes for credit in scene.credits})
    authors = sorted({credit.author for scene in scenes for credit in scene.credits})
    files = [
        {
            "@type": "cr:FileObject",
            "@id": shard.name,
            "name": shard.name,
            "description": f"Shard of the {shard.name.split('-')[0]} split.",
            "contentUrl": shard.name,
            "contentSize": f"{shard.stat().st_size} B",
            "encodingFormat": "application/x-parquet",
            "sha256": digest_file(shard),
        }
        for shard in shards
    ]
    splits = sorted({shard.name.split("-")[0] for shard in shards})
    sets = [
        {
            "@type": "cr:FileSet",
            "@id": f"{split}-shards",
            "name": f"{split}-shards",
            "description": f"All shards of the {split} split.",
            "encodingFormat": "application/x-parquet",
            "includes": f"{split}-*.parquet",
        }
        for split in splits
    ]
    everything = {
        "@type": "cr:FileSet",
        "@id": "shards",
        "name": "shards",
        "description": "All shards of all splits.",
        "encodingFormat": "application/x-parquet",
        "includes": "*.parquet",
    }
    description = {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": NAME,
        "version": VERSION,
        "description": (
            "Views of indoor scenes with exact geometry buffers, a panorama of the visible light "
            "sources, textureless shading and path-traced colour, to learn rendering from."
        ),
        "license": [_licence_url(licence) for licence in licences],
        "creator": [{"@type": "sc:Person", "name": author} for author in authors],
        "citeAs": "pbrnet: training data by physically based rendering.",
        "url": "./",
        "keywords": ["physically based rendering", "indoor scenes", "global illumination"],
        "isLiveDataset": False,
        "distribution": [*files, everything, *sets],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "splits",
                "name": "splits",
                "description": "Names of the splits.",
                "dataType": "cr:Split",
                "key": {"@id": "splits/name"},
                "field": [
                    {
                        "@type": "cr:Field",
                        "@id": "splits/name",
                        "name": "name",
                        "description": "Name of the split.",
                        "dataType": "sc:Text",
                    }
                ],
                "data": [{"splits/name": split} for split in splits],
            },
            {
                "@type": "cr:RecordSet",
                "@id": "views",
                "name": "views",
                "description": "One row a view.",
                "key": [{"@id": "views/scene_id"}, {"@id": "views/view_id"}],
                "field": [_croissant_field(column) for column in columns],
            },
        ],
    }
    write_json(folder / "croissant.json", description)


def _croissant_field(column: Column) -> dict[str, Any]:
    source: dict[str, Any] = {"fileSet": {"@id": "shards"}, "extract": {"column": column.name}}
    sentences = [column.description]
    if column.shape:
        sentences.append(f"Flat, row-major; shape {' x '.join(map(str, column.shape))}.")
    if column.unit:
        sentences.append(f"Unit: {column.unit}.")
    field: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": f"views/{column.name}",
        "name": column.name,
        "description": " ".join(sentences),
        "dataType": _croissant_type(column),
        "source": source,
    }
    if column.dtype == PREVIEW:
        source["transform"] = {"jsonPath": "bytes"}
    if column.name == "split":
        field["references"] = {"field": {"@id": "splits/name"}}
    if column.shape or column.dtype == NAMES:
        field["repeated"] = True
    return field


def _croissant_type(column: Column) -> str:
    if column.dtype == PREVIEW:
        return "sc:ImageObject"
    if pa.types.is_floating(column.dtype):
        return "sc:Float"
    return "sc:Integer" if pa.types.is_integer(column.dtype) else "sc:Text"


def _front_matter(summary: DatasetSummary, licences: Sequence[str]) -> str:
    single = licences[0] if len(licences) == 1 else ""
    known = single.lower() if single in HUB_LICENCES else "other"
    matter: dict[str, Any] = {
        "pretty_name": NAME,
        "license": known,
        "task_categories": ["image-to-image", "depth-estimation"],
        "tags": ["rendering", "indoor", "global-illumination", "intrinsic-images", "synthetic"],
        "size_categories": [_size_category(summary.total)],
        "configs": [
            {
                "config_name": "default",
                "data_files": [
                    {"split": split, "path": f"{split}-*.parquet"}
                    for split, rows in summary.rows.items()
                    if rows
                ],
            }
        ],
    }
    if known == "other":
        matter["license_name"] = " AND ".join(licences)
    return yaml.safe_dump(matter, sort_keys=False, allow_unicode=True).strip()


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


def _licence_url(licence: str) -> str:
    return f"https://spdx.org/licenses/{licence}.html"


def _type_name(column: Column) -> str:
    if column.dtype == PREVIEW:
        return "image"
    if column.dtype == NAMES:
        return "list of string"
    names = {"halffloat": "float16", "float": "float32", "double": "float64"}
    return names.get(str(column.dtype), str(column.dtype))


def _table_cell(text: object) -> str:
    """Escape text for a cell of a Markdown table."""
    return str(text).replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")


_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
