"""Categories and room types: one table, whatever the source and however a name is written."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import pytest

from scenes.importing.categories import CATEGORIES, category_of, category_of_piece, room_type

NAMES = {
    "Chairs": "chair",
    "dining_chair.003": "chair",
    "officeChair": "chair",
    "books": "books",
    "Book": "books",
    "Livres": "books",
    "Microwave": "microwave",
    "washbasin": "wash basin",
    "Wash basin": "wash basin",
    "WashBasin_2": "wash basin",
    "Bedside table": "night table",
    "bookcase": "bookshelf",
    "bookshelves": "bookshelf",
    "Shelves": "shelf",
    "hanging_kitchen_cabinet": "kitchen unit",
    "kitchenCabinet": "kitchen unit",
    "TV stand": "tv stand",
    "tv": "television",
    "bath mat": "rug",
    "Towel rack": "towel rail",
    "drawers": "chest",
    "picture_frame": "picture",
    "door_frame": "door",
    "wine glasses": "glass",
    "boxes": "box",
    "leaves": "plant",
    "four_poster_bed": "bed",
    "glass table": "table",
    "Canapé": "sofa",
    "Kühlschrank": "fridge",
    "mesh_017": "other",
    "": "other",
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_has_one_category_whatever_the_source(name: str) -> None:
    category = NAMES[name]
    assert category_of(name) == category
    assert category_of("", name) == category
    assert category_of_piece("pieceOfFurniture", name, "")[0] == category
    assert category_of_piece("pieceOfFurniture", "", f"eTeks#{name}")[0] == category


def test_every_category_has_its_own_name_first() -> None:
    for category in CATEGORIES:
        assert category_of(category) == category
    assert max(Counter(CATEGORIES).values()) == 1


def test_the_release_of_pbrs_comes_into_the_same_table(shared_scenes: Path) -> None:
    with (shared_scenes / "pbrs" / "ModelCategoryMappingNewActive.csv").open() as file:
        classes = {(row["fine_grained_class"], row["coarse_grained_class"])
                   for row in csv.DictReader(file)}  # fmt: skip
    named = {pair for pair in classes if category_of(*pair) != "other"}
    assert len(named) > 0.55 * len(classes)
    assert category_of("range_oven_with_hood", "kitchen_appliance") == "stove"
    assert category_of("bathtub", "bathroom_stuff") == "bath"


def test_rooms_by_name_else_by_what_stands_in_them() -> None:
    assert room_type("livingroom3", []) == "living"
    assert room_type("my-living-room", []) == "living"
    assert room_type("Grey_White_Room", ["bed", "desk"]) == "bedroom"
    assert room_type("", ["table"]) == "dining"
    assert room_type("Flur", ["plant"]) == "other"
