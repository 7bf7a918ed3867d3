"""Materials of what a view sees: a renderer for each channel of a `materials` frame.

The rays are those of the inputs: one through each pixel centre, past clear glass, so the images
are noise-free and equal in every run. `pbrnet.pipeline.render.materials` has the rules and
conventions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, channels_by, facing_normals
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.materials import MaterialValues
from pbrnet.scenes.arrays import AnyArray, BoolArray
from pbrnet.scenes.geometry.directions import turned


@dataclass(frozen=True)
class VisibleMaterials:
    """Visible surfaces with the values of their materials, evaluated on first use."""

    surfaces: VisibleSurfaces

    @property
    def values(self) -> MaterialValues:
        """Values at the P pixels."""
        return self._evaluated[0]

    @property
    def bumped(self) -> BoolArray:
        """True at pixels whose material has a bump or normal map, (P,)."""
        return self._evaluated[1]

    @property
    def known(self) -> AnyArray:
        """1 where the material can say its values, else 0, (P,)."""
        return self.values.known

    @cached_property
    def _evaluated(self) -> tuple[MaterialValues, BoolArray]:
        surfaces = self.surfaces
        geometry, eye = surfaces.scene.geometry, surfaces.origins
        return surfaces.scene.table.values(
            geometry, surfaces.hits, eye, surfaces.directions, surfaces.textures
        )


def roughness(materials: VisibleMaterials) -> AnyArray:
    """Return perceptual roughness (P,), the square root of alpha."""
    return materials.values.roughness * materials.known


def metalness(materials: VisibleMaterials) -> AnyArray:
    """Return the share of the metallic lobe, (P,)."""
    return materials.values.metalness * materials.known


def specular_color(materials: VisibleMaterials) -> AnyArray:
    """Return the linear RGB reflectance at normal incidence of the specular lobe, (P, 3)."""
    return materials.values.specular * materials.known[:, None]


def normal_bump(materials: VisibleMaterials) -> AnyArray:
    """Return unit normals (P, 3) with bump and normal maps; without one, those of `normal`."""
    surfaces, hits = materials.surfaces, materials.surfaces.hits
    shading = np.where(materials.bumped[:, None], materials.values.normal, hits.shading_normal)
    normals = facing_normals(replace(hits, shading_normal=shading), surfaces.directions)
    normals = turned(np.where(surfaces.valid[:, None], normals, 0), surfaces.rotation.T)
    return normals.astype(np.float32)


def emission(materials: VisibleMaterials) -> AnyArray:
    """Return 1 where the surface emits light to the camera, else 0, (P,)."""
    surfaces = materials.surfaces
    lights = surfaces.scene.lights.shape
    emitting = np.zeros(len(surfaces.scene.geometry.shapes), dtype=bool)
    emitting[lights[lights >= 0]] = True
    if not np.append(emitting, False)[surfaces.hits.shape].any():
        return np.zeros(len(surfaces.valid), np.float32)
    _, _, light = raycast.emitted_radiance(
        surfaces.scene.geometry, surfaces.origins, surfaces.directions, emitting
    )
    return (light.max(axis=1) > 0).astype(np.float32)


def material_ids(materials: VisibleMaterials) -> AnyArray:
    """Return the index in the table of names + 1, 0 for none, uint32 (P,)."""
    return materials.surfaces.scene.table.ids(materials.surfaces.hits.shape)


def material_known(materials: VisibleMaterials) -> AnyArray:
    """Return 1 where the material can say its values, else 0, (P,)."""
    return materials.known


# Renderer of each channel: (P,), or (P, number of bands). Where no surface is, it returns 0.
RENDERERS: dict[str, Callable[[VisibleMaterials], AnyArray]] = {
    "roughness": roughness,
    "metalness": metalness,
    "specular_color": specular_color,
    "normal_bump": normal_bump,
    "emission": emission,
    "material": material_ids,
    "material_known": material_known,
}


def materials_of(
    surfaces: VisibleSurfaces, channels: Collection[str] | None = None
) -> tuple[Channels, dict[str, Any]]:
    """Return a frame's channels, or some of them, each (H, W), and the names of the materials."""
    chosen = {name: make for name, make in RENDERERS.items() if name in (channels or RENDERERS)}
    bands = channels_by("materials", surfaces.view, chosen, VisibleMaterials(surfaces))
    return bands, {"material_names": list(surfaces.scene.table.names)}
