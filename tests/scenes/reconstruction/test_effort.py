"""The effort of a search is bounded: rays for the sky, and tries to seal what cannot be sealed."""

import numpy as np
import pytest
from scipy import ndimage
from shapely.geometry import box

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.reconstruction import gap_sealing, rooms
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from tests.fixtures.buildings import slab, walls

CELL = 0.05
OUTWARD = np.array([0.0, -1.0, 0.0])


class Counted(RayCaster):
    """A ray caster that counts its rays."""

    rays = 0

    def escapes(self, origins: Float64Array, directions: Float64Array) -> BoolArray:
        """As before."""
        self.rays += len(np.broadcast_to(directions, np.broadcast_shapes(
            np.shape(origins), np.shape(directions))))  # fmt: skip
        return super().escapes(origins, directions)


def screened(closed: BoolArray) -> tuple[Counted, Float64Array]:
    """A grid of cells in a wall, each closed or open, with screens just before it."""
    us, vs = (CELL * (np.arange(n) + 0.5) for n in closed.shape[::-1])
    grid = np.stack(np.broadcast_arrays(us[None, :], 0.0, vs[:, None]), axis=-1)
    half = 0.5 * CELL + 1e-4
    corners = [[-half, -half], [half, -half], [half, half], [-half, half]]
    quads = np.array([
        [[x + u, -0.03, z + v] for u, v in corners] for x, _, z in grid[closed].tolist()
    ])  # fmt: skip
    return Counted(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])), grid


@pytest.mark.parametrize("seed", range(3))
def test_two_steps_see_the_sky_through_every_opening_two_cells_wide(seed: int) -> None:
    starts = np.random.default_rng(seed).random((24, 30)) < 0.02
    block = np.ones((2, 2), dtype=bool)
    rays, grid = screened(~ndimage.binary_dilation(starts, block))
    cells = np.ones(grid.shape[:2], dtype=bool)
    every = rooms._see_sky(rays, grid, cells, OUTWARD)
    found = rooms._reaches_sky(rays, grid, cells, OUTWARD)
    assert every.any() and not (found & ~every).any()
    assert not (ndimage.binary_opening(every, block) & ~found).any()


def test_a_wall_without_sky_takes_a_quarter_of_the_rays() -> None:
    rays, grid = screened(np.ones((80, 100), dtype=bool))
    inner = np.zeros(grid.shape[:2], dtype=bool)
    inner[20:-20, 20:-20] = True
    assert not rooms._see_sky(rays, grid, inner, OUTWARD).any()
    every, rays.rays = rays.rays, 0
    assert not rooms._reaches_sky(rays, grid, inner, OUTWARD).any()
    assert rays.rays < 0.4 * every


def test_sealing_ends_after_walks_that_nothing_can_seal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A room without a wall and a ceiling lets out walks without number, and no slab fits."""
    parts = [slab("Floor", 4, 3, -0.1, 0), *walls(4, 3, 2.5, without="s")]
    quads = np.concatenate([part.quads for part in parts])
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    tried: list[int] = []

    def counted(*given: object) -> None:
        tried.append(1)

    monkeypatch.setattr(gap_sealing, "_slab_across", counted)
    monkeypatch.setattr(gap_sealing, "_WALKS", 1024)
    monkeypatch.setattr(gap_sealing, "_MAX_SLABS", 1000)
    room = FoundRoom(box(0, 0, 4, 3), 0.0, 2.5)
    assert gap_sealing.seal_gaps(corners, RayCaster(corners), [room], [])[1] == 0
    most_segments = 9  # of a walk
    least = gap_sealing._MOST_FRUITLESS
    assert least <= len(tried) <= most_segments * least
