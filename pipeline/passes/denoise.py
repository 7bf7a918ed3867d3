"""Intel's Open Image Denoise over path-traced frames, guided by noise-free albedo and normals.

The guides are box-averaged over sub-pixels, so that their edges are as smooth as the image's.
Equal input gives equal bits for any number of threads. The denoised image has a small bias; set
`groundtruth.denoise: none` to keep the raw frames.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from importlib.metadata import version
from types import ModuleType
from typing import Literal

import numpy as np

from pbrnet.pipeline.channels import RGB
from pbrnet.pipeline.frames import Channels, banded, stacked
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array

SUBPIXELS = 3  # per axis, in the guides
_WRAP = 64  # columns of the other edge that the denoiser sees beyond each edge of a panorama

Image = Float32Array
Guides = tuple[Image, Image]  # albedo and normal, (H, W, 3) each
Quality = Literal["high", "balanced", "fast"]


def denoiser_version() -> str:
    """Return the denoiser's name and version: part of a frame's fingerprint."""
    return f"oidn {version('pyoidn')}"


def denoise(
    image: Channels, albedo: Image, normal: Image, quality: Quality = "high", around: bool = False
) -> Channels:
    """Denoise `R`, `G`, `B` (H, W), linear HDR, guided by `albedo` and `normal` (H, W, 3).

    `fast` takes a quarter of the time of `high`. With `around` the image is a panorama, whose left
    and right edges meet.
    """
    if around:
        wide = {band: _wrapped(image[band]) for band in RGB}
        wide = denoise(wide, _wrapped(albedo), _wrapped(normal), quality)
        margin = _margin(image["R"])
        return {band: values[:, margin:-margin] for band, values in wide.items()}
    noisy = stacked(image).astype(np.float32)
    guided = {"albedo": albedo, "normal": normal, "clean_aux": True}
    clean = _oidn().denoise(noisy, hdr=True, quality=quality, **guided)
    clean = np.maximum(np.nan_to_num(clean), 0)
    return banded(clean)


def guides(render_scene: RenderScene, view: View) -> tuple[Image, Image]:
    """Return the sub-pixel means of albedo in [0, 1] and camera-frame normal, float32 (H, W, 3)."""
    fine = view.resized(SUBPIXELS * view.width, SUBPIXELS * view.height)
    channels = render_inputs(render_scene, fine)
    albedo = _average(channels, [f"albedo.{band}" for band in RGB])
    normal = _average(channels, [f"N.{axis}" for axis in "XYZ"])
    return albedo, normal


def grey_guide(normal: Image, albedo: float) -> Image:
    """Return the albedo guide of a textureless image: one grey wherever there is a surface."""
    surface = np.linalg.norm(normal, axis=-1, keepdims=True) > 0
    return np.where(surface, np.float32(albedo), np.float32(0)).repeat(3, axis=-1)


@cache
def _oidn() -> ModuleType:
    """Import `pyoidn` without torch, whose import costs each worker a second and 200 MB.

    `pyoidn` needs torch for tensors only, and works without it.
    """
    hide = "torch" not in sys.modules
    if hide:
        sys.modules["torch"] = None  # type: ignore[assignment]
    try:
        return import_module("pyoidn")
    finally:
        if hide:
            del sys.modules["torch"]


def _wrapped(values: AnyArray) -> Image:
    """Return a panorama (H, W, ...) with columns of the other edge beyond each edge."""
    margin = _margin(values)
    inside: list[tuple[int, int]] = [(0, 0)] * (values.ndim - 2)
    return np.pad(values, [(0, 0), (margin, margin), *inside], mode="wrap")


def _margin(values: AnyArray) -> int:
    return min(_WRAP, values.shape[1])


def _average(channels: Channels, names: list[str]) -> Image:
    stack = stacked(channels, names).astype(np.float32)
    height, width, bands = stack.shape
    blocks = stack.reshape(height // SUBPIXELS, SUBPIXELS, width // SUBPIXELS, SUBPIXELS, bands)
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)))
