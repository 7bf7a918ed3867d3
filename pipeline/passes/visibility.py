"""Shadows of the panorama's lights: how much of their direct light reaches each pixel's surface.

From every surface in view a few rays go to the places of the sources that the panorama shows; the
more a source would bring without shadows, the more of the rays. Nothing is random: the choice is
stratified, over the rays of a pixel and over those of its neighbours on the same surface, which
then lend each other their rays (interleaved sampling, Keller and Heidrich 2001). What the panorama
does not know, lamps hidden from the camera and light that bounces, this does not know either.
"""

from __future__ import annotations

import numpy as np

from pipeline.frames import TINT, Channels
from pipeline.params import IlluminationParams
from pipeline.passes.illumination import render_illumination
from pipeline.passes.inputs import facing
from pipeline.passes.panorama_lights import sources, unshadowed
from pipeline.render import raycast
from pipeline.render.scene import RenderScene
from pipeline.views import View
from scenes.arrays import AnyArray
from scenes.color import luminance
from scenes.geometry.directions import pixel_directions, unit

REVISION = 1
_LIFT = 1e-3  # metres: how far off the surface rays begin
_ORDER = ((0, 8, 2, 10), (12, 4, 14, 6), (3, 11, 1, 9), (15, 7, 13, 5))  # Bayer 1973
_WINDOW = (0.5, 1.0, 1.0, 1.0, 0.5)
_ALIKE = 0.9  # cosine between the normals of one surface
_FLAT = 0.01  # of the depth: how far off a pixel's plane its surface may lie
_SLACK = 0.02  # metres before a source's mean place that count as arrived


def render_visibility(
    render_scene: RenderScene,
    view: View,
    params: IlluminationParams,
    panorama: Channels | None = None,
    inputs: Channels | None = None,
) -> Channels:
    """`visibility.Y`, float32 (H, W), [0, 1]: share of the panorama's direct light that arrives.

    Estimated by `params.shadow_rays` rays a pixel, and those of its neighbours. 1 where there is
    no surface, or none of the light would reach it anyway. `panorama` and `inputs` are what
    `render_illumination` and `render_inputs` make of the same, where they are there already; depth
    and normals of the latter are rounded, which may turn a ray that grazes an edge.
    """
    panorama = panorama or render_illumination(render_scene, view, params)
    tint = np.stack([panorama[name] for name in TINT], axis=-1)
    places, power = sources(panorama["intensity.Y"][..., None] * tint, panorama["distance.Z"])
    turn, eye = view.pose[:3, :3], view.eye
    seen, points, normals = (
        _looked_at(render_scene, view) if inputs is None else _held_by(inputs, view)
    )
    share = np.ones(len(seen))
    if len(places) and seen.any():
        share[seen] = _arriving(
            render_scene,
            points[seen],
            normals[seen],
            eye + places @ turn.T,
            luminance(power.astype(np.float64)),
            _strata(view, params.shadow_rays).reshape(-1, params.shadow_rays)[seen],
        )
    shape = (view.height, view.width)
    lent = shared(
        share.reshape(shape),
        points.reshape(*shape, 3) - eye,
        normals.reshape(*shape, 3),
        seen.reshape(shape),
    )
    return {"visibility.Y": lent.astype(np.float32)}


def _looked_at(render_scene: RenderScene, view: View) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Of each pixel, row by row, whether it shows a surface (P,), and that surface's place and
    normal, (P, 3) each, world."""
    local = pixel_directions(view.intrinsics, view.width, view.height)
    directions = unit(local.reshape(-1, 3)) @ view.pose[:3, :3].T
    hits = raycast.surfaces(render_scene.target, view.eye, directions, colors=False)
    return hits.shape >= 0, hits.position.astype(np.float64), facing(hits, directions)


def _held_by(inputs: Channels, view: View) -> tuple[AnyArray, AnyArray, AnyArray]:
    """The same, from a view's rasterised inputs."""
    turn = view.pose[:3, :3].T
    local = pixel_directions(view.intrinsics, view.width, view.height)
    points = (local * inputs["Z"].astype(np.float64)[..., None]).reshape(-1, 3) @ turn + view.eye
    normals = np.stack([inputs[f"N.{axis}"].astype(np.float64) for axis in "XYZ"], axis=-1)
    return inputs["valid"].ravel() > 0, points, unit(normals.reshape(-1, 3)) @ turn


def _arriving(
    render_scene: RenderScene,
    points: AnyArray,
    normals: AnyArray,
    places: AnyArray,
    power: AnyArray,
    strata: AnyArray,
) -> AnyArray:
    """Share of the rays (P, K) from points (P, 3) to sources (S, 3) that meet nothing, (P,)."""
    chosen = np.zeros(strata.shape, dtype=np.int64)
    some = np.zeros(len(points), dtype=bool)
    for part, brought in unshadowed(points, normals, places):
        chosen[part], some[part] = choose(brought * power, strata[part])
    rows = np.flatnonzero(some)
    origins = np.repeat(points[rows] + _LIFT * normals[rows], strata.shape[1], axis=0)
    towards = places[chosen[rows].ravel()] - origins
    metres = np.linalg.norm(towards, axis=1)
    shape, free = raycast.nearest(render_scene.target, origins, towards / metres[:, None])
    lights = np.zeros(len(render_scene.target.shapes) + 1, dtype=bool)  # the last: no shape
    lights[render_scene.lights.shape[render_scene.lights.shape >= 0]] = True
    # A lamp hides its own mean place, and so does another light: what is met then shines itself.
    arrives = (free >= metres - _SLACK) | lights[shape]
    share = np.ones(len(points))
    share[rows] = arrives.reshape(len(rows), -1).mean(axis=1)
    return share


def choose(weights: AnyArray, strata: AnyArray) -> tuple[AnyArray, AnyArray]:
    """For each of P points the numbers (P, K) of K sources, drawn by `weights` (P, S).

    `strata` (P, K) in [0, 1) says where in the cumulated weights each stands. Also (P,): whether
    there is any weight at all; where not, the numbers mean nothing.
    """
    cumulated = np.cumsum(weights, axis=1, dtype=np.float64)
    total = cumulated[:, -1:]
    cumulated /= np.where(total > 0, total, 1)
    # One sorted line of all points' weights, each a unit long.
    start = np.arange(len(weights))[:, None]
    found = np.searchsorted((cumulated + start).ravel(), (strata + start).ravel(), side="right")
    number = found.reshape(strata.shape) - start * weights.shape[1]
    return np.clip(number, 0, weights.shape[1] - 1), total[:, 0] > 0


def _strata(view: View, count: int) -> AnyArray:
    """Where the rays of each pixel stand in [0, 1): (H, W, count), one to each equal part.

    Of any 4x4 pixels each stands elsewhere in its parts, at one of sixteen equal steps.
    """
    row, column = np.mgrid[: view.height, : view.width]
    shift = (np.array(_ORDER)[row % 4, column % 4] + 0.5) / 16
    return (np.arange(count) + shift[..., None]) / count


def shared(share: AnyArray, points: AnyArray, normals: AnyArray, seen: AnyArray) -> AnyArray:
    """Each pixel's mean (H, W) with those of the 5x5 around it that lie on its surface.

    `points`, from the camera, and unit `normals` are (H, W, 3); `seen` (H, W): where there is a
    surface. The outermost count half, so that each of a 4x4 pattern has the same weight.
    """
    height, width = share.shape
    depth = np.linalg.norm(points, axis=-1)
    total, weight = np.zeros_like(share), np.zeros_like(share)
    near = [np.ascontiguousarray(np.moveaxis(each, -1, 0)) for each in (points, normals)]
    grown = [
        np.pad(each, ((0, 0),) * (each.ndim - 2) + ((2, 2), (2, 2)))
        for each in (share, *near, seen)
    ]
    for down in range(5):
        for across in range(5):
            theirs, place, normal, there = (
                each[..., down : down + height, across : across + width] for each in grown
            )
            off = np.abs(_dot(place - near[0], near[1]))
            alike = (_dot(normal, near[1]) > _ALIKE) & (off < _FLAT * depth) & there
            counts = alike * _WINDOW[down] * _WINDOW[across]
            total += counts * theirs
            weight += counts
    return np.where(seen & (weight > 0), total / np.where(weight > 0, weight, 1), share)


def _dot(one: AnyArray, other: AnyArray) -> AnyArray:
    """Of vectors whose components come first, (3, H, W): (H, W)."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])
