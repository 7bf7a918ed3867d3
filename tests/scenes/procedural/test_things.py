"""Things that people leave in rooms: their shapes, and how they are left."""

from collections import Counter
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from scipy.stats import binom

from pbrnet.pipeline.inspection.realism import is_thing
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.importing.semantics import CATEGORY_LABELS
from pbrnet.scenes.procedural.furnishing import placement
from pbrnet.scenes.procedural.furnishing.placement import furnish
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, make_style
from pbrnet.scenes.procedural.furniture.things import kinds
from pbrnet.scenes.procedural.furniture.things.kinds import BY_PLACE, THINGS
from pbrnet.scenes.procedural.furniture.things.soft import fallen
from pbrnet.scenes.procedural.planning import SIZES, make_plan
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.seeds import generator
from tests.scenes.procedural.test_furniture import areas, bodies, corners, is_closed, volume

STYLE = make_style(generator(3, "style"))


def test_there_are_150_kinds_of_things_with_known_categories() -> None:
    assert len(THINGS) + len(FURNITURE_KINDS) >= 200
    assert not set(THINGS) & set(FURNITURE_KINDS)
    for place in ("worktop", "dining", "coffee", "desk", "bedside", "shelf"):
        assert len(BY_PLACE[place]) >= 15, place  # so that none is in most of its rooms


@pytest.mark.parametrize(
    ("make", "options"),
    [("vessels.amphora", {}), ("vessels.bottle", {}), ("vessels.teapot", {"colour": 1})],
)
def test_a_row_of_the_table_that_no_generator_takes_is_refused(
    make: str, options: dict[str, int]
) -> None:
    with pytest.raises(ParameterError, match=r"tall one.*vessels"):
        kinds._kind("tall one", "shelf", make, **options)


def test_things_are_solid_and_touch_what_carries_them() -> None:
    for name, thing in THINGS.items():
        made = thing.make(generator(1, name), STYLE)
        assert made.category in CATEGORY_LABELS, name
        low, high = made.bounds
        rest = {"on_wall": high[1], "ceiling": high[2]}.get(made.anchor, low[2])
        assert abs(rest) < 1e-3, name
        assert 0.01 < (high - low).max() < 1.1, name
        assert sum(len(part.faces) for part in made.parts) < 9000, name
        for part in made.parts:
            where = (name, part.name)
            if part.picture is not None:  # a display, one-sided
                continue
            assert is_closed(part.vertices, part.faces), where
            for body in bodies(part.vertices, part.faces):
                assert volume(part.vertices, body) > 0, where
            if part.material.kind != "picture":
                ratio = areas(part.uvs[part.faces]).sum() / areas(corners(part)).sum()
                assert 0.5 < ratio < 1.7, where


def test_fallen_cloth_lies_on_the_floor_in_folds_and_keeps_its_size() -> None:
    flat = fallen(2, 60, 54, 42)
    assert np.array_equal(flat, fallen(2, 60, 54, 42))
    assert flat[..., 2].min() >= 0.0039
    assert np.ptp(flat[..., 2]) > 0.01  # folds
    along = np.linalg.norm(np.diff(flat, axis=0), axis=-1).sum(axis=0)
    across = np.linalg.norm(np.diff(flat, axis=1), axis=-1).sum(axis=1)
    assert 0.5 < along.mean() / 0.6 < 1.15 and 0.5 < across.mean() / 0.54 < 1.15
    assert np.ptp(flat[..., 0]) < 0.58  # gathered, not spread


@pytest.mark.check
def test_littered_homes_have_more_things_and_none_is_in_most_rooms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Kinds are not repeated in a room, but for sockets and switches."""
    monkeypatch.setattr(placement, "drape_cloth", lambda furnisher: None)  # slow, and no thing
    fittings = {*BY_PLACE["wall"], *BY_PLACE["door"], "vent"}
    rooms_of: Counter[str] = Counter()
    rooms = 0
    counts = []
    for seed in range(8):
        plan = make_plan(generator(seed, "plan"), 2, 4)
        style = make_style(generator(seed, "style"))
        items = furnish(generator(seed, "furniture"), plan, style)
        left: Counter[tuple[str | None, str]] = Counter()
        for item in items:
            kind = item.id.split("-")[2]
            if kind in THINGS and kind not in fittings:
                left[item.room, kind] += 1
        assert max(left.values(), default=0) <= 1
        counts.append((style.disorder, sum(left.values()) / len(plan.rooms)))
        rooms += len(plan.rooms)
        rooms_of.update(kind for _, kind in left)
    assert np.corrcoef(np.array(counts).T)[0, 1] > 0.3
    most = max(count for kind, count in rooms_of.items() if kind != "smoke_detector")
    assert most <= binom.isf(1e-3, rooms, 1 / 5)


@pytest.mark.check
@pytest.mark.timeout(3000)
def test_no_thing_is_in_more_than_a_fifth_of_the_rooms_of_a_type(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 120 rooms of each type, but for chance; by name as `pbrnet inspect --realism` counts."""
    monkeypatch.setattr(placement, "drape_cloth", lambda furnisher: None)  # slow, and no thing
    wanted, found = 120, Counter[str]()
    having: Counter[tuple[str, str]] = Counter()
    for seed in count():
        plan = make_plan(generator(seed, "plan"), 1, 6)
        kept = [room for room in plan.rooms if found[room.type] < wanted]
        if not kept and len(found) == len(SIZES):
            break
        style = make_style(generator(seed, "style"))
        items = furnish(generator(seed, "furniture"), replace(plan, rooms=tuple(kept)), style)
        found.update(room.type for room in kept)
        types = {room.id: str(room.type) for room in kept}
        names = {(item.room, item.name) for item in items if is_thing(_object(item))}
        having.update((types[str(room)], name) for room, name in names if name not in _OF_DESKS)
    most = binom.isf(1e-3, wanted, 1 / 5)
    assert {key: rooms for key, rooms in having.items() if rooms > most} == {}


_OF_DESKS = ("computer monitor",)


def _object(item: SceneItem) -> SceneObject:
    low, high = (tuple(corner) for corner in item.bounds.tolist())
    return SceneObject(item.id, item.name, item.category, (), low, high, False, item.room)
