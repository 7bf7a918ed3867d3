"""Cumulus clouds: heaps of matt white lumps with flat bases, far away and never before the sun."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, merge
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part, outdoor_item
from pbrnet.scenes.seeds import Draw

NEAREST, FARTHEST = 1500.0, 2050.0  # metres along the ground to the middle of a cloud
LARGEST = 340.0  # metres from the middle of a cloud to its end
SUN_MARGIN = 40.0  # degrees between the sun and a cloud, as seen from the home: none is backlit
# Light passes through, as if by many collisions: clouds before the sun are not black.
WHITE = Material("paint", (0.95, 0.95, 0.95), 1.0, translucent=True)
_BASES = (300.0, 460.0)  # metres above the ground, one height for all clouds of a day
_SQUASHED = 0.1  # of the depth below its base that a lump keeps
_ROUGH = 0.1  # of the radius of a lump
_TRIES = 12


def clouds(rng: Draw, centre: Float64Array, sun: Float64Array, ground: float) -> SceneItem | None:
    """Return the clouds around `centre` (2,) under a sun in the direction `sun` (3,), unit.

    None if there is no room for any.
    """
    base = ground + rng.between(*_BASES)
    count = rng.whole(5, 11)
    start = rng.between(0, 360)
    heaps = []
    for number in range(count):
        for _ in range(_TRIES):
            angle = np.radians(start + 360 * (number + rng.between(-0.4, 0.4)) / count)
            away = rng.between(NEAREST, FARTHEST)
            half = rng.between(0.35, 1.0) * LARGEST
            middle = np.array([away * np.cos(angle), away * np.sin(angle), base - ground])
            if _is_clear(middle, 1.25 * half, sun):
                low = base + 0.5 * number  # metres; bases share no plane
                at = np.round([*(centre + middle[:2]), low], 2)
                heaps.append(_heap(rng, half).moved(*at.tolist()))
                break
    if not heaps:
        return None
    return outdoor_item("clouds", "cloud", make_part("clouds", WHITE, *heaps, smooth=True))


def _is_clear(middle: Float64Array, radius: float, sun: Float64Array) -> bool:
    """Test whether a ball about `middle`, as seen from the origin, keeps off the sun."""
    long = float(np.sqrt((middle * middle).sum()))
    cosine = float((middle * sun).sum()) / long
    apart = np.degrees(np.arccos(min(max(cosine, -1.0), 1.0)))
    return bool(apart > np.degrees(np.arcsin(min(radius / long, 1.0))) + SUN_MARGIN)


def _heap(rng: Draw, half: float) -> BodyMesh:
    """Return a cloud of half length `half` about the origin, its base at z = 0."""
    turn = rng.between(0, np.pi)
    tall = rng.between(0.3, 0.5) * half
    places, radii, levels = [], [], []
    for k in range(7):  # the body: an uneven row of large lumps
        along = (k - 3) / 3 * 0.75 * half + rng.normal(0, 0.05) * half
        size = tall * rng.between(0.55, 0.9) * (1 - 0.5 * (along / half) ** 2)
        across = rng.normal(0, 0.16) * half
        x = along * np.cos(turn) - across * np.sin(turn)
        y = along * np.sin(turn) + across * np.cos(turn)
        places.append([x, y, size * rng.between(0.2, 0.75)])
        radii.append(size)
        levels.append(2)
    # Smaller lumps on larger ones, chiefly above.
    shells = ((1, 0, 7, 26, 0.5), (1, 7, 33, 90, 0.26), (0, 33, 123, 150, 0.13))
    for level, first, last, amount, share in shells:
        for _ in range(amount):
            parent = rng.whole(first, last)
            way = rng.normal(0, 1, 3)
            way[2] = abs(way[2]) * 1.1 - 0.25
            way /= np.sqrt((way * way).sum())
            places.append(list(places[parent] + 0.88 * radii[parent] * way))
            radii.append(share * tall * rng.between(0.5, 0.9))
            levels.append(level)
    spots, sizes = np.round(np.array(places), 3), np.round(np.array(radii), 3)
    lumps = []
    for spot, size, level in zip(spots, sizes, levels, strict=True):
        ball, faces = _ball(level)
        shift, waves = rng.uniform(0, 6.3, 4), rng.normal(0, 3.2, (4, 3))
        bumps = sum(
            np.sin(ball[:, 0] * a + ball[:, 1] * b + ball[:, 2] * c + d)
            for (a, b, c), d in zip(waves, shift, strict=True)
        )
        points = np.round(spot + size * ball * (1 + _ROUGH / 2 * np.asarray(bumps))[:, None], 3)
        offset = spots - spot
        apart = offset[:, 0] ** 2 + offset[:, 1] ** 2 + offset[:, 2] ** 2
        near = (apart < (1.2 * size + sizes) ** 2) & (sizes > 0.5 * size)
        faces = faces[~_hidden(points, spots[near], sizes[near])[faces].all(axis=1)]
        if len(faces) == 0:
            continue
        points[:, 2] = np.where(points[:, 2] < 0, _SQUASHED * points[:, 2], points[:, 2])
        used, numbers = np.unique(faces, return_inverse=True)
        points, faces = points[used], numbers.reshape(-1, 3)
        lumps.append(BodyMesh(points, faces, points[:, :2].copy(), smooth=True))
    return merge(lumps)


def _hidden(points: Float64Array, spots: Float64Array, sizes: Float64Array) -> np.ndarray:
    """Test which points (N, 3) lie deep in one of the lumps."""
    offset = points[:, None] - spots[None]
    squared = offset[..., 0] ** 2 + offset[..., 1] ** 2 + offset[..., 2] ** 2
    return np.asarray((squared < (0.75 * sizes) ** 2).any(axis=1))


@lru_cache(maxsize=4)
def _ball(level: int) -> tuple[Float64Array, Int64Array]:
    """Unit vertices (V, 3), faces (F, 3) of an icosahedron, its faces split in 4 `level` times."""
    golden = (1 + float(np.sqrt(5.0))) / 2
    corners = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    points = [np.roll(np.array(c, dtype=float), k) for k in (0, 1, 2) for c in corners]
    faces = np.array(
        [
            *([0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11]),
            *([1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8]),
            *([3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9]),
            *([4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]),
        ]
    )
    vertices = np.array(points)
    for _ in range(level):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        split = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        vertices, numbers = np.unique(
            np.round(split.reshape(-1, 3), 9), axis=0, return_inverse=True
        )
        faces = numbers.reshape(-1, 3)
    long = np.sqrt(vertices[:, 0] ** 2 + vertices[:, 1] ** 2 + vertices[:, 2] ** 2)
    return vertices / long[:, None], faces
