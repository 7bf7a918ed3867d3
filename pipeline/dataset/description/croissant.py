"""Croissant description of the dataset: JSON-LD after MLCommons' specification 1.1, with its RAI.

RAI is the vocabulary for responsible AI: collection, limits, uses, biases. Nothing in the file
depends on date or machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import yaml

from pbrnet.pipeline.dataset.columns import NAMES, PREVIEW, Column
from pbrnet.pipeline.dataset.description.facts import (
    AUTHORS,
    KEYWORDS,
    NAME,
    PUBLISHED,
    TITLE,
    VERSION,
    DatasetFacts,
    bibtex,
    single_licences,
)
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.files import digest_file, write_json

_TEXTS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))


def write_croissant(
    folder: Path,
    columns: Sequence[Column],
    scenes: Sequence[Scene],
    facts: DatasetFacts,
    samples: int,
) -> None:
    """Write `croissant.json` for the shards in `folder`, with their checksums.

    `samples`: the most per pixel of the ground truth.
    """
    shards = sorted(folder.glob("*.parquet"))
    known = single_licences([credit.licence for scene in scenes for credit in scene.credits])
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
    sets = [_file_set(f"{split}-shards", f"{split}-*.parquet", split) for split in splits]
    write_json(
        folder / "croissant.json",
        {
            "@context": _TEXTS["context"],
            "@type": "sc:Dataset",
            "conformsTo": [
                "http://mlcommons.org/croissant/1.1",
                "http://mlcommons.org/croissant/RAI/1.0",
            ],
            "name": NAME,
            "alternateName": TITLE,
            "version": VERSION,
            "datePublished": PUBLISHED,
            "description": (
                "Views of indoor scenes with exact geometry buffers, a panorama of the visible "
                "light sources, textureless shading and path-traced colour, to learn rendering "
                "from."
            ),
            "license": [f"https://spdx.org/licenses/{quote(licence)}.html" for licence in known],
            "creator": [
                {"@type": "sc:Organization", "name": AUTHORS},
                *({"@type": "sc:Person", "name": author} for author in authors),
            ],
            "citeAs": bibtex(),
            "url": "./",
            "keywords": list(KEYWORDS),
            "isLiveDataset": False,
            **_responsible(facts, samples),
            "distribution": [*files, _file_set("shards", "*.parquet", "all splits"), *sets],
            "recordSet": [
                {**_TEXTS["splits"], "data": [{"splits/name": split} for split in splits]},
                _views(columns),
            ],
        },
    )


def _responsible(facts: DatasetFacts, samples: int) -> Any:
    """Return the properties of the RAI vocabulary."""
    (residual, most_residual), (noise, _) = facts.residual, facts.noise
    figures = {
        "samples": samples,
        "denoised": f"then denoised by {facts.denoisers}" if facts.denoisers else "not denoised",
        "without_surface": facts.without_surface,
        "lighting": facts.by("lighting"),
        "rooms": facts.by("room_type"),
        "residual": residual,
        "most_residual": most_residual,
        "noise": noise,
    }
    return {
        name: text.format_map(figures)
        if isinstance(text, str)
        else [each.format_map(figures) for each in text]
        for name, text in _TEXTS["responsible"].items()
    }


def _file_set(name: str, includes: str, of: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": name,
        "name": name,
        "description": f"All shards of {of}.",
        "encodingFormat": "application/x-parquet",
        "includes": includes,
    }


def _views(columns: Sequence[Column]) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": "views",
        "name": "views",
        "description": "One row a view.",
        "key": [{"@id": "views/scene_id"}, {"@id": "views/view_id"}],
        "field": [_field(column) for column in columns],
    }


def _field(column: Column) -> dict[str, Any]:
    source: dict[str, Any] = {"fileSet": {"@id": "shards"}, "extract": {"column": column.name}}
    sentences = [column.description]
    if column.is_image:
        shape = " x ".join(map(str, column.shape))
        sentences.append(f"A .npy file of the byte planes of {column.numpy_dtype.name} {shape}.")
    if column.unit:
        sentences.append(f"Unit: {column.unit}.")
    field: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": f"views/{column.name}",
        "name": column.name,
        "description": " ".join(sentences),
        "dataType": _type(column),
        "source": source,
    }
    if column.dtype == PREVIEW:
        source["transform"] = {"jsonPath": "bytes"}
    if column.name == "split":
        field["references"] = {"field": {"@id": "splits/name"}}
    if column.shape and not column.is_image:
        field |= {"isArray": True, "arrayShape": ",".join(map(str, column.shape))}
    elif column.dtype == NAMES:
        field |= {"isArray": True, "arrayShape": "-1"}
    return field


def _type(column: Column) -> str:
    if column.dtype == PREVIEW:
        return "sc:ImageObject"
    if column.is_image:
        return "sc:Text"  # bytes have no type of their own
    if pa.types.is_floating(column.dtype):
        return "sc:Float"
    return "sc:Integer" if pa.types.is_integer(column.dtype) else "sc:Text"
