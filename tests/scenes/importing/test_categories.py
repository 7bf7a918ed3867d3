"""Categories and room types: one table, whatever the source and however a name is written."""

import csv
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from pbrnet.scenes.importing.categories import (
    CATEGORIES,
    category_of,
    category_of_part,
    category_of_piece,
    room_type,
)
from pbrnet.scenes.registry import import_scene
from tests.fixtures import mitsuba_files, sweethome
from tests.fixtures.gltf import square

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
    "cardboard_box.001": "box",
    "Box01": "other",  # a block, as 3ds Max names it
    "Box.002_lid": "other",
    "leaves": "plant",
    "four_poster_bed": "bed",
    "glass table": "table",
    "Canapé": "sofa",
    "Kühlschrank": "fridge",
    "mesh_017": "other",
    "Toilet_Floor": "other",
    "wall bath": "other",
    "wall-hung toilet": "toilet",
    "wall_lamp": "lamp",
    "": "other",
}


PARTS = {
    ("Floor", "Carpet"): "other",
    ("Wall_North", "light_wood"): "other",
    ("Ceiling", "Lit"): "other",
    ("Cube.001", "Mat.1"): "other",
    ("Cube.001", "mat_grey"): "other",
    ("Wall_West", "Glass"): "other",
    ("Plane", "Curtain fabric"): "curtain",
    ("Chair", "Lit"): "chair",
    ("wall_lamp", "Wood"): "lamp",
    ("light_wood", "light_wood"): "other",  # parts without names have those of their materials
    ("room_light_wood", "light_wood"): "other",
    ("Sofa", "Sofa"): "sofa",
    ("", "bed_sheet"): "bed",
    ("polySurface24_GreenLight_0", "GreenLight"): "other",  # as Sketchfab names meshes
    ("Wall_West_Glass_0", "Glass"): "other",
    ("Chair_GreenLight_0", "GreenLight"): "chair",
}


@pytest.mark.parametrize(("part", "material"), PARTS)
def test_a_name_of_a_part_goes_before_that_of_its_material(part: str, material: str) -> None:
    assert category_of_part(part, material) == PARTS[part, material]


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
    assert (len(named), len(classes)) == (112, 191)
    assert category_of("range_oven_with_hood", "kitchen_appliance") == "stove"
    assert category_of("bathtub", "bathroom_stuff") == "bath"
    for name, category in SHARED.items():
        assert category_of(name.lower(), "other") == category


def test_rooms_by_name_else_by_what_stands_in_them() -> None:
    assert room_type("livingroom3", []) == "living"
    assert room_type("my-living-room", []) == "living"
    assert room_type("Grey_White_Room", ["bed", "desk"]) == "bedroom"
    assert room_type("", ["table"]) == "dining"
    assert room_type("", ["toilet", "sink"]) == "bathroom"
    assert room_type("", ["bed", "toilet", "stove", "sofa"]) == "living"  # a flat without doors
    assert room_type("Flur", ["plant"]) == "other"


# Names that got another category with each importer before they shared one table.
SHARED = {"Chairs": "chair", "books": "books", "Microwave": "microwave", "washbasin": "wash basin"}


def a_home(folder: Path) -> Path:
    pieces = [
        sweethome.piece(name=name, model="box", x=60 + 90 * place, y=100, width=30, depth=30)
        for place, name in enumerate(SHARED)
    ]
    body = sweethome.usual("".join(pieces))
    return sweethome.pack(folder / "home.sh3d", body, {"box": sweethome.BOX})


def a_mitsuba_scene(folder: Path) -> Path:
    shapes = [
        f'<shape type="cube" id="{name}"><transform name="toWorld"><scale value="0.1"/>'
        f'<translate x="{0.6 + 0.9 * place}" y="0.1" z="-1"/></transform></shape>'
        for place, name in enumerate(SHARED)
    ]
    return mitsuba_files.write(folder, mitsuba_files.usual("".join(shapes)))


def a_gltf(folder: Path) -> Path:
    made = square()
    for place, name in enumerate(SHARED):
        made.node(mesh=0, name=name, scale=[0.1, 1, 0.1], translation=[2 * place, 1, 0])
    return made.save(folder / "site.glb")


def an_obj(folder: Path) -> Path:
    lines, count = ["o ground", "v 0 0 0", "v 9 0 0", "v 9 0 9", "f 1 2 3"], 3
    for place, name in enumerate(SHARED):
        lines += [f"o {name}", *(f"v {place + x} 1 {z}" for x, z in ((0, 0), (0.5, 0), (0, 0.5)))]
        lines.append(f"f {count + 1} {count + 2} {count + 3}")
        count += 3
    (folder / "site.obj").write_text("\n".join(lines))
    return folder / "site.obj"


@pytest.mark.parametrize("write", [a_home, a_mitsuba_scene, a_gltf, an_obj])
def test_every_importer_gives_a_name_the_same_category(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    (tmp_path / "in").mkdir()
    scene = import_scene(write(tmp_path / "in"), tmp_path / "out")
    found = {item.name: item.category for item in scene.objects if item.name in SHARED}
    assert found == SHARED
