"""Descriptions and pictures of converted furniture catalogues and their pieces."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.images import Picture, contact_sheet, enlarge, read_picture
from pbrnet.pipeline.inspection.sections import rows_of
from pbrnet.scenes.assets.index import PREVIEW, Asset, AssetIndex, IndexEntry
from pbrnet.scenes.files import read_bytes
from pbrnet.scenes.procedural.furnishing.asset_sampler import build_kind_index

_COLUMNS = 12
_ROWS = 2  # per category
_GAP = np.array([24, 24, 27], dtype=np.uint8)  # the sheet's background


def describe_index(index: AssetIndex) -> dict[str, Any]:
    """Return sections on libraries, pieces by category and licence, and refused pieces."""
    return {
        "Libraries": [
            {**row, "from": library.package or library.file}
            for row, library in zip(
                rows_of(index.libraries, "library=key", "pieces", "usable", "version", "licence"),
                index.libraries,
                strict=True,
            )
        ],
        "Categories": dict(Counter(piece.category for piece in index.pieces).most_common()),
        "Licences": dict(Counter(piece.licence for piece in index.pieces).most_common()),
        "Can stand in for": {
            kind: len(pieces) for kind, pieces in build_kind_index(index).kinds.items() if pieces
        },
        "Triangles": _triangles(index.pieces),
        "Refused": rows_of(index.refused, "piece=key", "name", "reason"),
    }


def _triangles(pieces: tuple[IndexEntry, ...]) -> dict[str, int]:
    counts = sorted(piece.triangles for piece in pieces)
    if not counts:
        return {}
    return {"median": counts[len(counts) // 2], "most": counts[-1], "together": sum(counts)}


def describe_asset(asset: Asset) -> dict[str, Any]:
    """Return sections on a piece: sizes, provenance, parts, support surfaces and checks."""
    piece, origin = asset.piece, asset.provenance
    return {
        "General": {
            "name": piece.name,
            "category": f"{piece.category} ({piece.group})",
            "size m": " x ".join(f"{side:.3f}" for side in piece.size),
            "elevation m": piece.elevation,
            "light sources": len(piece.lights),
            "lumens": round(asset.lumens),
            "boxes": len(asset.boxes),
        },
        "Provenance": {
            "creator": piece.creator,
            "licence": piece.licence,
            "library": f"{origin.library} {origin.version}",
            "file": f"{origin.file}, SHA-256 {origin.sha256}",
            "package": origin.package,
            "provider": origin.provider,
        },
        "Parts": [
            {**row, "texture": row["texture"] or ""}
            for row in rows_of(asset.parts, "mesh", "kind", "triangles", "texture", "lumens")
        ],
        "Support surfaces": [
            {
                "height m": level.z,
                "size m": f"{2 * level.half_x:.2f} x {2 * level.half_y:.2f}",
                "headroom m": level.headroom,
            }
            for level in asset.levels
        ],
        "Checks": {
            "triangles": asset.checks.triangles,
            "dropped": asset.checks.dropped,
            "size error m": asset.checks.size_error,
            "textures": asset.checks.textures,
        },
        "Changed or lost": list(asset.checks.notes),
    }


def draw_index(index: AssetIndex) -> Picture:
    """Draw pieces of every category, the largest first, at most two rows each."""
    by_category: dict[str, list[IndexEntry]] = {}
    for piece in index.pieces:
        by_category.setdefault(piece.category, []).append(piece)
    strips = []
    for category, pieces in sorted(by_category.items(), key=lambda item: (-len(item[1]), item[0])):
        step = max(1, len(pieces) // (_COLUMNS * _ROWS))
        shown = pieces[::step][: _COLUMNS * _ROWS]
        pictures = [_preview(index.folder / piece.key) for piece in shown]
        labels = [
            f"{category} ({len(pieces)})" if number == 0 else piece.name
            for number, piece in enumerate(shown)
        ]
        strips.append(contact_sheet(pictures, _COLUMNS, labels))
    if not strips:
        return contact_sheet([], 1)
    width = max(strip.shape[1] for strip in strips)
    sheet = np.tile(_GAP, (sum(len(strip) for strip in strips), width, 1))
    tops = np.cumsum([0, *(len(strip) for strip in strips)])
    for top, strip in zip(tops, strips, strict=False):
        sheet[top : top + len(strip), : strip.shape[1]] = strip
    return sheet


def draw_asset(folder: Path) -> Picture:
    """Draw the piece's preview, enlarged."""
    return enlarge(_preview(folder), 448)


def _preview(folder: Path) -> Picture:
    path = folder / PREVIEW
    return (
        read_picture(read_bytes(path)) if path.is_file() else np.full((112, 112, 3), 60, np.uint8)
    )
