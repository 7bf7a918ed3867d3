"""Pieces of a home that have no model to show: what they are, where they stand, what is kept.

Nothing stands in for them. A box of their size would be a thing that nobody has, in every
picture and every depth map; an empty place is at least a true room. Doors and windows still cut
their walls, lamps still give their light, and `scene.json` says of each piece where it stood, so
that whoever has its model may put it there.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, Literal

from scenes.contract import Point3
from scenes.importing.changes import Changes
from scenes.sweethome.home import HomePiece

ABSENT = "missing in the file"
_MAX_NAMES = 60  # of one sentence; `scene.json` has them all
_MAX_REASON = 160
_SENTENCES = {
    "nothing": "PIECES WITHOUT A MODEL WERE LEFT OUT",
    "light": "LAMPS WITHOUT A MODEL CAME IN AS BARE BULBS",
    "opening": "DOORS AND WINDOWS WITHOUT A MODEL CAME IN AS OPEN HOLES",
}


@dataclass(frozen=True)
class MissingPiece:
    """A piece whose model cannot be shown; metres and radians, the world's axes."""

    name: str
    category: str
    catalog_id: str
    creator: str
    model: str  # as the file names it
    reason: str
    kept: Literal["nothing", "light", "opening"]
    centre: Point3
    size: Point3  # width, depth, height, before it is turned
    angle: float  # about the vertical, counter-clockwise seen from above

    def as_record(self, room: str | None) -> dict[str, Any]:
        """What `scene.source["missing"]` holds of it."""
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
    """The record of a piece without a model; `elevation` is that of its level (cm)."""
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
    """Say of every kind of missing piece how many there are, and why, in one sentence each."""
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
