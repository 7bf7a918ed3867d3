"""Version and citation of the datasets: BibTeX, and `CITATION.cff` beside the shards."""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from pbrnet.scenes.contract import Scene

NAME = "pbrnet"
VERSION = "2.0.0"  # of format and meaning of the columns
PUBLISHED = "2026-11-26"  # of that version: dates of packing would change the bytes
TITLE = "pbrnet: training data by physically based rendering"
AUTHORS = "The pbrnet authors"
KEYWORDS = (
    "physically based rendering",
    "indoor scenes",
    "global illumination",
    "intrinsic images",
    "depth estimation",
)


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


def bibtex() -> str:
    """Return the dataset's BibTeX entry."""
    fields = {
        "title": f"{{{TITLE}}}",
        "author": f"{{{{{AUTHORS}}}}}",
        "year": f"{{{PUBLISHED[:4]}}}",
        "version": f"{{{VERSION}}}",
        "note": "{Dataset}",
    }
    lines = [f"  {name} = {value}," for name, value in fields.items()]
    return "\n".join([f"@misc{{{NAME}-dataset,", *lines, "}"])


def citation_file(licences: Sequence[str]) -> str:
    """Return the content of `CITATION.cff`, Citation File Format 1.2.0."""
    content = {
        "cff-version": "1.2.0",
        "message": "If you use this dataset, please cite it, and the works that its card credits.",
        "type": "dataset",
        "title": TITLE,
        "authors": [{"name": AUTHORS}],
        "version": VERSION,
        "date-released": PUBLISHED,
        "license": list(licences) if len(licences) > 1 else licences[0],
        "keywords": list(KEYWORDS),
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
