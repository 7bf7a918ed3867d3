"""Opaque blocks and panels called windows or glass, in holes of walls, let light in."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.registry import import_scene
from tests.fixtures.rooms import Block, shell, write_obj

pytestmark = pytest.mark.usefixtures("few_walks")


def filled(name: str, start: float = 1.2, end: float = 2.8, depth: float = 0.1) -> Block:
    """A block in the hole of the wall towards -X, from one y to another."""
    return Block(name, (-0.1 - 0.5 * depth, start, 0.9), (-0.1 + 0.5 * depth, end, 2.1))


def imported(folder: Path, *blocks: Block) -> Scene:
    path = write_obj(folder / "in" / "room.obj", [*shell(), *blocks])
    return import_scene(path, folder / "out", up="z", scale=1.0)


@pytest.mark.parametrize(
    "blocks",
    [
        [filled("window")],
        [filled("Glass.001", depth=0.02)],
        [filled("window_left", end=2.0), filled("window_right", start=2.0)],
        [filled("window", depth=0.2), filled("window_frame", start=2.75)],
    ],
)
def test_an_opaque_window_in_a_hole_becomes_a_portal(tmp_path: Path, blocks: list[Block]) -> None:
    scene = imported(tmp_path, *blocks)
    (portal,) = scene.portals
    assert portal.kind == "window" and portal.clear
    assert np.ptp(portal.polygon, axis=0) == pytest.approx([0, 1.6, 1.2], abs=0.15)
    names = {item.name for item in scene.objects}
    assert not names & {"window", "Glass.001", "window_left", "window_right"}
    assert any("opaque windows in holes" in change for change in scene.changes)


@pytest.mark.parametrize("block", [
    filled("shutter"),
    filled("window_blind"),
    Block("window_seat", (0.1, 1.2, 0.0), (0.2, 2.8, 0.5)),
    Block("glass_case", (2.0, 1.0, 0.0), (2.2, 2.0, 1.8)),
])  # fmt: skip
def test_what_is_no_window_or_in_no_hole_stays(tmp_path: Path, block: Block) -> None:
    scene = imported(tmp_path, block)
    assert block.name in {item.name for item in scene.objects}
    assert not any("opaque windows" in change for change in scene.changes)
