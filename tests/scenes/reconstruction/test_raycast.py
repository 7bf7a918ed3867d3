"""Rays that only ask whether they escape agree with the closest hits."""

import numpy as np
import pytest

from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.reconstruction.raycast import RayCaster


@pytest.mark.parametrize("with_base", [False, True])
def test_rays_escape_where_they_hit_nothing(with_base: bool) -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-3, 3, (150, 1, 3)) + rng.normal(0, 0.7, (150, 3, 3))
    rays = RayCaster(corners[:100], RayCaster(corners[100:])) if with_base else RayCaster(corners)
    origins = rng.uniform(-3, 3, (4000, 3))
    directions = unit(rng.normal(size=(4000, 3)))
    # Half of them towards corners and edges, where two tests might differ.
    weights = rng.dirichlet([1, 1, 1], 2000) * rng.integers(0, 2, (2000, 3))
    weights[:, 0] += 1 - weights.sum(axis=1)
    targets = np.einsum("nk,nkj->nj", weights, corners[rng.integers(0, 150, 2000)])
    directions[:2000] = unit(targets - origins[:2000])
    distances, _ = rays.cast(origins, directions)
    escaped = rays.escapes(origins, directions)
    assert np.array_equal(escaped, np.isinf(distances))
    assert 0.05 < escaped.mean() < 0.95
    one = rays.escapes(origins[0], directions)  # they broadcast
    assert np.array_equal(one, np.isinf(rays.cast(origins[0], directions)[0]))
