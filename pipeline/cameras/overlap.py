"""Overlap of views, measured by reprojection, and choice of views that overlap.

The overlap of one view with another is the share of its surface points that the other sees: inside
its image, and not hidden from its eye. That of a pair is the mean of both directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.directions import pixel_directions, turned, unit

_WIDTH = 48  # pixels of the views that are compared
_TOLERANCE = 2e-4  # of the distance


@dataclass(frozen=True)
class Outlook:
    """Surface points (P, 3) that a camera sees, metres; its pose (4, 4) and K of a small image."""

    pose: Float64Array
    intrinsics: Float64Array
    points: Float64Array


def outlook(render_scene: RenderScene, pose: Float64Array, intrinsics: Float64Array) -> Outlook:
    """Trace the surfaces that a camera sees; `intrinsics` (3, 3) is K of any size of image."""
    scale = _WIDTH / (2 * intrinsics[0, 2])
    small = np.array(
        [
            [intrinsics[0, 0] * scale, 0, _WIDTH / 2],
            [0, intrinsics[1, 1] * scale, intrinsics[1, 2] * scale],
            [0, 0, 1],
        ]
    )
    local = pixel_directions(small, _WIDTH, round(2 * small[1, 2])).reshape(-1, 3)
    rays = unit(turned(local, pose[:3, :3]))
    distance, _ = cast(render_scene, pose[:3, 3], rays, through_glass=True)
    hit = np.isfinite(distance)
    return Outlook(pose, small, pose[:3, 3] + rays[hit] * distance[hit, None].astype(np.float64))


def overlap(render_scene: RenderScene, one: Outlook, other: Outlook) -> float:
    """Return the overlap of a pair of views, in [0, 1]."""
    return 0.5 * (_share(render_scene, one, other) + _share(render_scene, other, one))


def choose_overlapping(
    render_scene: RenderScene,
    anchor: Outlook,
    candidates: Sequence[Outlook],
    count: int,
    least: float,
) -> tuple[list[int], float]:
    """Return the indices of `count` candidates that overlap with the anchor and each other.

    Also the median overlap of all pairs. Of the candidates that overlap with every chosen view by
    `least`, the one farthest from them comes next; if there is none, the one that overlaps most.
    """
    chosen: list[int] = []
    latest, eyes = anchor, [anchor.pose[:3, 3]]
    worst = np.ones(len(candidates))
    pairs: list[float] = []
    shared: list[list[float]] = [[] for _ in candidates]
    while len(chosen) < count:
        for index, candidate in enumerate(candidates):
            if index not in chosen:
                shared[index].append(overlap(render_scene, candidate, latest))
                worst[index] = min(worst[index], shared[index][-1])
        left = [index for index in range(len(candidates)) if index not in chosen]
        if not left:
            break
        enough = [index for index in left if worst[index] >= least]
        away = {
            index: min(float(((candidates[index].pose[:3, 3] - eye) ** 2).sum()) for eye in eyes)
            for index in enough
        }
        best = max(away, key=away.__getitem__) if away else max(left, key=worst.__getitem__)
        pairs += shared[best]
        chosen.append(best)
        latest = candidates[best]
        eyes.append(latest.pose[:3, 3])
    return chosen, float(np.median(pairs)) if pairs else 0.0


def _share(render_scene: RenderScene, one: Outlook, other: Outlook) -> float:
    """Return the share of the points of `one` that `other` sees."""
    if not len(one.points):
        return 0.0
    eye = other.pose[:3, 3]
    local = turned(one.points - eye, other.pose[:3, :3].T)
    before = local[:, 2] > 1e-5
    z = np.where(before, local[:, 2], 1)[:, None]
    places = local[:, :2] / z * np.diag(other.intrinsics)[:2] + other.intrinsics[:2, 2]
    inside = before & (places >= 0).all(axis=1)
    inside &= (places < 2 * other.intrinsics[:2, 2]).all(axis=1)
    if not inside.any():
        return 0.0
    offsets = one.points[inside] - eye
    metres = np.sqrt((offsets**2).sum(axis=1))
    free, _ = cast(render_scene, eye, offsets, through_glass=True)
    seen = free >= metres - _TOLERANCE * np.maximum(metres, 1)
    return float(seen.sum()) / len(one.points)
