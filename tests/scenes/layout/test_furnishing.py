"""Pieces for boxes: sizes, places and moves."""

from typing import Any

import numpy as np
import pytest

from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.plan import plan_of
from pbrnet.scenes.layout.furnishing.fitting import (
    _TABLES,
    Place,
    anchor_of,
    box_iou,
    fit_piece,
    plain_box,
    scaled,
)
from pbrnet.scenes.layout.furnishing.furnish import Furnished, furnish_layout
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, make_style
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.seeds import generator
from tests.fixtures.layouts import FLAT, changed, checked

STYLE = make_style(generator(1, "style"), "minimal")
BOXES = {
    "armchair": (0.8, 0.85, 0.8), "bath": (1.6, 0.7, 0.58), "bookshelf": (1.2, 0.3, 1.5),
    "cabinet": (0.7, 0.4, 0.9), "chair": (0.5, 0.55, 0.95), "desk": (1.2, 0.6, 0.75),
    "fridge": (0.7, 0.7, 1.8), "kitchen unit": (2.4, 0.6, 0.9), "mirror": (0.5, 0.03, 1.0),
    "night table": (0.4, 0.4, 0.6), "picture": (0.6, 0.05, 0.8), "rug": (3.0, 2.0, 0.02),
    "shelf": (0.8, 0.3, 1.8), "sofa": (1.9, 0.9, 0.8), "stool": (0.4, 0.4, 0.45),
    "stove": (0.6, 0.6, 0.9), "table": (1.8, 1.0, 0.72), "television": (1.2, 0.1, 0.7),
    "toilet": (0.4, 0.7, 0.8), "wardrobe": (2.0, 0.6, 2.3), "wash basin": (0.6, 0.5, 1.0),
}  # fmt: skip


def furnished(objects: list[dict], **keys: object) -> tuple[Furnished, Changes]:
    layout = checked(changed(objects=objects, **keys))
    changes = Changes()
    plan, _ = plan_of(layout, -0.3, changes)
    return furnish_layout(generator(0), layout, plan, STYLE, None, changes), changes


def test_tables_name_kinds_and_options_that_exist() -> None:
    named = {kind for kinds in _TABLES.kinds.values() for kind in kinds}
    named |= {*_TABLES.round, *_TABLES.thin, *_TABLES.rows}
    assert named <= FURNITURE_KINDS.keys() | THINGS.keys()
    for kind, options in _TABLES.options.items():
        assert options.keys() <= set(FURNITURE_KINDS[kind].__dataclass_fields__)


def test_pieces_fill_usual_boxes() -> None:
    found = {}
    for category, size in BOXES.items():
        fit = fit_piece(generator(0, category), STYLE, category, size)
        found[category] = 0.0 if fit is None else fit.iou
        if fit is not None:  # what is stated is what the mesh has
            assert box_iou(np.array(fit.piece.size), np.array(size)) == pytest.approx(fit.iou)
    assert np.median(list(found.values())) >= 0.95 and min(found.values()) > 0.75, found


def test_televisions_have_feet_unless_their_box_hangs_at_a_wall() -> None:
    thin = fit_piece(generator(0), STYLE, "television", (1.2, 0.07, 0.69), "raised")
    deep = fit_piece(generator(0), STYLE, "television", (1.15, 0.25, 0.75), "raised")
    assert thin is not None and deep is not None
    assert (thin.kind, deep.kind) == ("wall_television", "television")
    assert thin.piece.bounds[1, 1] == pytest.approx(0.0, abs=2e-3)  # the wall
    feet = [any(part.name == "feet" for part in one.piece.parts) for one in (thin, deep)]
    assert feet == [False, True]


def test_round_things_stay_round_and_scales_are_bounded() -> None:
    fit = fit_piece(generator(0), STYLE, "lamp", (0.5, 0.3, 1.6))
    assert fit is not None and fit.kind == "floor_lamp"
    x, y, _ = fit.piece.size
    assert x == pytest.approx(y, rel=0.1)
    assert fit_piece(generator(0), STYLE, "toilet", (3.0, 3.0, 3.0)) is None


@pytest.mark.parametrize(
    ("place", "height", "anchors"),
    [
        ("floor", 1.5, {"corner"}),
        ("raised", 0.4, {"on_top", "on_wall"}),
        ("ceiling", 0.4, {"ceiling"}),
    ],
)
def test_lamps_suit_their_place(place: Place, height: float, anchors: set[str]) -> None:
    fit = fit_piece(generator(0), STYLE, "lamp", (0.35, 0.35, height), place)
    assert fit is not None and anchor_of(fit.kind) in anchors


def test_a_scaled_piece_keeps_unit_normals_and_scales_its_surfaces() -> None:
    piece = FURNITURE_KINDS["coffee_table"].make(generator(2), STYLE)
    made = scaled(piece, np.array([1.1, 0.9, 1.2]))
    assert np.array(made.size) == pytest.approx(np.array(piece.size) * [1.1, 0.9, 1.2])
    assert made.surfaces[0].z == pytest.approx(1.2 * piece.surfaces[0].z)
    assert plain_box(STYLE, "harp", (0.6, 0.9, 1.6)).size == pytest.approx((0.6, 0.9, 1.6))


def test_a_piece_is_in_its_box_with_its_back_where_that_of_the_box_is() -> None:
    sofa = {"category": "sofa", "at": [2, 2], "size": [2.2, 0.92, 0.85], "yaw": 90}
    result, _ = furnished([sofa])
    placed = result.placed[0].placed
    corners = placed.pose.apply(np.concatenate([part.vertices for part in placed.piece.parts]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert low == pytest.approx([1.54, 0.9, 0.0], abs=0.04)
    assert high == pytest.approx([2.46, 3.1, 0.85], abs=0.04)
    assert low[0] == pytest.approx(1.54, abs=1e-6)  # yaw 90: the front faces +X


def test_boxes_move_out_of_walls_and_of_each_other_within_the_tolerance() -> None:
    wardrobe = {"category": "wardrobe", "id": "big", "at": [2, 3.7], "size": [1.2, 0.6, 2.0]}
    chest = {"category": "chest", "id": "small", "at": [3.0, 3.6], "size": [0.9, 0.46, 0.9]}
    result, changes = furnished([wardrobe, chest])
    first, second = result.standing[:2]
    assert first.footprint.bounds[3] <= 3.94 and second.footprint.bounds[3] <= 3.94
    assert first.footprint.intersection(second.footprint).area < 1e-4
    assert any(text.startswith("moved by up to 0.15 m") for text in changes.sentences())


def test_what_cannot_move_that_far_is_named() -> None:
    pair = [{"category": "sofa", "id": name, "at": [3, 2.6]} for name in ("one", "other")]
    _, changes = furnished([*pair, {"category": "bed", "id": "stuck", "at": [0.5, 1]}])
    text = " ".join(changes.sentences())
    assert "reach into another object: sofa 'other'" in text
    assert "reach into a wall: bed 'stuck'" in text


def test_only_rooms_without_a_lamp_get_one() -> None:
    lamp = {"category": "lamp", "at": [1, 1]}
    result, changes = furnished([lamp])
    added = [each for each in result.placed if each.placed.piece.anchor == "ceiling"]
    assert [each.room for each in added] == ["bath"]
    assert added[0].placed.bounds[1, 2] == pytest.approx(2.3)  # of its own, lower ceiling
    assert any("ceiling lamp was added" in text for text in changes.sentences())


def test_what_fits_no_piece_is_named_and_a_plain_box() -> None:
    result, changes = furnished(FLAT["objects"])
    assert result.record["plain_boxes"] == 1 and result.record["median_iou"] > 0.9
    assert any("harp" in text for text in changes.sentences())
    stated = [one["category"] for one in FLAT["objects"]]
    (plain,) = [
        number for number, (_, iou) in enumerate(result.record["stated"].values()) if not iou
    ]
    assert stated[plain] == "harp"
    placed = [each.placed.id for each in result.placed[: len(stated)]]
    assert [id_ for id_, _ in result.record["stated"].values()] == placed
    bowl = result.placed[1].placed
    assert bowl.pose.z == pytest.approx(0.74, abs=0.01)


class _Catalogue:
    """A sampler with one piece."""

    def __init__(self, piece: FurniturePiece) -> None:
        self.piece = piece

    def substitute(self, kind: str, options: dict[str, float]) -> FurniturePiece | None:
        return self.piece if kind == "sofa" else None

    def own_pieces(self, category: str, kinds: tuple[str, ...]) -> list[Any]:
        return []


def test_a_catalogue_piece_is_taken_where_it_fills_the_box() -> None:
    piece = plain_box(STYLE, "sofa", (2.0, 0.9, 0.8))
    for size, taken in (((2.1, 0.95, 0.8), True), ((3.4, 0.9, 0.8), False)):
        sampler: Any = _Catalogue(piece)
        fit = fit_piece(generator(0), STYLE, "sofa", size, sampler=sampler)
        assert fit is not None and (fit.piece.name == "sofa" and len(fit.piece.parts) == 1) == taken
