"""Frozen launches of the transport kernels of an open scene: recorded once, then replayed.

As in `pbrnet.pipeline.pathtrace.launches`: before a kernel's first ray, Python and Dr.Jit need a
tenth of a second or more to trace it through all materials.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.launches import Recordings
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.pathtrace.panes import panes_of
from pbrnet.pipeline.render.drjit_arrays import column, environment_pointer, partner_table, to_numpy
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.cells import LightTable
from pbrnet.pipeline.transport.gather import World
from pbrnet.pipeline.transport.pixels import IMAGES, Kernel, Samples, gather_pixels, light_samples
from pbrnet.pipeline.transport.radiosity import Surfels, surfels_in_view, surfels_of
from pbrnet.pipeline.transport.rays import ShapeTables
from pbrnet.pipeline.transport.smoothing import smooth, spread_fireflies
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array, Float64Array
from pbrnet.scenes.seeds import derive32

_SMOOTHED = ("direct", "indirect", "specular")

Size = tuple[int, int]  # width, height


class TransportLauncher:
    """Tables and recorded launches of one open scene, kept between its views."""

    def __init__(self, render_scene: RenderScene) -> None:
        self._lobes = partner_table(
            [(own, lobe) for own, lobe, _ in render_scene.materials.lobes()]
        )
        self._tables = ShapeTables(render_scene.geometry)
        self._scene = render_scene.neutral(None).mitsuba
        self._panes = panes_of(render_scene.scene.portals)
        self._recorded = Recordings().of

    def surfels(self, lights: PlannedLights, view: View, size: Size, seed: int) -> Surfels:
        """Trace the surfels of a view, from a grid of `size` over its image."""
        number = dr.opaque(mi.UInt32, derive32(seed, "surfels"))
        launch = self._recorded(surfels_in_view, size)
        return surfels_of(launch(self._world(lights), _camera(view, size), size, number))

    def light(
        self, lights: PlannedLights, cache: LightTable, view: View, samples: Samples, seed: int
    ) -> tuple[dr.ArrayBase, ...]:
        """Trace the `LightSamples` of an image; of `cache`, only the places of cells count."""
        launch = self._recorded(light_samples, (view.width, view.height, samples))
        number = dr.opaque(mi.UInt32, derive32(seed, "light"))
        return tuple(launch(self._kernel(lights, cache, view), samples, number))

    def pixels(
        self,
        lights: PlannedLights,
        cache: LightTable,
        view: View,
        samples: Samples,
        seed: int,
        light: tuple[dr.ArrayBase, ...],
    ) -> dict[str, Float32Array]:
        """Return the images of `IMAGES`, float32 (H, W, bands); `light` is from `light`.

        `direct`, `indirect` and `specular` are smoothed, and no longer weighted. `color` is the
        picture before that, of single samples.
        """
        size = (view.width, view.height)
        number = dr.opaque(mi.UInt32, derive32(seed, "pixels"))
        launch = self._recorded(gather_pixels, (*size, samples))
        bands = launch(self._kernel(lights, cache, view), samples, number, light)
        dr.eval(bands)
        eye = column(mi.Float, view.eye)
        smoothed = self._recorded(_smoothed, size)(bands, eye, size, samples)
        found = _named(list(to_numpy(*bands)), view)
        found["color"] = _picture(found)
        clean = to_numpy(*smoothed)
        for name, image in zip(_SMOOTHED, clean, strict=True):
            found[name] = image.reshape(view.height, view.width, 3)
        return found

    def _world(self, lights: PlannedLights) -> World:
        environment = environment_pointer(self._scene)
        return World(self._scene, self._tables, lights, self._lobes, environment)

    def _kernel(self, lights: PlannedLights, cache: LightTable, view: View) -> Kernel:
        size = (view.width, view.height)
        return Kernel(self._world(lights), cache, _camera(view, size), size, self._panes)


def _camera(view: View, size: Size) -> tuple[mi.Float, mi.Float]:
    """Return the eye and the matrix from positions in an image of `size` to directions."""
    scale = np.diag([view.width / size[0], view.height / size[1], 1.0])
    matrix: Float64Array = view.pose[:3, :3] @ np.linalg.inv(view.intrinsics) @ scale
    return column(mi.Float, view.eye), column(mi.Float, matrix.ravel())


def _named(bands: list[AnyArray], view: View) -> dict[str, Float32Array]:
    """Return the bands of each image together."""
    found, first = {}, 0
    for name, count in IMAGES.items():
        image = np.stack(bands[first : first + count], axis=-1)
        found[name] = image.reshape(view.height, view.width, count)
        first += count
    return found


def _picture(images: dict[str, Float32Array]) -> Float32Array:
    """Return the radiance of the images of `IMAGES`, (H, W, 3)."""
    weight = images["weight"]
    inverse = np.divide(1, weight, out=np.zeros_like(weight), where=weight > 0)
    light = (images["direct"] + images["indirect"]) * inverse
    return images["albedo"] * light + images["specular"] + images["panes"] + images["emitted"]


def _smoothed(
    bands: list[mi.Float], eye: mi.Float, size: Size, samples: Samples
) -> list[mi.Color3f]:
    """Return the smoothed light of the bands that `gather_pixels` made, `mi.Color3f` each."""
    first = {name: sum(list(IMAGES.values())[:place]) for place, name in enumerate(IMAGES)}

    def image(kind: type[mi.Color3f], name: str) -> mi.Color3f:
        return kind(*bands[first[name] : first[name] + 3])

    # Light is that of the samples which see a surface, each as much as it is reflected.
    weight = image(mi.Color3f, "weight")
    inverse = dr.select(weight > 0, dr.rcp(weight), 0)
    images = [image(mi.Color3f, name) * inverse for name in ("direct", "indirect")]
    specular = image(mi.Color3f, "specular")
    means, squares = first["light_means"], first["light_squares"]
    moments = [
        (bands[means], bands[squares], samples.light),
        (bands[means + 1], bands[squares + 1], samples.light),
        (mi.luminance(specular), bands[first["specular_squares"]], samples.gloss),
    ]
    noise = [
        dr.maximum(square - dr.square(mean), 0) / max(1, count - 1)
        for mean, square, count in moments
    ]
    lit = bands[first["lit"]]
    share = dr.square(dr.select(lit > 0, dr.rcp(lit), 0))
    specular, noise[2] = spread_fireflies(specular, size, noise[2])
    images, noise = [*images, specular], [noise[0] * share, noise[1] * share, noise[2]]
    origin = mi.Vector3f(*(dr.gather(mi.Float, eye, mi.UInt32(axis)) for axis in range(3)))
    surfaces = image(mi.Vector3f, "normal"), image(mi.Vector3f, "position"), bands[first["seen"]]
    direct, indirect, specular = smooth(images, noise, surfaces, lit, origin, size)
    # The thin edge of a chair has no neighbours to be smoothed with: its noise stays.
    return [*(spread_fireflies(image, size)[0] for image in (direct, indirect)), specular]
