"""Input images of a view: one renderer for each channel of an `inputs` frame.

One ray through each pixel centre, so the images are noise-free and equal in every run. Rays pass
clear glass. Not supported: reflections (a mirror shows its own reflectance, not its surroundings),
bump and normal maps (the normal is the interpolated vertex normal).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pbrnet.pipeline.channels import Kind, channels_of
from pbrnet.pipeline.frames import Channels, banded
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.render.scene_geometry import Hits
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import turned, unit

S = TypeVar("S")
_MIN_DEPTH = 1e-5  # metres


@dataclass(frozen=True)
class VisibleSurfaces:
    """Surfaces seen through the P pixel centres of a view, in row-major order.

    `origins`, (3,) or (P, 3), and unit `directions` (P, 3) are those of the rays in the world,
    `valid` (P,) flags rays that hit a surface. `textures` are those of the materials' `slots`, if
    they were evaluated.
    """

    scene: RenderScene
    view: View
    origins: Float64Array
    directions: Float64Array
    hits: Hits
    valid: BoolArray
    textures: list[AnyArray] | None = None

    @property
    def rotation(self) -> Float64Array:
        """Camera axes in the world as columns, (3, 3)."""
        return self.view.pose[:3, :3]


def depth(surfaces: VisibleSurfaces) -> AnyArray:
    """Return z-depth (P,): metres along the optical axis, 0 where no surface is.

    In fisheye and equirectangular views it is the distance along the ray. It is at least
    `_MIN_DEPTH`: a surface that touches the eye would round to one behind it.
    """
    offset = surfaces.hits.position.astype(np.float64) - surfaces.view.eye
    if surfaces.view.lens.depth_is_distance:
        along = np.sqrt(_dots(offset, offset)[:, 0])
    else:
        along = _dots(offset, surfaces.rotation[:, 2])[:, 0]
    along = np.maximum(along, _MIN_DEPTH)
    return np.where(surfaces.valid, along, 0).astype(np.float32)


def normal(surfaces: VisibleSurfaces) -> AnyArray:
    """Return unit normals (P, 3) that face the camera, in the camera's OpenCV axes."""
    normals = facing_normals(surfaces.hits, surfaces.directions)
    normals = turned(np.where(surfaces.valid[:, None], normals, 0), surfaces.rotation.T)
    return normals.astype(np.float32)


def reflectance(surfaces: VisibleSurfaces) -> AnyArray:
    """Return linear base colour (P, 3) in [0, 1]."""
    return surfaces.hits.reflectance


def valid(surfaces: VisibleSurfaces) -> AnyArray:
    """Return 1 where there is a surface, else 0, (P,)."""
    return surfaces.valid.astype(np.float32)


def object_index(surfaces: VisibleSurfaces) -> AnyArray:
    """Return the index in `scene.objects` + 1, 0 for none, uint32 (P,)."""
    objects = np.append(surfaces.scene.geometry.objects, -1)
    return (objects[surfaces.hits.shape] + 1).astype(np.uint32)


# Renderer of each channel: (P,), or (P, number of bands). Where no surface is, it returns 0.
RENDERERS: dict[str, Callable[[VisibleSurfaces], AnyArray]] = {
    "depth": depth,
    "normal": normal,
    "reflectance": reflectance,
    "valid": valid,
    "object": object_index,
}


def render_inputs(render_scene: RenderScene, view: View) -> Channels:
    """Return the channels of an `inputs` frame, each (H, W); `pbrnet.pipeline.channels` describes
    them.

    Where `valid` is 0 there is no surface, and all other channels are 0.
    """
    return inputs_of(visible_surfaces(render_scene, view))


def inputs_of(surfaces: VisibleSurfaces) -> Channels:
    """Return the channels of an `inputs` frame from surfaces that were traced with colours."""
    return channels_by("inputs", surfaces.view, RENDERERS, surfaces)


def channels_by(
    kind: Kind, view: View, renderers: Mapping[str, Callable[[S], AnyArray]], source: S
) -> Channels:
    """Return the channels of a kind of frame that `renderers` make of `source`, each (H, W)."""
    shape = (view.height, view.width)
    bands: Channels = {}
    for channel in channels_of(kind):
        if channel.name in renderers:
            values = renderers[channel.name](source).reshape(*shape, len(channel.bands))
            bands |= banded(values, channel.bands)
    return bands


def visible_surfaces(
    render_scene: RenderScene, view: View, colors: bool = True, textures: bool = False
) -> VisibleSurfaces:
    """Trace a ray through each pixel centre of a view; without `colors` reflectance is 0.

    With colours and `textures`, those of the materials are evaluated by the same trace.
    """
    origins, directions = view.world_rays()
    geometry, values = render_scene.geometry, None
    if colors and textures:
        slots = render_scene.table.slots
        hits, values = raycast.textured_surfaces(geometry, slots, origins, directions)
    else:
        hits = raycast.surfaces(geometry, origins, directions, colors)
    return VisibleSurfaces(render_scene, view, origins, directions, hits, hits.shape >= 0, values)


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
    products = a * b  # a sum over so short an axis takes three times as long
    return (products[..., 0] + products[..., 1] + products[..., 2])[..., None]
