"""Pieces of furniture as items of the scene, with ids, panes left out and lamps lit."""

from __future__ import annotations

import re
from dataclasses import replace

from pbrnet.scenes.formats.model_parts import UnreadableModel
from pbrnet.scenes.importing.categories import category_of_piece
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.names import numbered
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID
from pbrnet.scenes.sweethome.building.plan import Level, cutting_pieces
from pbrnet.scenes.sweethome.credits import Credits
from pbrnet.scenes.sweethome.furnishing.furniture import (
    PlacedModel,
    place_piece,
    place_without_model,
)
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem
from pbrnet.scenes.sweethome.furnishing.lamps import lit_parts
from pbrnet.scenes.sweethome.furnishing.missing import MissingPiece, missing_piece
from pbrnet.scenes.sweethome.furnishing.models import Models
from pbrnet.scenes.sweethome.furnishing.sashes import hinges
from pbrnet.scenes.sweethome.home import HomePiece
from pbrnet.scenes.sweethome.options import SweetHomeOptions

# Beginnings of generated ids.
_RESERVED_STEMS = ("wall", "floor", "ceiling", "skirting", "slab", "ground", GAP_SEALING_ID)
# Pieces are lifted slightly, neighbours by different amounts, so that no faces coincide with
# floors, sills and tops of other pieces.
_LIFT, _LIFT_STEPS = 0.02, 8  # cm; number of different amounts


def furniture_items(
    levels: list[Level],
    models: Models,
    options: SweetHomeOptions,
    credits: Credits,
    changes: Changes,
) -> tuple[list[PlacedItem], list[MissingPiece]]:
    """Return the pieces as items, and the records of those whose model cannot be read."""
    items: list[PlacedItem] = []
    missing: list[MissingPiece] = []
    taken: dict[str, int] = {}
    cutting = cutting_pieces(levels)
    for level in levels:
        for piece in level.storey.pieces:
            if min(piece.width, piece.height, piece.depth) <= 0:
                changes.note("pieces without size were left out: {}", piece.name or piece.id)
                continue
            category, is_structure = category_of_piece(
                piece.kind, piece.name, piece.catalog_id, piece.model or ""
            )
            elevation = level.storey.elevation
            try:
                lifted = elevation + _LIFT * (2 + len(taken) % _LIFT_STEPS)
                placed = _placed_model(piece, lifted, models, credits, changes)
            except UnreadableModel as error:
                missing.append(missing_piece(piece, category, elevation, str(error)))
                placed = place_without_model(piece, elevation)
            parts, lumens = placed.parts, 0.0
            if id(piece) in cutting:
                panes = [part for part in parts if part.finish.kind == "glass"]
                if panes:
                    changes.note("clear panes of doors and windows were left out: {}", piece.name)
                    parts = tuple(part for part in parts if part.finish.kind != "glass")
            if (piece.bulbs or piece.emissive_materials) and options.lamps != "off":
                lamp = piece
                if options.lamps == "on" and piece.power <= 0:
                    lamp = replace(piece, power=0.5)
                parts, lumens = lit_parts(lamp, parts, placed.to_world, changes)
            if not parts:
                continue
            name = _unique(piece.name or category, taken)
            items.append(
                PlacedItem(
                    name,
                    piece.name or category,
                    category,
                    parts,
                    is_structure,
                    None,
                    lumens,
                    level.storey.number,
                    hinges(piece, name, parts),
                )
            )
    return items, missing


def _placed_model(
    piece: HomePiece, elevation: float, models: Models, credits: Credits, changes: Changes
) -> PlacedModel:
    if piece.model is None:
        raise UnreadableModel("the home names none")
    model = models.get(piece.model)
    placed = place_piece(piece, model, elevation, changes)
    credits.model(piece.name, piece.creator, piece.model, model)
    return placed


def _unique(name: str, taken: dict[str, int]) -> str:
    """A new id that resembles `name`, see `numbered`."""
    stem = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60].lower() or "piece"
    if stem.partition("-")[0] in _RESERVED_STEMS:
        stem = f"piece-{stem}"
    return numbered(stem, "-", taken)
