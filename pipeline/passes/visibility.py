"""Visibility of the panorama's light sources from each pixel's surface, by shadow rays.

A few shadow rays per pixel go from the surface to sources of the panorama, chosen in proportion to
their unshadowed irradiance. Nothing is random: the choice is stratified over the rays of a pixel
and over its neighbours on the same surface, whose results are then averaged (interleaved sampling,
Keller and Heidrich 2001). Like the panorama, the result does not include lamps that are hidden from
the camera, nor indirect light.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pbrnet.pipeline.channels import TINT, Kind
from pbrnet.pipeline.frames import Channels, Result, stacked
from pbrnet.pipeline.panorama_lights import sources, unshadowed_irradiance
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import facing_normals
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import luminance
from pbrnet.scenes.geometry.directions import turned

_RAY_OFFSET = 1e-3  # metres: distance of ray origins from the surface
_BAYER = ((0, 8, 2, 10), (12, 4, 14, 6), (3, 11, 1, 9), (15, 7, 13, 5))  # Bayer 1973
_WINDOW = (0.5, 1.0, 1.0, 1.0, 0.5)  # weights of the 5 x 5 neighbourhood, per axis
_MIN_COSINE = 0.9  # between the normals of one surface
_MAX_OFFSET = 0.01  # of the depth: distance of a surface from the pixel's tangent plane
_TOLERANCE = 0.02  # metres before a source's mean position within which a ray has arrived


def settings(params: IlluminationParams) -> dict[Kind, IlluminationParams]:
    """Return the settings of panorama and visibility.

    Visibility for a picture has the usual shadow rays where the parameters have none.
    """
    rays = params.shadow_rays or IlluminationParams.shadow_rays
    return {
        "illumination": replace(params, shadow_rays=0),
        "visibility": replace(params, shadow_rays=rays),
    }


def render_lights(
    scene: RenderScene, view: View, settings: Mapping[Kind, IlluminationParams], seed: int = 0
) -> dict[Kind, Result]:
    """Render the panorama of light sources, their visibility, or both; nothing is random."""
    panorama = render_illumination(scene, view, next(iter(settings.values())))
    made: dict[Kind, Result] = {"illumination": (panorama, {})}
    if "visibility" in settings:
        shares = render_visibility(scene, view, settings["visibility"], panorama)
        made["visibility"] = shares, {}
    return {kind: made[kind] for kind in settings}


def render_visibility(
    render_scene: RenderScene,
    view: View,
    params: IlluminationParams,
    panorama: Channels | None = None,
) -> Channels:
    """Return `visibility.Y`, float32 (H, W), [0, 1]: the unoccluded share of direct light.

    Estimated with `params.shadow_rays` rays per pixel and those of its neighbours. 1 where there
    is no surface, or where no source faces it. `panorama` is the result of `render_illumination`
    for the same view, if it exists already.
    """
    panorama = panorama or render_illumination(render_scene, view, params)
    tint = stacked(panorama, TINT)
    positions, power = sources(panorama["intensity.Y"][..., None] * tint, panorama["distance.Z"])
    turn, eye = view.pose[:3, :3], view.eye
    origins, directions = view.world_rays()
    hits = raycast.surfaces(render_scene.geometry, origins, directions, colors=False)
    seen, points = hits.shape >= 0, hits.position.astype(np.float64)
    normals = facing_normals(hits, directions)
    share = np.ones(len(seen))
    if len(positions) and seen.any():
        share[seen] = _unoccluded_share(
            render_scene,
            points[seen],
            normals[seen],
            eye + turned(positions, turn),
            luminance(power.astype(np.float64)),
            _strata(view, params.shadow_rays).reshape(-1, params.shadow_rays)[seen],
        )
    shape = (view.height, view.width)
    averaged = surface_mean(
        share.reshape(shape),
        points.reshape(*shape, 3) - eye,
        normals.reshape(*shape, 3),
        seen.reshape(shape),
    )
    return {"visibility.Y": averaged.astype(np.float32)}


def _unoccluded_share(
    render_scene: RenderScene,
    points: AnyArray,
    normals: AnyArray,
    positions: AnyArray,
    power: AnyArray,
    strata: AnyArray,
) -> AnyArray:
    """Return the share of unoccluded rays from each point (P, 3) to sources (S, 3), (P,).

    `power` (S,) are the sources' intensities, `strata` (P, K) the rays' stratified samples.
    """
    chosen = np.zeros(strata.shape, dtype=np.int64)
    lit = np.zeros(len(points), dtype=bool)
    for part, irradiance in unshadowed_irradiance(points, normals, positions):
        chosen[part], lit[part] = choose_sources(irradiance * power, strata[part])
    rows = np.flatnonzero(lit)
    origins = np.repeat(points[rows] + _RAY_OFFSET * normals[rows], strata.shape[1], axis=0)
    offsets = positions[chosen[rows].ravel()] - origins
    metres = np.linalg.norm(offsets, axis=1)
    shape, free = raycast.nearest(render_scene.geometry, origins, offsets / metres[:, None])
    lights = np.zeros(len(render_scene.geometry.shapes) + 1, dtype=bool)  # the last: no shape
    lights[render_scene.lights.shape[render_scene.lights.shape >= 0]] = True
    # A lamp's surface may lie before its mean position, and so may another lamp: no occlusion.
    arrives = (free >= metres - _TOLERANCE) | lights[shape]
    share = np.ones(len(points))
    share[rows] = arrives.reshape(len(rows), -1).mean(axis=1)
    return share


def choose_sources(weights: AnyArray, strata: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Choose K sources for each of P points in proportion to `weights` (P, S).

    Inverts the cumulative weights at `strata` (P, K) in [0, 1). Returns the sources' indices
    (P, K) and flags (P,): False where all weights are 0 and the indices are meaningless.
    """
    cumulated = np.cumsum(weights, axis=1, dtype=np.float64)
    total = cumulated[:, -1:]
    cumulated /= np.where(total > 0, total, 1)
    # One sorted array of all points' cumulative weights, each shifted by its row number.
    start = np.arange(len(weights))[:, None]
    found = np.searchsorted((cumulated + start).ravel(), (strata + start).ravel(), side="right")
    number = found.reshape(strata.shape) - start * weights.shape[1]
    return np.clip(number, 0, weights.shape[1] - 1), total[:, 0] > 0


def _strata(view: View, count: int) -> AnyArray:
    """Return stratified samples of each pixel in [0, 1), (H, W, count), one in each equal part.

    Within each 4 x 4 block of pixels, the offsets in the parts are sixteen equal steps, in the
    order of Bayer's matrix.
    """
    row, column = np.mgrid[: view.height, : view.width]
    shift = (np.array(_BAYER)[row % 4, column % 4] + 0.5) / 16
    return (np.arange(count) + shift[..., None]) / count


def surface_mean(share: AnyArray, points: AnyArray, normals: AnyArray, seen: AnyArray) -> AnyArray:
    """Average `share` (H, W) over those of the 5 x 5 pixels around that lie on the same surface.

    `points`, relative to the camera, and unit `normals` are (H, W, 3); `seen` (H, W) flags pixels
    with a surface. The outermost pixels count half, so that each offset of the 4 x 4 pattern has
    the same weight.
    """
    height, width = share.shape
    depth = np.linalg.norm(points, axis=-1)
    total, weight = np.zeros_like(share), np.zeros_like(share)
    own = [np.ascontiguousarray(np.moveaxis(each, -1, 0)) for each in (points, normals)]
    padded = [
        np.pad(each, ((0, 0),) * (each.ndim - 2) + ((2, 2), (2, 2))) for each in (share, *own, seen)
    ]
    for down in range(5):
        for across in range(5):
            theirs, point, normal, valid = (
                each[..., down : down + height, across : across + width] for each in padded
            )
            offset = np.abs(_dot(point - own[0], own[1]))
            same = (_dot(normal, own[1]) > _MIN_COSINE) & (offset < _MAX_OFFSET * depth) & valid
            counts = same * _WINDOW[down] * _WINDOW[across]
            total += counts * theirs
            weight += counts
    return np.where(seen & (weight > 0), total / np.where(weight > 0, weight, 1), share)


def _dot(one: AnyArray, other: AnyArray) -> AnyArray:
    """Return the dot products (H, W) of vectors whose components come first, (3, H, W)."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])
