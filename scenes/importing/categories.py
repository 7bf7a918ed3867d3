"""Categories of objects and types of rooms from their names: one table for all scene sources.

A name is split into lower-case words without accents; neighbouring words also count as one, and
plurals also as singulars. The first category of `categories.yaml` that has one of the words wins.
The table knows English and words of other large European languages.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise

from pbrnet.scenes.files import data_beside

_REMEMBERED = 1 << 16  # labels whose category is remembered

_TABLE = data_beside(__file__)
CATEGORIES = tuple(_TABLE["categories"])
_CATEGORY_OF_WORD = {
    hint: (rank, category)
    for rank, (category, hints) in reversed(list(enumerate(_TABLE["categories"].items())))
    for hint in (category.replace(" ", ""), *hints)
}
_FINISHES, _OTHER_STRUCTURE, _ROOMS_TOO, _HUNG, _HANGS = (
    frozenset(_TABLE[name]) for name in ("finishes", "structure", "rooms_too", "hung", "hangs")
)
_SURFACE_OF_WORD = {word: kind for kind, words in _TABLE["surfaces"].items() for word in words}
_SURFACES = frozenset(_SURFACE_OF_WORD)
_STRUCTURE = _OTHER_STRUCTURE | _SURFACES
_DOORS = ("door", "doors", "gate", "porte", "tur", "puerta", "porta", "doorway", "doorframe",
          "garage")  # fmt: skip
# What 3ds Max and others call any block: no carton.
_NUMBERED_BOX = re.compile(r"^box[ _.-]?\d+", re.IGNORECASE)
_BUILDING = ("stairs", "railing")
_WHOLE_BUILDING = ("roof", "pillar", "column", "beam", "toit", "dach", "chimneystack")


def category_of(*labels: str) -> str:
    """Return the category of the first of `labels` that tells one, else "other"."""
    return next((found for found in map(_category, labels) if found), "other")


def category_of_part(label: str, material: str) -> str:
    """Return the category of a part from its name, else from that of its material.

    A material tells nothing of a part whose name says that it is one of the building, and words
    for finishes tell nothing in its name: what is of `light_wood` is no lamp.
    `label` may be, or end with, the material's name, as in files without other names.
    """
    label = own_name(label, material)
    borrowed = _FINISHES & words_of(material) if label.endswith(material) else frozenset[str]()
    if found := _category(label, borrowed):
        return found
    return (not has_structural_name(label) and _category(material, _FINISHES)) or "other"


def own_name(label: str, material: str) -> str:
    """Return a part's name without that of its material behind it, as in "Desk_Light wood_0"."""
    stem = re.sub(r"_\d+$", "", label)
    return stem.removesuffix(f"_{material}") if material and stem != material else label


def has_structural_name(label: str) -> bool:
    """Return whether a name says that a shape is part of the building, as "Walls" does."""
    words = words_of(label)
    return bool(words & _STRUCTURE) and not words & _HANGS


def is_surface_by_name(label: str) -> bool:
    """Return whether a name calls a part a floor, ceiling or wall: that is its last word.

    So do "wall_3_18" and "Kitchen Floor", but not "wall art".
    """
    words = re.findall(r"[a-z]{2,}", _plain(_spaced(label)))
    return bool(words) and bool(words_of(words[-1]) & _SURFACES)


def surface_of(label: str) -> str:
    """Return "floor", "ceiling" or "wall" if a name has a word for one, else ""."""
    kinds = {_SURFACE_OF_WORD[word] for word in words_of(label) & _SURFACES}
    return next((kind for kind in _TABLE["surfaces"] if kind in kinds), "")


@lru_cache(_REMEMBERED)
def _category(label: str, without: frozenset[str] = frozenset()) -> str:
    """The category that the words of one label, but for those `without` meaning, tell, or ""."""
    words = words_of(_NUMBERED_BOX.sub("", label))
    if words & _SURFACES and not words & _HUNG:  # "toilet wall": the room, not the thing
        without |= _ROOMS_TOO
    ranked = [_CATEGORY_OF_WORD[word] for word in words - without if word in _CATEGORY_OF_WORD]
    return min(ranked)[1] if ranked else ""


def category_of_piece(kind: str, name: str, catalog_id: str, model: str = "") -> tuple[str, bool]:
    """Return the category of a piece of a home, and whether it is part of the building.

    `kind` is the tag of its element, `catalog_id` its identifier in a catalogue, and `model` the
    name of its model file.
    """
    identifier = catalog_id.rpartition("#")[2]
    if kind == "doorOrWindow":
        words = words_of(identifier) | words_of(name)
        return ("door" if words & set(_DOORS) else "window"), True
    if kind == "light":
        return "lamp", False
    for text in (identifier, name, model):
        if words_of(text) & set(_WHOLE_BUILDING):
            return "structure", True
        category = category_of(text)
        if category != "other":
            return category, category in _BUILDING
    return "other", False


def room_type(name: str, categories: Iterable[str]) -> str:
    """Return the type of a room from its name, else from the categories of its objects."""
    plain = _plain(name)
    words = words_of(name)
    for kind, hints in _TABLE["rooms"].items():
        if words & set(hints) or any(" " in hint and hint in plain for hint in hints):
            return kind
    squeezed = "".join(re.findall(r"[a-z]+", plain))
    for kind in _TABLE["rooms"]:
        if kind in squeezed:
            return kind
    inside = set(categories)
    kinds = [kind for kind, tells in _TABLE["room_furniture"].items() if inside & set(tells)]
    if "bathroom" in kinds and "kitchen" in kinds:
        return "living"  # a whole flat without closed doors
    return kinds[0] if kinds else "other"


def words_of(text: str) -> set[str]:
    """Return a text's lower-case words without accents, neighbours as one word, and singulars.

    Capitals inside a word and digits separate words, too.
    """
    found: set[str] = set()
    for part in (text, _spaced(text)):
        words = re.findall(r"[a-z]+", _plain(part))
        found.update(words, map("".join, pairwise(words)), ["".join(words)])
    return found | {one for word in found for one in _singulars(word)}


def _spaced(text: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)


def _singulars(word: str) -> tuple[str, ...]:
    if len(word) < 4 or not word.endswith("s") or word.endswith("ss"):
        return ()
    return (word[:-1], word[:-2]) if word.endswith("es") else (word[:-1],)


def _plain(text: str) -> str:
    if text.isascii():
        return text.casefold()
    decomposed = unicodedata.normalize("NFKD", text.casefold())
    return "".join(char for char in decomposed if not unicodedata.combining(char))
