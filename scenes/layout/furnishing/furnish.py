"""Furnishing of a layout: a piece for each box, and a lamp for each room without one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from shapely.geometry import Point, Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.regions import deepest_point, meets
from pbrnet.scenes.importing.categories import CATEGORIES
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.plan import printable
from pbrnet.scenes.layout.furnishing.fitting import (
    Fit,
    Place,
    anchor_of,
    fit_piece,
    kinds_for,
    plain_box,
)
from pbrnet.scenes.layout.furnishing.placing import TOLERANCE, Standing, apart, out_of_walls
from pbrnet.scenes.layout.layout import Layout, LayoutObject
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.placement import CEILING_LAMPS, PlacedInRoom
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece, collision_boxes
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, Style
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Plan, PlanRoom
from pbrnet.scenes.procedural.scene_item import Pose
from pbrnet.scenes.seeds import Draw

_BESIDE = 0.6  # metres from its room, within which an object still belongs to it
_NEAR = 0.15  # metres from floor or ceiling to a box that stands or hangs there
_WAY = 0.3  # metres before a door that are free
_HEADROOM = 2.05  # metres below a hanging lamp


@dataclass(frozen=True)
class Furnished:
    """Placed pieces, and what `scene.json` records of each stated object."""

    placed: tuple[PlacedInRoom, ...]
    standing: tuple[Standing, ...]
    record: dict[str, Any]


@dataclass(frozen=True)
class _Piece:
    """The piece for a stated object, before and after it was placed."""

    stated: LayoutObject
    fit: Fit
    standing: Standing


def furnish_layout(
    rng: Draw,
    layout: Layout,
    plan: Plan,
    style: Style,
    sampler: AssetSampler | None,
    changes: Changes,
    add_lamps: bool = True,
) -> Furnished:
    """Fill every box of a layout with a piece; `plan` is that of the layout.

    What fits no piece becomes a plain box. What collides moves by at most the tolerance. All of
    that is named in `changes`.
    """
    by_id = {one.id: room for one, room in zip(layout.rooms, plan.rooms, strict=True)}
    pieces = []
    for number, stated in enumerate(layout.objects):
        room = _room_of(stated, plan, by_id)
        if room is None and layout.strict:
            raise InputError(f"objects[{number}]: the {stated.category!r} lies in no room")
        if room is None:
            changes.note("left out, since it lies in no room: {}", _named(stated))
            continue
        fit = _fitted(rng, stated, plan, room, style, sampler, changes)
        piece = replace(fit.piece, category=_category(stated, fit.piece))
        pose = _pose(piece, stated, _place(stated, plan, room), fit.kind)
        one = Standing(piece, pose, room, piece.category, stated.on is not None)
        pieces.append(_Piece(stated, fit, one))
    standing = _placed_clear(pieces, plan, changes)
    _note_blocked(pieces, standing, plan, changes)
    kinds = [each.fit.kind for each in pieces]
    placed = [_as_placed(*each) for each in zip(count(), kinds, standing, strict=False)]
    lamps = _added_lamps(rng, plan, style, standing, len(placed)) if add_lamps else []
    if lamps:
        changes.note("a ceiling lamp was added to each room without a lamp: {}",
                     ", ".join(each.room for each in lamps))  # fmt: skip
    return Furnished((*placed, *lamps), tuple(standing), _record(pieces, placed))


def _record(pieces: Sequence[_Piece], placed: Sequence[PlacedInRoom]) -> dict[str, Any]:
    """Counts of objects and plain boxes, how well pieces fill their boxes, and which is which.

    `stated` has, for the id of each stated object, the id of its piece in the scene and their
    intersection over union, None for a plain box.
    """
    fitted = [each.fit.iou for each in pieces if each.fit.kind]
    return {
        "objects": len(pieces),
        "plain_boxes": sum(not each.fit.kind for each in pieces),
        "median_iou": round(float(np.median(fitted)), 4) if fitted else None,
        "stated": {
            each.stated.id: [one.placed.id, round(each.fit.iou, 4) if each.fit.kind else None]
            for each, one in zip(pieces, placed, strict=True)
        },
    }


def _room_of(stated: LayoutObject, plan: Plan, by_id: dict[str, PlanRoom]) -> PlanRoom | None:
    """The stated room of an object, or else the one that it lies in or close to."""
    if stated.room is not None:
        return by_id.get(stated.room)
    centre = Point(stated.center[:2])
    away = [(room.shape.distance(centre), number) for number, room in enumerate(plan.rooms)]
    distance, number = min(away)
    return plan.rooms[number] if distance < _BESIDE else None


def _place(stated: LayoutObject, plan: Plan, room: PlanRoom) -> Place:
    """The place where the box of an object stands, hangs or lies."""
    bottom, top = (stated.center[2] + half * stated.size[2] for half in (-0.5, 0.5))
    if bottom < _NEAR and stated.on is None:
        return "floor"
    return "ceiling" if (room.height or plan.height) - top < _NEAR else "raised"


def _fitted(
    rng: Draw,
    stated: LayoutObject,
    plan: Plan,
    room: PlanRoom,
    style: Style,
    sampler: AssetSampler | None,
    changes: Changes,
) -> Fit:
    """The piece for an object, or a plain box."""
    place = _place(stated, plan, room)
    fit = fit_piece(rng, style, stated.category, stated.size, place, stated.kind, sampler)
    if fit is not None:
        return fit
    if kinds_for(stated.category):
        changes.note("plain boxes, since no piece has such a size: {}", _named(stated))
    else:
        changes.note("plain boxes, since there is no piece of the category: {}", _named(stated))
    return Fit(plain_box(style, _safe(stated.category), stated.size), "", 1.0)


def _category(stated: LayoutObject, piece: FurniturePiece) -> str:
    if stated.category in CATEGORIES or kinds_for(stated.category):
        return stated.category
    return piece.category if kinds_for(piece.category) else "other"


def _pose(piece: FurniturePiece, stated: LayoutObject, place: Place, kind: str) -> Pose:
    """The pose that brings a piece to its box: backs at the back of what stands at walls."""
    low, high = piece.bounds
    middle = 0.5 * (low + high)
    anchor = anchor_of(kind) if kind else "free"
    at_back = anchor in ("wall", "on_wall")
    y = 0.5 * stated.size[1] - high[1] if at_back else -middle[1]
    bottom = stated.center[2] - 0.5 * stated.size[2]
    z = bottom - low[2]
    if place == "ceiling":
        z = bottom + stated.size[2] - high[2]
    elif anchor == "on_wall":
        z = stated.center[2] - middle[2]
    return Pose(stated.center[0], stated.center[1], float(z), stated.yaw % 360).beside(
        float(-middle[0]), float(y)
    )


def _placed_clear(pieces: Sequence[_Piece], plan: Plan, changes: Changes) -> list[Standing]:
    """The pieces clear of walls and of each other, as far as the tolerance allows."""
    free = []
    for each in pieces:
        one = each.standing
        in_window = not one.room.shape.covers(Point(each.stated.center[:2]))
        moved = None if in_window else out_of_walls(one)
        if moved is None and not in_window and not one.on:
            changes.note("reach into a wall: {}", _named(each.stated))
        free.append(moved or one)
    made, stuck = apart(free)
    for number, (each, one) in enumerate(zip(pieces, made, strict=True)):
        if number in stuck:
            changes.note("reach into another object: {}", _named(each.stated))
        elif np.hypot(one.pose.x - each.standing.pose.x, one.pose.y - each.standing.pose.y) > 0.03:
            changes.note(
                f"moved by up to {TOLERANCE:g} m, clear of walls and of each other: {{}}",
                _named(each.stated),
            )
    return made


def _note_blocked(
    pieces: Sequence[_Piece], standing: Sequence[Standing], plan: Plan, changes: Changes
) -> None:
    """Name what stands right before a door or opening."""
    ways = [
        opening.edge.strip(0.1, opening.width - 0.1, _WAY, -opening.thickness - _WAY)
        for opening in plan.openings
        if opening.z0 <= 0
    ]
    for each, one in zip(pieces, standing, strict=True):
        if one.on_floor and any(meets(one.footprint, way) for way in ways):
            changes.note("stand in the way of a door: {}", _named(each.stated))


def _as_placed(number: int, kind: str, one: Standing) -> PlacedInRoom:
    name = kind or re.sub(r"[^a-z0-9]+", "_", one.category.lower())[:30]
    solid = collision_boxes(one.piece, one.pose)
    placed = PlacedPiece(f"{one.room.id}-{name}-{number}", name, one.piece, one.pose, solid)
    return PlacedInRoom(one.room.id, placed)


def _added_lamps(
    rng: Draw, plan: Plan, style: Style, standing: Sequence[Standing], first: int
) -> list[PlacedInRoom]:
    """Ceiling lamps in the middle of the rooms that have no lamp, above all that stands there."""
    lamps = (one for one in standing if one.category == "lamp")  # no screens, no candles
    lit = {one.room.id for one in lamps if any(part.lumens > 0 for part in one.piece.parts)}
    made = []
    for number, room in enumerate(each for each in plan.rooms if each.id not in lit):
        kind = rng.pick(CEILING_LAMPS[room.type])
        height = room.height or plan.height
        drop = {"drop": max(0.3, min(0.5, height - _HEADROOM))} if kind == "pendant_lamp" else {}
        lamp = FURNITURE_KINDS[kind].make(rng, style, **drop)
        x, y = (round(float(value), 4) for value in deepest_point(Polygon(room.polygon)))
        one = Standing(lamp, Pose(x, y, height, 0.0), room, lamp.category, True)
        made.append(_as_placed(first + number, kind, one))
    return made


def _named(stated: LayoutObject) -> str:
    return f"{_safe(stated.category)} {printable(stated.name or stated.id)!r}"


def _safe(category: str) -> str:
    return printable(category)[:40] or "object"
