"""Gaps between the surfaces of imported buildings are sealed without a visible change."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.reconstruction.enclosure import ENCLOSURE_ID
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID
from tests.fixtures.leak import (
    ROOM,
    Corner,
    Quad,
    box_quads,
    built,
    points_of,
    seen_share,
    slit,
    west,
)

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.slow
@pytest.mark.parametrize("part", [ENCLOSURE_ID, GAP_SEALING_ID])
def test_gaps_are_sealed_from_outside(tmp_path: Path, part: str) -> None:
    """By an enclosure; where a second building stands apart, by slabs behind the wall's face."""
    quads = box_quads((0, 0, 0), ROOM, "w") + slit(ROOM)
    if part == GAP_SEALING_ID:
        quads += box_quads((8, 0, 1), (12, 4, 3.6))
    scene = built(tmp_path, quads)
    assert scene.scene.portals == (), "a gap is no window"
    assert any("leaked in through gaps" in change for change in scene.scene.changes)
    assert find_leaks(scene, walks=20_000) == []
    # Nothing of it stands in the room, and indoors only the slits show it.
    points = points_of(scene, part)
    assert not ((points > 1e-3) & (points < np.array(ROOM) - 1e-3)).all(axis=1).any()
    assert seen_share(scene, part, (2.5, 2.0, 1.35)) < 0.004


def test_an_enclosure_leaves_windows_and_fireplaces_as_they_are(tmp_path: Path) -> None:
    """A window 0.1 m behind the west wall, beside it a closed fireplace 0.5 m deep, and a slit."""
    window, fire = ((0.5, 1.5), (0.9, 1.9)), ((2.4, 3.2), (0.0, 0.7))
    strips = [
        ((0.0, 0.5), (0.0, 2.694)), ((0.5, 1.5), (0.0, 0.9)), ((0.5, 1.5), (1.9, 2.694)),
        ((1.5, 2.4), (0.0, 2.694)), ((2.4, 3.2), (0.7, 2.694)), ((3.2, 4.0), (0.0, 2.694)),
    ]  # fmt: skip
    wall: list[Quad] = [
        ((0.0, a, c), (0.0, b, c), (0.0, b, d), (0.0, a, d)) for (a, b), (c, d) in strips
    ]
    quads = box_quads((0, 0, 0), ROOM, "w") + wall
    for (south, north), (low, high), deep, without in ((*window, -0.1, "we"), (*fire, -0.5, "e")):
        quads += box_quads((deep, south, low), (0, north, high), without)
    scene = built(tmp_path, quads)
    (portal,) = scene.scene.portals
    assert portal.kind == "window" and find_leaks(scene, walks=20_000) == []
    points = points_of(scene, ENCLOSURE_ID)
    assert points[:, 0].min() == pytest.approx(-0.53, abs=0.011), "a box around the fireplace"
    assert seen_share(scene, ENCLOSURE_ID, (0.6, 2.8, 0.5)) < 0.006, "the slit shows it"
    # Light that comes in askew, up to 65 degrees, is not stopped.
    angle = np.radians(np.repeat([-65.0, 0.0, 65.0], 3))
    origins = np.column_stack([np.full(9, 0.2), np.full(9, 1.0), np.tile([1.0, 1.4, 1.8], 3)])
    aim = np.column_stack([-np.cos(angle), np.sin(angle), np.zeros(9)])
    origins[:, 1] -= 0.25 * np.tan(angle)
    hits = raycast.surfaces(scene.geometry, origins, aim, colors=False)
    assert (hits.shape < 0).all()


@pytest.mark.slow
def test_an_enclosure_closes_an_opening_up_the_fireplace(tmp_path: Path) -> None:
    quads = box_quads((0, 0, 0), ROOM, "ws") + west(0.0, (1.6, 2.4), (0.0, 0.7), ROOM)
    quads += box_quads((-0.4, 1.6, 0), (0, 2.4, 1.1), "et")
    quads.append(((0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (5.0, 0.0, 2.694), (0.0, 0.0, 2.694)))
    scene = built(tmp_path, quads)
    assert scene.scene.portals == ()
    assert any("up a fireplace, were closed: 1" in each for each in scene.scene.changes)
    assert find_leaks(scene, walks=20_000) == []
    assert seen_share(scene, ENCLOSURE_ID, (2.5, 2.0, 1.35)) < 0.004


def test_a_stage_without_a_wall_gets_no_enclosure(tmp_path: Path) -> None:
    """Light is meant to come in there."""
    scene = built(tmp_path, box_quads((0, 0, 0), ROOM, "w"))
    assert ENCLOSURE_ID not in {item.name for item in scene.scene.objects}
    ways = unit(np.random.default_rng(0).normal(size=(1000, 3)))
    ways = ways[(ways[:, 0] < -0.9) & (ways[:, 2] > 0)]  # not to the ground
    hits = raycast.surfaces(scene.geometry, np.full_like(ways, 1.3), ways, colors=False)
    assert (hits.shape < 0).all()


def leaky_room(seed: int) -> tuple[list[Quad], int]:
    """A room of one to two wings with slits below its ceiling, windows and closed recesses in its
    walls at several depths, drawn at random; and how many windows it has."""
    rng = np.random.default_rng(seed)
    width, depth, height = rng.uniform(3, 7), rng.uniform(3, 6), rng.uniform(2.3, 3.2)
    x, y = rng.uniform(1.2, width - 1.2), rng.uniform(1.2, depth - 1.2)
    plan = np.array([(0, 0), (width, 0), (width, y), (x, y), (x, depth), (0, depth)])
    pieces = [((0, 0), (width, y)), ((0, y), (x, depth))]
    if seed % 2:
        plan = np.array([(0, 0), (width, 0), (width, depth), (0, depth)])
        pieces = [((0, 0), (width, depth))]
    quads: list[Quad] = []
    for (west_, south), (east, north) in pieces:
        quads += box_quads((west_, south, 0), (east, north, height), "wesn")
    windows = 0
    for start, end in zip(plan, np.roll(plan, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        outwards = np.array([along[1], -along[0]])

        def at(u: float, z: float, deep: float = 0.0) -> Corner:
            px, py = start + u * along + deep * outwards  # noqa: B023
            return (float(px), float(py), z)

        def upright(u: float, to: float, low: float, high: float, deep: float = 0.0) -> Quad:
            return (at(u, low, deep), at(to, low, deep), at(to, high, deep), at(u, high, deep))

        top = height - rng.choice([0.0, 0.004, 0.01])
        done, u = 0.0, rng.uniform(0.5, 0.8)
        while u + 1.2 < length - 0.5 and rng.random() < 0.7:
            to, low, deep = (
                u + rng.uniform(0.7, 1.2),
                rng.choice([0.0, 0.9]),
                rng.choice([0.05, 0.15, 0.4]),
            )
            high = low + rng.uniform(0.9, 1.2)
            quads += [upright(done, u, 0, top), upright(u, to, 0, low), upright(u, to, high, top)]
            for side in (u, to):
                quads.append(
                    (at(side, low), at(side, low, deep), at(side, high, deep), at(side, high))
                )
            for level in (low, high):
                quads.append((at(u, level), at(to, level), at(to, level, deep), at(u, level, deep)))
            if rng.random() < 0.3:
                quads.append(upright(u, to, low, high, deep))
            else:
                windows += 1
            done, u = to, to + rng.uniform(0.3, 1.0)
        quads.append(upright(done, length, 0, top))
    return [quad for quad in quads if quad[0] != quad[3]], windows


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [seed if seed < 5 else pytest.param(seed, marks=pytest.mark.check) for seed in range(8)]
)
def test_rooms_with_gaps_are_dark_but_for_their_windows(tmp_path: Path, seed: int) -> None:
    quads, windows = leaky_room(seed)
    scene = built(tmp_path, quads)
    assert len(scene.scene.portals) == windows
    assert find_leaks(scene, walks=20_000) == []
