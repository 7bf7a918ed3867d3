"""Input images of a view: depth, normal, reflectance, valid mask and object index.

One ray through each pixel centre, so the images are noise-free and equal in every run. Rays pass
clear glass. Not supported: reflections (a mirror shows its own reflectance, not its surroundings),
bump and normal maps (the normal is the interpolated vertex normal).
"""

from __future__ import annotations

import numpy as np

from pipeline.frames import Channels
from pipeline.render import raycast
from pipeline.render.scene import RenderScene
from pipeline.render.scene_geometry import Hits
from pipeline.views import View
from scenes.arrays import Float64Array
from scenes.geometry.directions import pixel_directions, unit

REVISION = 1


def render_inputs(render_scene: RenderScene, view: View) -> Channels:
    """Return the channels of an `inputs` frame, each (H, W).

    `Z`: float32, metres along the optical axis, 0 where no surface is. `N.X/Y/Z`: unit normal,
    camera frame (OpenCV), facing the camera. `albedo.R/G/B`: linear base colour, [0, 1].
    `valid`: 1 where there is a surface, else 0, and then all else is 0. `object`: uint32 index
    in `scene.objects` + 1, 0 for none.
    """
    turn, eye = view.pose[:3, :3], view.eye
    local = pixel_directions(view.intrinsics, view.width, view.height)
    directions = unit(local.reshape(-1, 3)) @ turn.T
    hits = raycast.surfaces(render_scene.geometry, eye, directions)
    shape = (view.height, view.width)
    valid = hits.shape >= 0
    depth = np.where(valid, (hits.position.astype(np.float64) - eye) @ turn[:, 2], 0)
    normal = np.where(valid[:, None], facing_normals(hits, directions), 0) @ turn
    objects = np.append(render_scene.geometry.objects, -1)[hits.shape] + 1
    channels: Channels = {"Z": depth.astype(np.float32).reshape(shape)}
    for axis, name in enumerate("XYZ"):
        channels[f"N.{name}"] = normal[:, axis].astype(np.float32).reshape(shape)
    for band, name in enumerate("RGB"):
        channels[f"albedo.{name}"] = hits.reflectance[:, band].reshape(shape)
    channels["valid"] = valid.astype(np.float32).reshape(shape)
    channels["object"] = objects.astype(np.uint32).reshape(shape)
    return channels


def facing_normals(hits: Hits, directions: Float64Array) -> Float64Array:
    """Return shading normals (N, 3), flipped to the side from which each ray (N, 3) arrives.

    The geometric normal decides on the side. An interpolated normal that still points away, as
    happens at silhouettes, is bent until it is perpendicular to the ray.
    """
    geometric = hits.geometric_normal.astype(np.float64)
    shading = hits.shading_normal.astype(np.float64)
    shading = np.where(_dots(shading, geometric) < 0, -shading, shading)
    shading = np.where(_dots(geometric, directions) > 0, -shading, shading)
    return unit(shading - np.maximum(_dots(shading, directions), 0) * directions)


def _dots(a: Float64Array, b: Float64Array) -> Float64Array:
    return (a * b).sum(axis=-1, keepdims=True)
