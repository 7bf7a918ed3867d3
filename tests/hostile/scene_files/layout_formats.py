"""Hostile layouts in the formats of others, and tables of own pieces."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.fixtures.layout_formats import SPATIALLM, capture, house, model
from tests.hostile.family import Arguments, Base, Family, Made, Victim
from tests.hostile.made import with_file, with_link, with_value
from tests.hostile.mutations import LONG, damaged_json, damaged_text, deep
from tests.hostile.project_files.base import write_params

PLAIN = "--out out --outdoors none"
HOUSE, CAPTURE, MODEL, TEXT = (
    f"import {name} {PLAIN}" for name in ("house.json", "room.json", "a.hbjson", "a.txt")
)
ASSETS = "assets --data data --workers 1"
WALL = "wall_{}=Wall({},{},0,{},{},0,2.5,0)\n"


def _json(name: str, made: Callable[[], dict[str, Any]]) -> Base:
    return lambda folder: (folder / name).write_text(json.dumps(made()))


def _text(folder: Path) -> None:
    (folder / "a.txt").write_text(SPATIALLM)


def _line(line: str) -> Made:
    return with_file("a.txt", SPATIALLM + line, TEXT)


def _itself(folder: Path) -> Arguments:
    """Things on things on things."""
    content = house()
    for number in range(300):
        content["objects"] = [{**content["objects"][0], "children": content["objects"][:1],
                               "id": f"thing|{number}"}]  # fmt: skip
    (folder / "house.json").write_text(json.dumps(content))
    return HOUSE.split()


HOUSES = (
    _itself,
    with_file("house.json", '{"walls": [], "rooms": ' + deep() + "}", HOUSE),
    with_file("house.json", json.dumps(house()).replace("0.22", "NaN"), HOUSE),
    with_file("house.json", json.dumps(house()).replace("0.22", "1e400"), HOUSE),
    with_file("house.json", json.dumps(house()).replace("0.22", LONG), HOUSE),
    with_value("house.json", HOUSE, ("rooms", 0, "floorPolygon", 0, "x"), 1e300),
    with_value("house.json", HOUSE, ("rooms", 0, "floorPolygon", 0, "x"), 9e5),
    with_value("house.json", HOUSE, ("rooms", 0, "id"), "../" * 300),
    with_value("house.json", HOUSE, ("rooms", 0, "roomType"), {"Bedroom": 1}),
    with_value("house.json", HOUSE, ("rooms",), [{"floorPolygon": []}] * 300),
    with_value("house.json", HOUSE, ("objects",), [{}] * 1_000_000),
    with_value("house.json", HOUSE, ("objects", 0, "children"), 7),
    with_value("house.json", HOUSE, ("objects", 0, "assetId"), "a_" * 4000),
    with_value("house.json", HOUSE, ("objects", 0, "rotation"), None),
    with_value("house.json", HOUSE, ("doors", 0, "openness"), -1e5),
    with_value("house.json", HOUSE, ("doors", 0, "wall0"), "wall|none"),
    with_value("house.json", HOUSE, ("walls", 0, "polygon"), [{"x": 0, "z": 0}] * 4),
    with_file("b.json", "[" * 90, f"{HOUSE} --assets b.json"),
    with_file("b.json", '{"Bed": [{"assetId": "Bed_3"}]}', f"{HOUSE} --assets b.json"),
    with_link("b.json", "/dev/zero", f"{HOUSE} --assets b.json"),
)
CAPTURES = (
    with_value("room.json", CAPTURE, ("walls", 0, "transform"), [1e300] * 16),
    with_value("room.json", CAPTURE, ("walls", 0, "transform"), [[1, 0, 0, 0]] * 4),
    with_value("room.json", CAPTURE, ("walls", 0, "dimensions"), [-1, 0, "x"]),
    with_value("room.json", CAPTURE, ("walls", 0, "dimensions"), [9e5, 9e5, 0]),
    with_value("room.json", CAPTURE, ("objects", 0, "category"), {"sofa": {}, "bed": {}}),
    with_value("room.json", CAPTURE, ("objects", 0, "attributes"), ["x"]),
    with_value("room.json", CAPTURE, ("objects", 0, "dimensions"), [900, 900, 900]),
    with_value("room.json", CAPTURE, ("sections",), [{"label": 5, "center": [0, 0, 0]}]),
    with_value("room.json", CAPTURE, ("walls",), capture()["walls"] * 1000),
    with_file("room.json", '{"rooms": [' + '{"rooms": [' * 400 + "]}" * 401, CAPTURE),
)
MODELS = (
    with_value("a.hbjson", MODEL, ("units",), ["Meters"]),
    with_value("a.hbjson", MODEL, ("rooms", 0, "faces"), [{}]),
    with_value("a.hbjson", MODEL, ("rooms", 0, "faces", 0, "geometry", "boundary"), [[0] * 3] * 9),
    with_value("a.hbjson", MODEL, ("rooms", 0, "faces", 0, "geometry", "boundary", 0, 0), 9e5),
    with_value("a.hbjson", MODEL, ("rooms", 0, "identifier"), None),
    with_value("a.hbjson", MODEL, ("rooms",), model()["rooms"] * 200),
    with_file("a.hbjson", "{}", MODEL),
    with_file("a.hbjson", json.dumps(model()), f"{MODEL} --storey {LONG[:300]}"),
)
TEXTS = (
    _line("__import__('os').system('touch evil')\n"),
    _line("wall_9=Wall(open('evil','w'),0,0,0,0,0,0,0)\n"),
    _line("wall_9=Wall(" + "(" * 100_000 + ")\n"),
    _line("wall_9=Wall(" + "1," * 100_000 + "1)\n"),
    _line("wall_9=Wall(1e999,nan,-inf,0x10,1_0,٣,0,0)\n"),
    _line("wall_9=Wall(0,0,0,1e5,1e5,0,2.5,0)\n"),
    _line("bbox_9=Bbox(" + "a" * 10**6 + ",1,1,1,0,1,1,1)\n"),
    _line("bbox_9=Bbox(sofa,1,1,1,0,1e5,1e5,1e5)\n"),
    _line("bbox_9=Bbox(sofa,1,1,1,0,1,1,1)\n" * 30_000),
    _line("door_9=Door(wall_1,4,1,1,0,1e-9)\n"),
    with_file("a.txt", "".join(WALL.format(n, n, 0, n, 9) for n in range(3000)), TEXT),
    with_file("a.txt", "".join(WALL.format(n, 1, 1, 1, 1) for n in range(300)), TEXT),
    with_file("a.txt", b"wall_0=Wall(\xff\xfe,0,0,0,0,0,0,0)", TEXT),
    with_file("a.txt", "", TEXT),
    with_file("a.txt", "a shopping list", TEXT),
)


def _pieces(folder: Path) -> None:
    write_params(folder, assets={"enabled": True, "folder": "mine"}, farm={"workers": 1})
    (folder / "mine").mkdir()
    (folder / "mine/stool.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    (folder / "mine/pieces.csv").write_text(
        "file,category,width,depth,height\nstool.obj,stool,0.4,0.4,0.4\n"
    )


def _rows(rows: str) -> Made:
    return with_file("mine/pieces.csv", f"file,category,width,depth\n{rows}", ASSETS)


TABLES = (
    _rows("../../etc/passwd,stool,1,1\n"),
    _rows("/dev/zero,stool,1,1\n"),
    _rows("stool.obj,stool,1,1\n" * 30_000),
    _rows(f"stool.obj,stool,{LONG},1\n"),
    _rows("\x00.obj,stool,1,1\n"),
    _rows('"' + "a" * 200_000 + '",stool,1,1\n'),
    with_file("mine/pieces.csv", b"\xff\xfe", ASSETS),
    with_file("mine/stool.obj", b"v nan 0 0\n" * 9 + b"f 1 2 3\n", ASSETS),
    with_link("mine/pieces.csv", "pieces.csv", ASSETS),
    with_link("mine/stool.obj", "/dev/zero", ASSETS),
)


def _family(name: str, base: Base, file: str, command: str, made: tuple[Made, ...]) -> Family:
    damage = damaged_text if file.endswith("txt") else damaged_json
    return Family(name, 60, base, (Victim(file, damage, (command,)),), made, seconds=0.8)


FAMILIES = (
    _family("houses of ProcTHOR", _json("house.json", house), "house.json", HOUSE, HOUSES),
    _family("captures of RoomPlan", _json("room.json", capture), "room.json", CAPTURE, CAPTURES),
    _family("models of Honeybee", _json("a.hbjson", model), "a.hbjson", MODEL, MODELS),
    _family("text of SpatialLM", _text, "a.txt", TEXT, TEXTS),
    Family(
        "own pieces",
        30,
        _pieces,
        (
            Victim("mine/pieces.csv", damaged_text, (ASSETS,)),
            Victim("mine/stool.obj", damaged_text, (ASSETS,)),
        ),
        TABLES,
        seconds=2.0,
    ),
)
