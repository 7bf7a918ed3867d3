"""Ways of computing indirect light, compared: quality against processor seconds.

    python -m benchmarks.transport_ways DATA [SCENE ...]

DATA is a data folder with scenes, cameras and colour frames. Prints a Markdown table: SSIM and FLIP
of the first view of each scene against its colour frame, each picture exposed by itself, and the
processor seconds of the indirect light alone, kernels compiled before. All ways share direct light,
gloss and emission of `pbrnet.pipeline.passes.transport`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.model.evaluation.metrics import measure
from pbrnet.pipeline.frames import frame_path, read_frame
from pbrnet.pipeline.passes.groundtruth import rooms_box
from pbrnet.pipeline.passes.transport import gathered, samples_for, surfels_for
from pbrnet.pipeline.pathtrace.guiding import (
    _lit_by_lamps,
    _lit_surface_irradiance,
    plan_guiding,
)
from pbrnet.pipeline.pathtrace.irradiance import sunlit_surfaces
from pbrnet.pipeline.pathtrace.light_plan import plan_lights
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.render.drjit_arrays import column, vector
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.tonemap import ToneParams, exposure_of, tonemap
from pbrnet.pipeline.transport.launches import TransportLauncher
from pbrnet.pipeline.transport.pixels import Samples
from pbrnet.pipeline.transport.radiosity import Surfels, grid_size
from pbrnet.pipeline.transport.settings import TransportParams
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.arrays import AnyArray, Float32Array
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.seeds import generator

SEED = 7
_PANORAMA = 4608


@dataclass
class Bench:
    """A view with its light plan, and what all ways share."""

    scene: RenderScene
    view: View
    truth: Float32Array
    launcher: TransportLauncher

    def __post_init__(self) -> None:
        self.mitsuba, home = self.scene.neutral(None).mitsuba, self.scene.scene
        self.plan = plan_lights(self.mitsuba, self.view, home.portals, SEED, rooms_box(home.rooms))
        self.guiding = plan_guiding(self.mitsuba, self.plan, SEED)
        self.lights = PlannedLights(self.mitsuba, self.plan, self.guiding)
        self.images = self.gathered(TransportParams())

    def surfels(self, count: int) -> Surfels:
        size = grid_size(count, self.view.width, self.view.height)
        return self.launcher.surfels(self.lights, self.view, size, SEED)

    def gathered(
        self, params: TransportParams, surfels: Surfels | None = None
    ) -> dict[str, Float32Array]:
        """Images of the method as it is, with these parameters."""
        pixels = self.view.width * self.view.height
        found = surfels or self.surfels(params.surfels or surfels_for(pixels))
        samples = Samples.of(params.samples or samples_for(pixels))
        inputs = self.lights, self.view, found, samples, params.bounces
        return gathered(self.launcher, *inputs, SEED)

    def picture(self, indirect: Float32Array, **other: Float32Array) -> Float32Array:
        images = {**self.images, **other}
        light = images["albedo"] * (images["direct"] + indirect)
        return np.asarray(light + sum(images[name] for name in ("specular", "panes", "emitted")))

    def panorama(self) -> tuple[Surfels, AnyArray]:
        """Surfels that a panorama around the eye sees, and their area."""
        directions = fibonacci_sphere(_PANORAMA)
        rays = (
            vector(mi.Point3f, np.tile(self.view.eye, (_PANORAMA, 1))),
            vector(mi.Vector3f, directions),
            column(mi.Float, np.ones(_PANORAMA)),
        )
        surfels = self.launcher.lit(self.lights, rays, SEED)
        cosine = np.maximum(np.abs((surfels.normals * directions).sum(axis=-1)), 0.15)
        squared = ((surfels.points - self.view.eye) ** 2).sum(axis=-1)
        return surfels, 4 * np.pi / _PANORAMA * squared / cosine

    def places(self) -> tuple[AnyArray, AnyArray]:
        """Mean position and normal of each pixel, (H * W, 3)."""
        share = np.maximum(self.images["seen"], 1e-6)
        normal = (self.images["normal"] / share).reshape(-1, 3)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)
        return (self.images["position"] / share).reshape(-1, 3), normal


def form_factors(
    points: AnyArray, normals: AnyArray, to: AnyArray, towards: AnyArray, area: AnyArray
) -> Float32Array:
    """Form factors (P, S) without visibility, those of a receiver divided by their sum."""
    parts = []
    for start in range(0, len(points), 2048):
        some = slice(start, start + 2048)
        offset = (to[None] - points[some, None]).astype(np.float32)
        squared = np.einsum("psk,psk->ps", offset, offset)
        away = np.einsum("psk,pk->ps", offset, normals[some].astype(np.float32))
        back = -np.einsum("psk,sk->ps", offset, towards.astype(np.float32))
        top = np.maximum(away, 0) * np.maximum(back, 0) / np.maximum(squared, 1e-6) * area
        factor = (top / (np.pi * squared + area + 1e-9)).astype(np.float32)
        parts.append(factor / np.maximum(factor.sum(axis=1, keepdims=True), 1e-9))
    return np.concatenate(parts)


def unoccluded_radiosity(bench: Bench, bounces: int) -> Float32Array:
    """Panorama surfels and form factors without visibility: the simplest radiosity."""
    surfels, area = bench.panorama()
    area = area.astype(np.float32)
    between = form_factors(surfels.points, surfels.normals, surfels.points, surfels.normals, area)
    light = surfels.direct
    for _ in range(bounces):
        light = surfels.direct + between @ (surfels.albedo * light)
    places, normals = bench.places()
    to_pixels = form_factors(places, normals, surfels.points, surfels.normals, area)
    return (to_pixels @ (surfels.albedo * light)).reshape(bench.images["direct"].shape)


def virtual_lights(bench: Bench, count: int, visible: bool) -> Float32Array:
    """Light from the sources' side: virtual point lights where lamps and sun shine, one bounce."""
    random = generator(SEED, "virtual")
    scene = bench.mitsuba
    sun = sunlit_surfaces(scene, bench.plan.rectangles, bench.plan.sun_disc, 512, random)
    parts = zip(_lit_by_lamps(scene, random), sun, strict=True)
    hits, facing, flux = (np.concatenate(part) for part in parts)
    chosen = np.argsort(-flux, kind="stable")
    chosen = chosen[flux[chosen] > 0][:: max(1, int((flux > 0).sum()) // count)][:count]
    scale = flux.sum() / max(flux[chosen].sum(), 1e-30)
    places, normals = bench.places()
    hits, facing, flux = hits[chosen], facing[chosen], flux[chosen] * scale
    light = np.zeros(len(places))
    for start in range(0, len(places), 4096):
        some = slice(start, start + 4096)
        if visible:
            found, _ = _lit_surface_irradiance(
                scene, places[some] + 1e-3 * normals[some], normals[some], hits, facing, flux
            )
        else:
            offset = hits[None] - places[some, None]
            metres = np.maximum(np.linalg.norm(offset, axis=-1), 1e-6)
            away = np.maximum((offset * normals[some, None]).sum(-1), 0) / metres
            back = np.maximum(-(offset * facing[None]).sum(-1), 0) / metres
            found = 0.5 / np.pi * flux * away * back / (metres**2 + 0.16)
        light[some] = found.sum(axis=1) / np.pi
    shape = bench.images["direct"].shape
    return np.broadcast_to(light.reshape(*shape[:2], 1), shape).astype(np.float32)


def ways(bench: Bench) -> Iterator[tuple[str, Callable[[], Float32Array]]]:
    """Yield the name of each way and a function that makes its picture."""
    nothing = np.zeros_like(bench.images["direct"])
    usual = TransportParams()

    def own(**params: int) -> Callable[[], Float32Array]:
        chosen = replace(usual, **params)
        return lambda: bench.picture(bench.gathered(chosen)["indirect"])

    yield "direct light alone", lambda: bench.picture(nothing)
    mean = bench.images["indirect"].mean(axis=(0, 1))
    yield "direct light and the mean of the indirect", lambda: bench.picture(nothing + mean)
    yield (
        "256 lights where sources shine, no visibility",
        lambda: bench.picture(virtual_lights(bench, 256, False)),
    )
    yield (
        "256 lights where sources shine, visibility",
        lambda: bench.picture(virtual_lights(bench, 256, True)),
    )
    for bounces in (0, 6):
        yield (
            f"{_PANORAMA} surfels of a panorama, unoccluded form factors, {bounces + 1} bounces",
            lambda bounces=bounces: bench.picture(unoccluded_radiosity(bench, bounces)),
        )
    yield (
        f"{_PANORAMA} surfels of a panorama, rays, final gathering",
        lambda: bench.picture(bench.gathered(usual, bench.panorama()[0])["indirect"]),
    )
    for count in (256, 1024, 4000, 8000):
        yield f"{count} surfels that the view sees, rays, final gathering", own(surfels=count)
    for bounces in (0, 1, 2):
        yield f"16000 surfels, {bounces + 1} bounces", own(bounces=bounces)
    yield "**16000 surfels, 9 bounces**", own()
    yield (
        "the same without gloss",
        lambda: bench.picture(bench.images["indirect"], specular=nothing),
    )


def main() -> None:
    """Print the table."""
    data, names = Path(sys.argv[1]), sys.argv[2:]
    set_variant()
    scores: dict[str, list[tuple[float, float, float]]] = {}
    for path in sorted((data / "cameras").glob("*.json")):
        if names and path.stem not in names:
            continue
        view = load_cameras(path).views[0]
        truth = frame_path(data, "color", view)
        if not truth.is_file():
            continue
        scene = open_scene(load_scene(data / "scenes" / path.stem))
        bench = Bench(scene, view, read_frame(truth).rgb, TransportLauncher(scene))
        shown = tonemap(bench.truth, exposure_of(bench.truth, ToneParams()))
        for name, way in ways(bench):
            way()  # compiles
            started = time.process_time()
            picture = way().astype(np.float32)
            seconds = time.process_time() - started
            values = measure(shown, tonemap(picture, exposure_of(picture, ToneParams())))
            scores.setdefault(name, []).append((values["ssim"], values["flip"], seconds))
            print(path.stem, name, *(f"{v:.3f}" for v in scores[name][-1]), file=sys.stderr)
        dr.flush_malloc_cache()
    print("| way | SSIM | FLIP | processor seconds |\n|---|---:|---:|---:|")
    for name, values in scores.items():
        ssim, flip, seconds = np.mean(values, axis=0)
        print(f"| {name} | {ssim:.3f} | {flip:.3f} | {seconds:.2f} |")


if __name__ == "__main__":
    main()
