"""The quick estimate of enclosed air agrees with the exact sections that it saves."""

import numpy as np
import pytest
import shapely

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.section_raster import cut_off_regions
from pbrnet.scenes.reconstruction.aperture_sections import (
    LEAST_SEEDS,
    enclosed_air,
    merged_segments,
)
from pbrnet.scenes.reconstruction.rooms import MIN_OPENING

SEEDS = np.array([[0.5, 0.5], [0.4, 0.6], [0.6, 0.4]])


def frame_of_walls(gap: float) -> Float64Array:
    """Edges (N, 2, 2) of the unit square, one of which lacks `gap` metres."""
    ring = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0, gap]])
    return np.stack([ring[:-1], ring[1:]], axis=1)


@pytest.mark.parametrize(("gap", "count"), [(0.0, 1), (0.03, 1), (0.2, 0)])
def test_only_what_walls_surround_is_cut_off(gap: float, count: int) -> None:
    found = cut_off_regions(frame_of_walls(gap), SEEDS, 0.02, 1.0, LEAST_SEEDS)
    assert len(found) == count
    for points in found:
        assert shapely.box(0, 0, 1, 1).buffer(0.03).covers(shapely.multipoints(points))


def test_a_region_with_few_seeds_is_left_out() -> None:
    assert cut_off_regions(frame_of_walls(0.0), SEEDS[:2], 0.02, 1.0, LEAST_SEEDS) == []
    assert cut_off_regions(np.empty((0, 2, 2)), SEEDS, 0.02, 1.0, LEAST_SEEDS) == []


def upright(ends: Float64Array) -> Float64Array:
    """Upright slivers (N, 3, 3) that cut the plane z = 0 in segments `ends` (N, 2, 2)."""
    triangles = np.empty((len(ends), 3, 3))
    triangles[:, 0] = np.column_stack([ends[:, 0], np.full(len(ends), -1.0)])
    triangles[:, 1] = np.column_stack([2 * ends[:, 1] - ends[:, 0], np.full(len(ends), 1.0)])
    triangles[:, 2] = triangles[:, 0] + [0, 0, 2.0]
    return triangles


@pytest.mark.parametrize("seed", range(8))
def test_the_estimate_misses_no_large_region(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = upright(rng.uniform(0, 3, (40, 2, 2)))
    seeds = rng.uniform(0, 3, (60, 2))
    exact = [
        part
        for part in enclosed_air(triangles, 0.0, seeds)
        if shapely.contains_xy(part, *seeds.T).sum() >= LEAST_SEEDS
        and part.area >= MIN_OPENING
        and not part.buffer(-0.04).is_empty
    ]
    estimates: list[Float64Array] = []

    def remember(regions: list[Float64Array]) -> bool:
        estimates.extend(regions)
        return False

    assert enclosed_air(triangles, 0.0, seeds, remember) == []
    for part in exact:
        assert any(part.intersects(shapely.multipoints(points)) for points in estimates)


@pytest.mark.parametrize("seed", range(20))
def test_merged_segments_cover_what_the_segments_do(seed: int) -> None:
    """Within the grid of a centimetre, on which all of these lie."""
    rng = np.random.default_rng(seed)
    lines = 0.01 * rng.integers(-5, 6, (40, 2, 2)) * rng.integers(1, 4)
    merged = merged_segments(lines)
    given = lines[(lines[:, 0] != lines[:, 1]).any(axis=1)]
    before, after = (
        shapely.union_all(shapely.buffer(shapely.linestrings(each), 0.02, cap_style="square"))
        for each in (given, merged)
    )
    assert len(merged) <= len(given)
    assert before.symmetric_difference(after).area < 1e-12


def test_a_wall_of_many_triangles_is_one_segment() -> None:
    ends = np.linspace([0.3, 0.1], [3.3, 6.1], 301)
    pieces = np.stack([ends[:-1], ends[1:]], axis=1)
    pieces[::2] = pieces[::2, ::-1]
    expected = [[[0.3, 0.1], [3.3, 6.1]]]
    assert merged_segments(pieces[::-1]) == pytest.approx(np.array(expected))
    apart = np.delete(pieces, 100, axis=0)
    assert len(merged_segments(apart)) == 2
    assert merged_segments(np.empty((0, 2, 2))).shape == (0, 2, 2)
