"""Framing of views by hand-made id images."""

import math

import numpy as np
import pytest

from pbrnet.pipeline.cameras.framing import framing_of, is_framed
from pbrnet.scenes.contract import Scene, SceneObject

NAMES = (("walls", "wall", True), ("floor", "floor", True), ("lamp", "lamp", False),
         ("sofa", "sofa", False))  # fmt: skip
BOX = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
SCENE = Scene(
    "s", {}, (), tuple(SceneObject(n, n, c, (), *BOX, s) for n, c, s in NAMES), (), (), ()
)
WALL, FLOOR, LAMP, SOFA = range(1, 5)


def image(fill: int = FLOOR) -> np.ndarray:
    return np.full((60, 80), fill, dtype=np.uint32)


def test_a_blank_wall_is_the_largest_region_of_blocks_that_it_fills() -> None:
    ids = image()
    ids[:30, :40] = WALL  # 4 x 3 of 8 x 6 blocks
    ids[40:, 70:] = WALL  # another region, smaller
    found = framing_of(ids, SCENE, ())
    assert found.blank == pytest.approx(0.25)
    assert is_framed(found, 3.0)
    ids[:30, 40:50] = WALL
    assert not is_framed(framing_of(ids, SCENE, ()), 3.0)
    ids[5:25:10, 5:55:10] = SOFA  # something hangs on it, in each block
    ids[5:25:10, 6:56:10] = SOFA
    ids[5:25:10, 7:57:10] = SOFA
    ids[5:25:10, 8:58:10] = SOFA
    assert framing_of(ids, SCENE, ()).blank < 0.25
    assert framing_of(image(), SCENE, ()).blank == 0, "a floor is no blank wall"


def test_lamps_and_near_things_are_no_subject() -> None:
    ids = image()
    ids[:, :9] = LAMP
    assert is_framed(framing_of(ids, SCENE, ()), 3.0)
    assert not is_framed(framing_of(ids, SCENE, ()), 1.0)
    ids[:, :10] = LAMP  # an eighth
    assert framing_of(ids, SCENE, ()).lamp == pytest.approx(0.125)
    assert not is_framed(framing_of(ids, SCENE, ()), 3.0)
    ids = image()
    ids[:31] = SOFA
    assert not is_framed(framing_of(ids, SCENE, ()), 3.0)


def test_a_subject_on_a_third_is_better_than_one_in_the_middle() -> None:
    ids = np.full((90, 120), FLOOR, dtype=np.uint32)
    ids[25:35, 35:45] = SOFA  # its middle at a third of both sides
    assert framing_of(ids, SCENE, ("sofa",)).thirds == pytest.approx(1)
    assert framing_of(ids, SCENE, ()).thirds == 0
    middle = np.roll(ids, (15, 20), axis=(0, 1))
    expected = math.exp(-((1 / 6) ** 2 + (1 / 6 * 0.75) ** 2) / 0.12**2)
    assert framing_of(middle, SCENE, ("sofa",)).thirds == pytest.approx(expected)
