"""Records of pieces without a readable model: name, place, reason, and what the scene keeps.

There is no substitute geometry: a box would be wrong in every image and depth map. Doors and
windows still cut their walls and lamps still emit light. `scene.json` records the place of each
missing piece, so that its model can be added later.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, Literal

from pbrnet.scenes.contract import Point3
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.home import HomePiece

ABSENT = "missing in the file"
_MAX_NAMES = 60  # in one sentence; `scene.json` lists all
_MAX_REASON = 160
_SENTENCES = {
    "nothing": "PIECES WITHOUT A MODEL WERE LEFT OUT",
    "light": "LAMPS WITHOUT A MODEL CAME IN AS BARE BULBS",
    "opening": "DOORS AND WINDOWS WITHOUT A MODEL CAME IN AS OPEN HOLES",
}


@dataclass(frozen=True)
class MissingPiece:
    """A piece whose model cannot be read; metres and radians, world axes."""

    name: str
    category: str
    catalog_id: str
    creator: str
    model: str  # as the file names it
    reason: str
    kept: Literal["nothing", "light", "opening"]
    centre: Point3
    size: Point3  # width, depth, height, before rotation
    angle: float  # about the vertical, counter-clockwise seen from above

    def as_record(self, room: str | None) -> dict[str, Any]:
        """Return the entry of `scene.source["missing"]`."""
        return {
            "name": self.name,
            "category": self.category,
            "catalog_id": self.catalog_id,
            "creator": self.creator,
            "model": self.model,
            "reason": self.reason,
            "kept": self.kept,
            "centre": list(self.centre),
            "size": list(self.size),
            "angle": self.angle,
            "room": room,
        }


def missing_piece(piece: HomePiece, category: str, elevation: float, reason: str) -> MissingPiece:
    """Return the record of a piece without a model; `elevation` is that of its level (cm)."""
    kept: Literal["nothing", "light", "opening"] = "nothing"
    if piece.cut is not None:
        kept = "opening"
    elif piece.bulbs:
        kept = "light"
    middle = elevation + piece.elevation + piece.height / 2
    return MissingPiece(
        name=piece.name or category,
        category=category,
        catalog_id=piece.catalog_id,
        creator=piece.creator,
        model=piece.model or "",
        reason=reason[:_MAX_REASON],
        kept=kept,
        centre=(round(0.01 * piece.x, 5), round(-0.01 * piece.y, 5), round(0.01 * middle, 5)),
        size=(
            round(0.01 * piece.width, 5),
            round(0.01 * piece.depth, 5),
            round(0.01 * piece.height, 5),
        ),
        angle=round(-piece.angle, 6),
    )


def note_missing(pieces: list[MissingPiece], changes: Changes) -> None:
    """Note the missing pieces in `changes`, with counts and reasons, one sentence a kind."""
    for kept, sentence in _SENTENCES.items():
        counts = Counter(
            one.name if one.reason == ABSENT else f"{one.name} ({one.reason})"
            for one in pieces
            if one.kept == kept
        )
        if not counts:
            continue
        named = [f"{count} x {name}" if count > 1 else name for name, count in counts.items()]
        more = f" and {len(named) - _MAX_NAMES} kinds more" if len(named) > _MAX_NAMES else ""
        changes.note(f"{sentence} ({counts.total()}): {{}}{more}", ", ".join(named[:_MAX_NAMES]))
