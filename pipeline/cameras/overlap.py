"""Overlap of views, measured by reprojection, and choice of views that overlap.

The overlap of one view with another is the share of its surface points that the other sees: inside
its image, and not hidden from its eye. That of a pair is the mean of both directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.lenses.model import Lens, world_rays
from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.directions import turned

_WIDTH = 48  # pixels of the views that are compared
_TOLERANCE = 2e-4  # of the distance


@dataclass(frozen=True)
class Outlook:
    """Surface points (P, 3) that a camera sees, metres; its pose (4, 4), lens."""

    pose: Float64Array
    lens: Lens
    points: Float64Array


def outlook(render_scene: RenderScene, pose: Float64Array, lens: Lens) -> Outlook:
    """Trace the surfaces that a camera sees; `lens` is that of any size of image."""
    height = max(1, round(lens.height * _WIDTH / lens.width))
    small = lens.resized(_WIDTH, height, square=True)
    origins, rays = world_rays(small, pose)
    distance, _ = cast(render_scene, origins, rays, through_glass=True)
    hit = np.isfinite(distance)
    starts = np.broadcast_to(origins, rays.shape)
    return Outlook(pose, lens, starts[hit] + rays[hit] * distance[hit, None].astype(np.float64))


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
    places, seen = other.lens.project(turned(one.points - eye, other.pose[:3, :3].T))
    inside = seen & other.lens.contains(places)
    if not inside.any():
        return 0.0
    offsets = one.points[inside] - eye
    metres = np.sqrt((offsets**2).sum(axis=1))
    free, _ = cast(render_scene, eye, offsets, through_glass=True)
    seen = free >= metres - _TOLERANCE * np.maximum(metres, 1)
    return float(seen.sum()) / len(one.points)
