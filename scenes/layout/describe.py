"""Description of a generated home as a layout, which programs change and `pbrnet import` reads."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.scenes.files import write_text
from pbrnet.scenes.layout.layout import OpeningKind as StatedKind
from pbrnet.scenes.layout.readers.own import KEY, VALUE
from pbrnet.scenes.looks import HomeSettings
from pbrnet.scenes.procedural.design import Design, design_home
from pbrnet.scenes.procedural.furnishing.placement import PlacedInRoom
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from pbrnet.scenes.procedural.plan import Opening, OpeningKind

_KINDS: dict[OpeningKind, StatedKind] = {
    "door": "door", "archway": "archway", "open": "opening", "entrance": "entrance",
    "window": "window", "patio": "window",
}  # fmt: skip


def describe_homes(
    homes: Iterable[tuple[str, HomeSettings]], assets: Path, out: Path
) -> Iterator[Path]:
    """Write homes to a folder as layouts, `home-0000.layout.json`, and yield the files.

    No scene is made; `assets` is the folder of converted catalogues.
    """
    for scene_id, home in homes:
        yield write_layout(out, described(design_home(home, assets), scene_id, home.seed))


def described(design: Design, name: str, seed: int) -> dict[str, Any]:
    """Return a home as the content of a layout in pbrnet's own format.

    Sloping ceilings, beams, stairs, niches and cloth over furniture are left out.
    """
    plan = design.plan
    return {
        KEY: VALUE,
        "name": name,
        "style": design.style.name,
        "seed": seed % (1 << 63),
        "author": "pbrnet",
        "licence": "CC0-1.0",
        "source": "generated",
        "height": round(plan.height, 4),
        "wall": round(plan.partition, 4),
        "outer_wall": round(plan.outer_thickness, 4),
        "rooms": [
            {"id": room.id, "type": room.type, "polygon": _rounded(room.polygon)}
            for room in plan.rooms
        ],
        "openings": [_opening(one) for one in plan.openings],
        "objects": [
            _object(each)
            for each in design.furniture
            if each.placed.kind in FURNITURE_KINDS or each.placed.kind in THINGS
        ],
    }


def write_layout(out: Path, content: Mapping[str, Any]) -> Path:
    """Write a layout to a folder under its name and return the file."""
    out.mkdir(parents=True, exist_ok=True)
    place = out / f"{content['name']}.layout.json"
    write_text(place, layout_text(content))
    return place


def layout_text(content: Mapping[str, Any]) -> str:
    """JSON of a layout with one room, opening or object per line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, list) and value:
            inner = ",\n".join(f"    {json.dumps(one)}" for one in value)
            lines.append(f"  {json.dumps(key)}: [\n{inner}\n  ]")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _rounded(points: Iterable[tuple[float, float]]) -> list[list[float]]:
    return [[round(x, 5), round(y, 5)] for x, y in points]


def _opening(one: Opening) -> dict[str, Any]:
    made: dict[str, Any] = {"kind": _KINDS[one.kind], "id": one.id, "room": one.rooms[0]}
    made["start"], made["end"] = _rounded((one.start, one.end))
    made |= {"bottom": round(one.z0, 5), "top": round(one.z1, 5)}
    if one.kind in ("door", "entrance"):
        made |= {"open_degrees": round(one.angle, 3), "swing": one.swing}
        made["hinge"] = "start" if one.hinge_at_start else "end"
    return made


def _object(each: PlacedInRoom) -> dict[str, Any]:
    """A piece as its category, kind and box along its own axes."""
    piece, pose = each.placed.piece, each.placed.pose
    low, high = piece.bounds
    bottom = np.array([[*(0.5 * (low + high))[:2], low[2]]])
    x, y, z = np.round(pose.apply(bottom)[0], 4).tolist()
    return {
        "category": piece.category,
        "kind": each.placed.kind,
        "id": each.placed.id,
        "room": each.room,
        "at": [x, y, z],
        "size": np.round(high - low, 4).clip(1e-3).tolist(),
        "yaw": round(pose.yaw, 3),
    }
