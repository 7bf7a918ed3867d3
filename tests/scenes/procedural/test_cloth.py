"""Cloth: the shapes in which it hangs and lies, and what it keeps away from."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pbrnet.scenes.procedural.furnishing.drapery import _lies_on
from pbrnet.scenes.procedural.furniture.parts import drapes
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import (
    Weave,
    block,
    cleared,
    pierces,
    plump,
    sampled,
    settle,
    solid,
    started,
    stuffed,
)
from pbrnet.scenes.procedural.furniture.parts.drapes import (
    dropped,
    hanging,
    hooked,
    hung,
    pleats,
    ripples,
)
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, box, grid
from pbrnet.scenes.procedural.furniture.style import make_style
from pbrnet.scenes.procedural.furniture.textiles import SHAPES, Curtains, panels
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import generator
from tests.scenes.procedural.test_furniture import is_closed, volume


def test_a_strip_held_at_both_ends_hangs_as_a_catenary() -> None:
    count, length, apart = 31, 1.0, 0.6
    x = np.linspace(-apart / 2, apart / 2, count)[:, None] + np.zeros((1, 3))
    y = np.zeros((count, 1)) + np.linspace(-0.03, 0.03, 3)[None, :]
    held = np.ones((count, 3))
    held[[0, -1]] = 0.0
    rest = (length / (count - 1), 0.03)
    place = started((x, y, -0.01 * np.cos(np.pi * x / apart)))
    place = settle(place, rest, [], 700, Weave(1.0, 0.0, 0.0), mass=held, iterations=12)
    a = brentq(lambda a: 2 * a * np.sinh(apart / 2 / a) - length, 0.05, 1.0)
    sag = a * (np.cosh(apart / 2 / a) - 1)
    assert place[2, count // 2, 1] == pytest.approx(-sag, rel=0.03)
    steps = np.linalg.norm(np.diff(place, axis=1), axis=0)
    assert steps == pytest.approx(rest[0], rel=0.04)


def test_a_cloth_over_a_table_keeps_off_it_and_hangs_down_at_its_sides() -> None:
    table = block((-0.4, -0.3, 0.0), (0.4, 0.3, 0.7), 0.01, 0.008)
    waves = ripples(generator(3))
    made = [dropped(waves, [table], (1.2, 1.0), (0, 0, 0.72), tight=0.0) for _ in range(2)]
    assert np.array_equal(made[0].vertices, made[1].vertices)
    x, y, z = made[0].vertices.T
    inside = (np.abs(x) < 0.397) & (np.abs(y) < 0.297) & (z < 0.697)
    assert not inside.any()
    assert z.max() < 0.76 and 0.27 < z.min() < 0.45
    assert is_closed(made[0].vertices, made[0].faces)


def test_towels_stay_before_the_wall_and_garments_have_their_outline() -> None:
    towel = hung(hanging(generator(1)), 0.4, 0.5, 0.3, 0.016, 0.06)
    assert towel.vertices[:, 1].max() < 0.065
    assert towel.vertices[:, 2].min() == pytest.approx(-0.5, abs=0.05)
    shirt = hooked(pleats(generator(2)), (1.1, 0.7), cut="shirt")
    whole = hooked(pleats(generator(2)), (1.1, 0.7))
    for mesh in (towel, shirt, whole):
        assert is_closed(mesh.vertices, mesh.faces)
    assert 0.4 < _area(shirt) / _area(whole) < 0.9


def test_a_stuffed_cushion_is_thick_in_its_middle_and_dented_by_a_head() -> None:
    mesh = stuffed((0.7, 0.45, 0.16), 1)
    assert is_closed(mesh.vertices, mesh.faces)
    assert 0.3 < volume(mesh.vertices, mesh.faces) / (0.7 * 0.45 * 0.16) < 0.9
    middle = (plump(1, 65).shape[2] // 2, plump(1, 65).shape[3] // 2)
    assert plump(1, 65, True)[(2, 0, *middle)] < plump(1, 65)[(2, 0, *middle)]


def test_what_pierces_a_cloth_is_noticed_and_moved_out() -> None:
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1, 21), indexing="ij")
    sheet = grid(np.stack([x, y, 0 * x + 0.05], axis=-1))

    def post(height: float, at: float = 0.0, wide: float = 0.031) -> np.ndarray:
        mesh = box((wide, wide, height), (at, 0, 0))
        return np.asarray(mesh.vertices[mesh.faces])

    assert pierces(post(0.1), sheet) and not pierces(post(0.045), sheet)
    assert not pierces(post(0.1, 0.3), sheet)
    sunk = sheet.moved(z=-0.004)
    place = np.moveaxis(sunk.vertices.reshape(21, 21, 3), -1, 0)
    lying = solid(place, (0.01, 0.01), 0.001)
    raised = cleared(lying, post(0.047, wide=0.4), 0.001)
    assert raised is not None
    assert raised.vertices[:, 2].min() > 0.047


def _area(mesh: BodyMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("sheer", [False, True])
def test_curtains_keep_their_length_and_fall_in_folds(sheer: bool, tied: bool) -> None:
    shapes = []
    for shape in range(SHAPES):
        made = panels(shape, shape % 3, sheer, tied)
        for place in made.places:
            n, m = place.shape[1:]
            down = np.linalg.norm(np.diff(place, axis=2), axis=0)
            across = np.linalg.norm(np.diff(place, axis=1), axis=0)
            assert down.sum(axis=1) == pytest.approx((m - 1) * made.rest[1], rel=0.03)
            assert across.sum(axis=0) == pytest.approx((n - 1) * made.rest[0], rel=0.05)
            assert (place[2, :, 0] == 0).all()  # the upper row is held
            gathered = np.ptp(place[0], axis=0) / ((n - 1) * made.rest[0])
            assert (gathered < (0.85 if sheer else 0.6)).all()
            if tied:
                waist = np.abs(place[2] + 1.3) < 0.06
                assert np.ptp(place[0][waist]) < 0.5 * np.ptp(place[0][:, 0]) + 0.05
            turns = np.diff(np.sign(np.diff(place[1, :, 0])))
            assert (turns != 0).sum() >= 5  # three folds
            shapes.append(place.tobytes())
        panels.cache_clear()
        again = panels(shape, shape % 3, sheer, tied)
        assert [place.tobytes() for place in again.places] == shapes[-2:]
    assert len(set(shapes)) == 2 * SHAPES


def _of(*meshes: BodyMesh) -> FurniturePiece:
    b = Builder("thing", "clothing", "free")
    b.add(Material("paint", (0.5, 0.5, 0.5)), *meshes)
    return b.piece()


@pytest.mark.parametrize(("behind", "lies"), [(0.0, True), (0.06, False)])
def test_a_garment_that_slid_down_behind_a_chair_is_noticed(behind: float, lies: bool) -> None:
    back = box((0.4, 0.03, 0.9))
    tent = box((0.4, 0.03, 0.5), (0, behind, 0.415))  # 1.5 cm higher than the back
    assert _lies_on(_of(tent), sampled(back.vertices[back.faces])) is lies


@pytest.mark.parametrize("torn", [False, True])
def test_torn_cloth_is_left_out(torn: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    carrier = _of(box((0.6, 0.6, 0.4)))

    def pulled(*words: object, **options: object) -> BodyMesh:
        mesh = dropped(*words, **options)  # type: ignore[arg-type]
        if torn:
            mesh.vertices[int(np.argmax(mesh.vertices[:, 0]))] += (0.3, 0, 0)
        return mesh

    monkeypatch.setattr(drapes, "dropped", pulled)
    made = drapes.over(
        generator(0, "cloth"), carrier, "throw", "textile", Material("textile", (0.5, 0.5, 0.5)),
        (0.4, 0.4), (0, 0, 0.45),
    )  # fmt: skip
    assert (made is None) is torn


def test_curtains_are_not_tied_back_at_the_sill() -> None:
    style = make_style(generator(0, "style"))

    def ties(seed: int, sill: float) -> int:
        made = Curtains.make(generator(seed, "curtains"), style, height=2.3, sill=sill)
        return sum(part.name.startswith("tie") for part in made.parts)

    tied = [seed for seed in range(12) if ties(seed, 0.0)]
    assert tied
    assert [seed for seed in range(12) if ties(seed, 0.6)] == tied
    assert not [seed for seed in tied if ties(seed, 0.96)]
