"""Figures of a packed dataset for its card (noise, where simple identities hold), and citation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Scene

NEAR = (0.05, 0.1, 0.25)  # relative differences that the card tells shares of
_MATT = 0.7  # least roughness of a matt surface without metal
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


@dataclass(frozen=True)
class ViewFacts:
    """Figures of one row; shares are numbers of pixels."""

    split: str
    lighting: str
    room_type: str
    denoiser: str | None
    noise: float | None  # of colour, as traced
    residual: float | None  # of colour, after the denoiser
    pixels: int
    without_surface: int
    lit_panorama: bool
    objects: int
    product: tuple[int, ...]  # surfaces where reflectance x shading / albedo is within `NEAR`
    matt: int  # surfaces known to be matt; 0 without materials
    matt_product: tuple[int, ...]


def view_facts(row: Mapping[str, Any], albedo: float) -> ViewFacts:
    """Return the figures of a row; `albedo` is the grey of shading."""
    there = row["valid"] > 0
    near = _near(row, albedo)
    matt = np.zeros_like(there)
    if "roughness" in row:
        matt = there & (row["material_known"] > 0) & (row["roughness"] >= _MATT)
        matt &= (row["metalness"] == 0) & (row["emission"] == 0)
    return ViewFacts(
        row["split"],
        row["lighting"],
        row["room_type"],
        row.get("denoiser"),
        row.get("noise_color"),
        row.get("residual_noise_color"),
        there.size,
        int(there.size - there.sum()),
        bool(row["intensity"].any()) if "intensity" in row else True,
        row["objects"],
        tuple(int((each & there).sum()) for each in near),
        int(matt.sum()),
        tuple(int((each & matt).sum()) for each in near),
    )


def _near(row: Mapping[str, Any], albedo: float) -> list[BoolArray]:
    """Return where the luminance of the product is within each of `NEAR` of colour's.

    Nowhere in a row without these images.
    """
    if not {"color", "shading", "reflectance"} <= row.keys():
        return [np.zeros(row["valid"].shape, dtype=bool) for _ in NEAR]
    images = {
        name: luminance(row[name].astype(np.float64))
        for name in ("color", "shading", "reflectance")
    }
    product: Float64Array = luminance(
        row["reflectance"].astype(np.float64) * row["shading"].astype(np.float64) / albedo
    )
    gap = np.abs(product - images["color"])
    return [gap <= limit * images["color"] for limit in NEAR]


@dataclass(frozen=True)
class DatasetFacts:
    """Figures of all rows of a dataset, as the card tells them."""

    views: tuple[ViewFacts, ...]

    @property
    def product(self) -> dict[str, str]:
        """Share of the surfaces where the product holds, by relative difference."""
        surfaces = sum(view.pixels - view.without_surface for view in self.views)
        return _shares([view.product for view in self.views], surfaces)

    @property
    def matt_product(self) -> dict[str, str]:
        """The same of matt surfaces; empty without materials."""
        matt = sum(view.matt for view in self.views)
        return _shares([view.matt_product for view in self.views], matt) if matt else {}

    @property
    def denoisers(self) -> str:
        """Names of the denoisers of the views; empty if there are none."""
        return ", ".join(sorted({view.denoiser for view in self.views if view.denoiser}))

    @property
    def matt(self) -> str:
        """Share of the surfaces that are known to be matt."""
        surfaces = sum(view.pixels - view.without_surface for view in self.views)
        return percent(sum(view.matt for view in self.views), surfaces)

    @property
    def without_surface(self) -> str:
        """Share of the pixels that see no surface."""
        pixels = sum(view.pixels for view in self.views)
        return percent(sum(view.without_surface for view in self.views), pixels)

    @property
    def noise(self) -> tuple[str, str]:
        """Median and 95 % quantile of the relative noise of colour as traced."""
        return _quantiles([view.noise for view in self.views])

    @property
    def residual(self) -> tuple[str, str]:
        """The same of what the denoiser leaves."""
        return _quantiles([view.residual for view in self.views])

    @property
    def objects(self) -> tuple[str, str]:
        """Median and 95 % quantile of the number of objects in a view."""
        numbers = [view.objects for view in self.views]
        return f"{np.median(numbers):.0f}", f"{np.quantile(numbers, 0.95):.0f}"

    def by(self, name: str) -> str:
        """Return the values of a field of the views with their shares, the most frequent first."""
        counts = Counter(str(getattr(view, name)) for view in self.views)
        order = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
        return ", ".join(f"{value} {percent(count, len(self.views))}" for value, count in order)


def percent(part: int, whole: int) -> str:
    """Return a share for readers, such as `12 %`; small ones with a digit more."""
    share = 100 * part / max(1, whole)
    return f"{share:.1f} %" if 0 < share < 9.95 else f"{share:.0f} %"


def _shares(counts: Sequence[tuple[int, ...]], whole: int) -> dict[str, str]:
    sums = np.sum([*counts, (0,) * len(NEAR)], axis=0)
    return {
        f"{limit:.0%}".replace("%", " %"): percent(int(part), whole)
        for limit, part in zip(NEAR, sums, strict=True)
    }


def _quantiles(values: Sequence[float | None]) -> tuple[str, str]:
    known = [value for value in values if value is not None]
    if not known:
        return ("unknown", "unknown")
    return f"{np.median(known):.1%}", f"{np.quantile(known, 0.95):.1%}"


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


def single_licences(licences: Sequence[str]) -> list[str]:
    """Return the licences that expressions such as `A AND B` name, without unknown ones."""
    parts = {part for licence in licences for part in licence.split(" AND ")}
    return sorted(parts - {"unknown"})


def citation_file(licences: Sequence[str]) -> str:
    """Return the content of `CITATION.cff`, Citation File Format 1.2.0."""
    known = single_licences(licences)
    content = {
        "cff-version": "1.2.0",
        "message": "If you use this dataset, please cite it, and the works that its card credits.",
        "type": "dataset",
        "title": TITLE,
        "authors": [{"name": AUTHORS}],
        "version": VERSION,
        "date-released": PUBLISHED,
        **({"license": known if len(known) > 1 else known[0]} if known else {}),
        "keywords": list(KEYWORDS),
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
