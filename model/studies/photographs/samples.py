"""Pictures brought to one focal length, with normals, and the crops that networks train on.

All pictures are resampled to `FOCAL` pixels, that of the quick start's views of 160x120, so that an
object of one size at one distance has one size in pixels, and metres can be learned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy import ndimage

from pbrnet.model.studies.photographs.sets.contract import (
    Intrinsics,
    Key,
    Photograph,
    PhotographSet,
    rays_of,
)
from pbrnet.pipeline.photograph import varied_photograph
from pbrnet.pipeline.progress import Progress
from pbrnet.scenes.arrays import (
    AnyArray,
    BoolArray,
    Float32Array,
    Float64Array,
    FloatingArray,
    UInt8Array,
)
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import Draw, derive

FOCAL = 129.3  # pixels
CROP = (96, 128)  # height, width
WINDOW = 21 / 296.5  # width of a plane fit's window, of the focal length
RESIDUAL = 0.02  # metres, largest root mean square distance from the plane along z
VARIATIONS = 8  # photographs that are taken of each rendered view
_SIDES = (32, 1024)  # pixels after resampling


@dataclass(frozen=True)
class Sample:
    """A picture at the common focal length: fields as of `Photograph`, `rays` (H, W, 2).

    Normals are half floats, which thousands of pictures fit into memory with.
    Of labels, `label40` is None or known; `label13` always is an image, 0 where unknown.
    """

    key: Key
    image: AnyArray
    depth: Float32Array
    normal: FloatingArray
    label13: UInt8Array
    label40: UInt8Array
    rays: Float32Array


def load_samples(pictures: PhotographSet, numbers: Sequence[int], label: str) -> list[Sample]:
    """Read and resample the pictures with these numbers; raises `InputError` as `read` does."""
    samples = []
    with Progress(len(numbers), f"read {label}", "pictures") as progress:
        for photo in pictures.read(sorted(numbers)):
            samples.append(resampled(photo))
            progress.advance()
    return samples


def resampled(photo: Photograph) -> Sample:
    """Return a picture at the focal length `FOCAL`, colours averaged, truth of nearest pixels.

    Raises `InputError` for a camera with which the picture would be tiny or huge.
    """
    camera = photo.intrinsics
    height, width = photo.depth.shape
    sides = (width * FOCAL / camera.fx, height * FOCAL / camera.fy)
    if not (_SIDES[0] <= min(sides) and max(sides) <= _SIDES[1]):
        raise InputError(
            f"{photo.key.name}: {width}x{height} pixels at a focal length of {camera.fx:.0f} "
            "pixels; check the intrinsics"
        )
    w, h = round(sides[0]), round(sides[1])
    rows = ((np.arange(h) + 0.5) * height / h).astype(int)
    columns = ((np.arange(w) + 0.5) * width / w).astype(int)
    nearest = np.ix_(rows, columns)
    normal = photo.normal if photo.normal is not None else plane_normals(photo)
    none = np.zeros((h, w), np.uint8)
    labels = photo.classes13
    own = Intrinsics(
        camera.fx * w / width, camera.fy * h / height, camera.cx * w / width, camera.cy * h / height
    )
    return Sample(
        key=photo.key,
        image=_averaged(photo.image, w, h),
        depth=photo.depth[nearest],
        normal=normal[nearest].astype(np.float16),
        label13=none if labels is None else labels[nearest],
        label40=none if photo.label40 is None else photo.label40[nearest],
        rays=rays_of(own, w, h),
    )


def plane_normals(photo: Photograph) -> Float32Array:
    """Normals by plane fits of inverse depth, float32 (H, W, 3); 0 where no plane fits.

    On a plane, inverse depth is linear in the rays' x and y. A window counts if all of it has
    depth and one known label (where the set has labels), and lies within `RESIDUAL` of the plane.
    """
    depth, camera = photo.depth, photo.intrinsics
    rays = rays_of(camera, *depth.shape[::-1]).astype(np.float64)
    side = max(3, 2 * round(WINDOW * camera.fx / 2) + 1)
    there = depth > 0
    inverse = np.where(there, 1 / np.where(there, depth, 1), 0).astype(np.float64)
    terms = np.stack([rays[..., 0], rays[..., 1], np.ones_like(inverse)], -1)

    def mean(image: Float64Array) -> Float64Array:
        return ndimage.uniform_filter(image, side, mode="nearest")

    window = _uniform(photo, side, there)
    products = [mean(terms[..., i] * terms[..., j])[window] for i in range(3) for j in range(3)]
    left = np.stack(products, -1).reshape(-1, 3, 3)
    right = np.stack([mean(terms[..., i] * inverse)[window] for i in range(3)], -1)
    fit = np.linalg.solve(left, right[..., None])[..., 0]
    squared = mean(inverse**2)[window] - (fit * right).sum(-1)
    residual = np.sqrt(np.maximum(squared, 0)) * depth[window] ** 2
    length = np.linalg.norm(fit, axis=-1)
    flat = (residual < RESIDUAL) & (length > 0)
    normal = np.zeros((*depth.shape, 3), np.float32)
    window[window] = flat
    normal[window] = -fit[flat] / length[flat, None]
    return normal


def mirrored(sample: Sample) -> Sample:
    """Return a sample mirrored left to right."""
    turn = np.array([-1, 1, 1], np.float16)
    return Sample(
        key=sample.key,
        image=sample.image[:, ::-1],
        depth=sample.depth[:, ::-1],
        normal=sample.normal[:, ::-1] * turn,
        label13=sample.label13[:, ::-1],
        label40=sample.label40[:, ::-1],
        rays=sample.rays[:, ::-1] * turn[:2].astype(np.float32),
    )


class Pool:
    """Training samples of one set, drawn as crops of varied photographs."""

    def __init__(self, samples: Sequence[Sample], varied: bool, seed: int) -> None:
        """`varied`: whether rendered views are photographed with `varied_photograph`."""
        self.samples, self.varied, self.seed = samples, varied, seed
        self._taken: dict[tuple[int, int], UInt8Array] = {}
        for sample in samples:
            if sample.depth.shape[0] < CROP[0] or sample.depth.shape[1] < CROP[1]:
                found = "x".join(map(str, sample.depth.shape[::-1]))
                raise InputError(
                    f"{sample.key.name}: {found} pixels at the study's focal length, fewer than a "
                    f"crop of {CROP[1]}x{CROP[0]}; its field of view is too narrow to train on"
                )

    def draw(self, rng: Draw) -> Sample:
        """Draw a crop of `CROP`, mirrored with probability 1/2; the image is uint8 sRGB."""
        index, variation = rng.whole(len(self.samples)), rng.whole(VARIATIONS)
        sample = self.samples[index]
        top = rng.whole(sample.depth.shape[0] - CROP[0] + 1)
        left = rng.whole(sample.depth.shape[1] - CROP[1] + 1)
        here = (slice(top, top + CROP[0]), slice(left, left + CROP[1]))
        crop = Sample(
            key=sample.key,
            image=self._picture(index, variation)[here],
            depth=sample.depth[here],
            normal=sample.normal[here],
            label13=sample.label13[here],
            label40=sample.label40[here],
            rays=sample.rays[here],
        )
        return mirrored(crop) if rng.chance(0.5) else crop

    def _picture(self, index: int, variation: int) -> UInt8Array:
        """Return a photograph of a sample, kept once taken."""
        variation = variation if self.varied else 0
        if (index, variation) not in self._taken:
            self._taken[index, variation] = self._photograph(self.samples[index], variation)
        return self._taken[index, variation]

    def _photograph(self, sample: Sample, variation: int) -> UInt8Array:
        seed = derive(self.seed, sample.key.name, variation)
        if sample.image.dtype == np.uint8:
            return jittered(sample.image, seed) if self.varied else sample.image
        if not self.varied:
            return display(sample)
        return varied_photograph(sample.image, seed)


def display(sample: Sample) -> UInt8Array:
    """Return the picture of a sample in sRGB, uint8 (H, W, 3)."""
    camera = Intrinsics(FOCAL, FOCAL, 0, 0)
    return Photograph(
        key=sample.key, image=sample.image, depth=sample.depth, intrinsics=camera
    ).display


def jittered(picture: UInt8Array, seed: int) -> UInt8Array:
    """Return a photograph with brightness, contrast and white balance varied, uint8 sRGB."""
    rng = Draw(np.random.PCG64(seed))
    gains = 2 ** (rng.between(-0.35, 0.35) + rng.uniform(-0.1, 0.1, 3))
    power = 2 ** rng.between(-0.3, 0.3)
    values = np.clip(gains * (picture / 255.0) ** power, 0, 1)
    return (255 * values + 0.5).astype(np.uint8)


def _uniform(photo: Photograph, side: int, there: BoolArray) -> BoolArray:
    """Return where a window has depth everywhere and, with labels, one known label; (H, W)."""
    full = ndimage.minimum_filter(there, side, mode="constant", cval=False)
    labels = photo.label40 if photo.label40 is not None else photo.label13
    if labels is None:
        return full
    low = ndimage.minimum_filter(labels, side, mode="nearest")
    return full & (low > 0) & (low == ndimage.maximum_filter(labels, side, mode="nearest"))


def _averaged(image: AnyArray, width: int, height: int) -> AnyArray:
    """Return an image resampled by areas, of the same type; radiance as float32."""
    if image.shape[1::-1] == (width, height):
        return image
    size, box = (width, height), Image.Resampling.BOX
    if image.dtype == np.uint8:
        return np.asarray(Image.fromarray(image).resize(size, box))
    bands = [Image.fromarray(np.float32(image[..., band])).resize(size, box) for band in range(3)]
    return np.stack([np.asarray(band) for band in bands], -1)
