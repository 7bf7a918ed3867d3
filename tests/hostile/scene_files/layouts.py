"""Hostile layouts: rooms, openings and boxes that cannot be, and damaged JSON."""

import json
from pathlib import Path
from typing import Any

from tests.fixtures.layouts import FLAT, changed, write_layout
from tests.hostile.family import Family, Victim
from tests.hostile.made import case, with_link
from tests.hostile.mutations import LONG, damaged_json, damaged_text, deep

LAYOUT = "import flat.json --out out --outdoors none"


def _flat(folder: Path) -> None:
    write_layout(folder / "flat.json", FLAT)


@case
def _made(folder: Path, content: dict[str, Any] | str) -> str:
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / "flat.json").write_text(text)
    return LAYOUT


def _room(polygon: Any, **keys: Any) -> dict[str, Any]:
    return changed(rooms=[{"polygon": polygon, **keys}], openings=[], objects=[])


def _objects(*objects: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return changed(objects=[{"category": "chair", "at": [1, 1], **one} for one in objects], **keys)


def _openings(*openings: dict[str, Any]) -> dict[str, Any]:
    return changed(openings=[{"kind": "window", **one} for one in openings], objects=[])


_SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]
_COMB = [[0.02 * (k // 2), 0.01 + 3 * (k % 4 in (1, 2))] for k in range(390)] + [[4, 0], [0, 0]]
_STAR = [[2 + (2 if k % 2 else 0.02) * (1 if k % 4 < 2 else -1), 0.01 * k] for k in range(100)]
MADE = (
    _made('{"pbrnet": "layout", "rooms": ' + deep() + "}"),
    _made('{"pbrnet": "layout", "rooms": [' + '{"rectangle":[0,0,1,1]},' * 1_000_000 + "{}]}"),
    _made(json.dumps(FLAT).replace("5.5", "NaN")),
    _made(json.dumps(FLAT).replace("5.5", LONG)),
    _made(json.dumps(FLAT).replace("5.5", "1e400")),
    _made(_room([[0, 0], [4, 4], [4, 0], [0, 4]])),
    _made(_room([[0, 0]] * 5)),
    _made(_room([[0, 0], [1, 1], [2, 2]])),
    _made(_room([[0, 0], [1e300, 0], [0, 1e300]])),
    _made(_room([[0, 0], [900, 0], [900, 900], [0, 900]])),
    _made(_room(_COMB)),
    _made(_room(_STAR)),
    _made(_room(_SQUARE * 90)),
    _made(_room(_SQUARE, height=-1)),
    _made(_room(_SQUARE, height=1e9)),
    _made(_room(_SQUARE, id="../../evil")),
    _made(_room(_SQUARE, id="\x1b[2J\nError", name="\u202e" * 5000)),
    _made(_room(_SQUARE, id="a" * 100_000, type="palace")),
    _made(changed(rooms=[{"polygon": _SQUARE}] * 2, openings=[], objects=[])),
    _made(changed(rooms=[{"polygon": _SQUARE, "id": f"r{k}"} for k in range(200)], openings=[])),
    _made(
        changed(
            strict=False,
            rooms=[{"polygon": _SQUARE}, {"rectangle": [1, 1, 2, 2]}],
            openings=[],
            objects=[],
        )
    ),
    _made(changed(wall=1.0, outer_wall=2.0, rooms=FLAT["rooms"] * 2)),
    _made(_openings({"start": [40, 40], "end": [41, 40]})),
    _made(_openings({"start": [0, 1], "end": [0, 1]})),
    _made(_openings({"start": [1, 0], "end": [2, 0], "bottom": 2, "top": 1})),
    _made(_openings(*({"room": "bath", "wall": "north", "width": 0.3, "at": 1},) * 2000)),
    _made(_openings({"between": ["living", "living"]})),
    _made(_openings({"room": "living", "wall": "north", "width": 1e308, "at": 1e308})),
    _made(_openings({"room": "living", "wall": "south", "top": 99})),
    _made(_objects({"size": [-1, 1, 1]})),
    _made(_objects({"size": [1e-3, 1e-3, 1e-3]}, {"size": [99, 99, 99]}, {"yaw": 1e6})),
    _made(_objects({"at": []}, {"at": [1] * 100_000})),
    _made(_objects({"category": ""})),
    _made(_objects({"category": "../../evil\x1b[2J", "size": [1, 1, 1], "name": "\n" * 99})),
    _made(_objects({"id": "a", "on": "a"})),
    _made(_objects({"kind": "__init__"}, {"kind": "sofa", "size": [0.1, 0.1, 0.1]})),
    _made(_objects(*({"category": "rug", "size": [1, 1, 0.01]},) * 10_001)),
    _made(changed(seed=-(1 << 70))),
    _made(changed(pbrnet="layout", version=2)),
    _made("[]"),
    _made("\ufeff" + json.dumps(FLAT)),
    with_link("flat.json", "flat.json", LAYOUT),
    with_link("flat.json", "/dev/zero", LAYOUT),
)

FAMILIES = (
    Family(
        "layouts",
        160,
        _flat,
        (
            Victim("flat.json", damaged_json, (LAYOUT,)),
            Victim("flat.json", damaged_text, (LAYOUT,)),
        ),
        MADE,
        seconds=0.8,
    ),
)
