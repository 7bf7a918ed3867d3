"""Rules that match catalogue assets to furniture kinds by words and size.

A catalogue describes a piece by name, tags and size. Words alone mislead ("bar chair", "armchair
ottoman"), so every rule also bounds the size. Own pieces state their category, which takes the
place of words. The rules are in `asset_rules.yaml`, all sizes in metres.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from pbrnet.scenes.assets.index import IndexEntry
from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.piece import Anchor

Range = tuple[float, float]
ANY_SIZE: Range = (0.0, 1e9)
# Outdoor furniture, vehicles, people, animals and parts of the building.
_EXCLUDED = re.compile(
    r"\b(outdoor|garden|patio|exterior|beach|deck|park|street|vehicle|human|people|animal|"
    r"staircase|doors? and windows?|characters|urinal|hospital|christmas|snow|broken)\b"
)


@dataclass(frozen=True)
class AssetRule:
    """Conditions on a catalogue entry, and the attributes of the furniture made from it.

    `words` are regular expressions, of which one must match "[group] name, tags, identifier" in
    lower case; none of `exclude` may match group and name. `lumens` bounds the flux of all light
    sources of a piece; (0, 0) excludes pieces with light sources. `stated` are the categories of
    own pieces that the kind takes besides its `category`.
    """

    kind: str
    words: tuple[str, ...]
    category: str
    anchor: Anchor
    width: Range = ANY_SIZE
    depth: Range = ANY_SIZE
    height: Range = ANY_SIZE
    exclude: tuple[str, ...] = ()
    top: Range = ANY_SIZE  # height of the upper end above the floor: elevation plus height
    elevation: Range = (0.0, 0.01)
    front_clearance: float = 0.0  # metres of free floor in front
    lumens: Range = (0.0, 0.0)
    stated: tuple[str, ...] = ()

    def matches(self, entry: IndexEntry) -> bool:
        """Return True if a catalogue entry meets all conditions."""
        return self.named_by(entry) and self.fits(entry)

    def named_by(self, entry: IndexEntry) -> bool:
        """Return True if the words of a catalogue entry name the kind."""
        # Tags are imprecise ("Outdoor" for a potted plant): exclusions look at the name alone.
        name = f"[{entry.group}] {entry.name}".lower()
        text = f"[{entry.group}] {entry.words}".lower()
        if _EXCLUDED.search(name) or not _any_of(self.words).search(text):
            return False
        return not (self.exclude and _any_of(self.exclude).search(name))

    def fits(self, entry: IndexEntry) -> bool:
        """Return True if sizes, elevation and light of a catalogue entry are those of the kind."""
        if entry.opening or bool(entry.lumens) != (self.lumens[1] > 0):
            return False
        measured = (*entry.size, entry.elevation, entry.elevation + entry.size[2])
        ranges = (self.width, self.depth, self.height, self.elevation, self.top)
        return all(
            low <= value <= high for value, (low, high) in zip(measured, ranges, strict=True)
        )


@cache
def _any_of(words: tuple[str, ...]) -> re.Pattern[str]:
    return re.compile(rf"\b(?:{'|'.join(words)})\b")


ASSET_RULES = tuple(
    build(AssetRule, {"kind": kind, **rule}, kind) for kind, rule in data_beside(__file__).items()
)


def rules_of_own(entry: IndexEntry) -> tuple[AssetRule, ...]:
    """Rules of the kinds that an own piece can replace: those of its category that have its size.

    If its words name some of them ("office chair"), only these.
    """
    stated = [
        rule
        for rule in ASSET_RULES
        if entry.category in (rule.category, *rule.stated) and rule.fits(entry)
    ]
    return tuple(rule for rule in stated if rule.named_by(entry)) or tuple(stated)
