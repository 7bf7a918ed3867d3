"""Pictures with their truth, and the interface of the sets that hold them.

A set is opened by `layouts.open_set`. A reader of another layout is a class with the members of
`PhotographSet` and a line in `layouts.LAYOUTS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from pbrnet.pipeline.photograph import photograph
from pbrnet.scenes.arrays import AnyArray, Float32Array, UInt8Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes
from pbrnet.scenes.importing.semantics import NYU13_OF_NYU40

Purpose = Literal["train", "test"]  # which pictures of a set: those to train on, those to test on
THIRTEEN = np.array(NYU13_OF_NYU40, np.uint8)
MAX_SIDE = 8192  # pixels


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera in pixels: focal lengths and principal point, pixel centres at +0.5."""

    fx: float
    fy: float
    cx: float
    cy: float


@lru_cache(maxsize=64)  # thousands of views have one camera
def rays_of(camera: Intrinsics, width: int, height: int) -> Float32Array:
    """Return x and y of the rays with z = 1 through all pixels, float32 (height, width, 2)."""
    x = (np.arange(width) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(height) + 0.5 - camera.cy) / camera.fy
    return np.stack(np.meshgrid(x, y), -1).astype(np.float32)


@dataclass(frozen=True)
class Key:
    """Name of a picture in its set, and its run: the cluster of pictures it belongs to."""

    name: str
    run: str


@dataclass(frozen=True, kw_only=True)
class Photograph:
    """A picture with its truth; all images have its height and width.

    `image`: uint8 (H, W, 3) in sRGB, or for rendered sets float (H, W, 3), linear radiance.
    `depth`: float32 (H, W), z-depth in metres, 0 where unknown. `normal`: float32 (H, W, 3), unit
    vectors towards the camera in its axes (x right, y down, z forward), 0 where unknown; None if
    they must be fitted to the depth. `label40`, `label13`: uint8 (H, W), classes of NYU40 and
    NYU13, 0 where unknown; None if the set has none.
    """

    key: Key
    image: AnyArray
    depth: Float32Array
    intrinsics: Intrinsics
    normal: Float32Array | None = None
    label40: UInt8Array | None = None
    label13: UInt8Array | None = None

    @property
    def display(self) -> UInt8Array:
        """The picture in sRGB, uint8 (H, W, 3); radiance as an automatic camera would take it."""
        return self.image if self.image.dtype == np.uint8 else photograph(self.image)

    @property
    def classes13(self) -> UInt8Array | None:
        """Classes of NYU13, those of NYU40 mapped where there are any; None without labels."""
        return self.label13 if self.label40 is None else THIRTEEN[self.label40]


class PhotographSet(Protocol):
    """Set of pictures with truth, of which only the names are in memory."""

    path: Path

    @property
    def keys(self) -> Sequence[Key]:
        """Names and runs of all pictures."""
        ...

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read the pictures with these numbers, places in `keys`, in rising order.

        Raises `InputError` for a damaged picture.
        """
        ...

    def fingerprint(self) -> str:
        """Return a digest that changes when files of the set are replaced."""
        ...


def listing_digest(paths: Iterable[Path], *more: str) -> str:
    """Return a digest of names and sizes of files, which must exist, and of further texts."""
    facts = [f"{path.name} {path.stat().st_size}" for path in sorted(paths)]
    return digest_bytes(*(one.encode() for one in (*facts, *more)))


def checked(photo: Photograph) -> Photograph:
    """Return the picture, its unusable depths set to 0 and its unknown classes, too.

    Raises `InputError` for images of different sizes, or of a size that no picture has.
    """
    height, width = photo.depth.shape[:2]
    if not (0 < height <= MAX_SIDE and 0 < width <= MAX_SIDE):
        raise InputError(f"{photo.key.name}: {width}x{height} pixels; at most {MAX_SIDE} a side")
    others = (photo.image, photo.normal, photo.label40, photo.label13)
    for image in others:
        if image is not None and image.shape[:2] != (height, width):
            found = "x".join(str(side) for side in image.shape[1::-1])
            raise InputError(
                f"{photo.key.name}: images of {found} and {width}x{height} pixels; picture, depth "
                "and labels need the same size"
            )
    photo.depth[~(np.isfinite(photo.depth) & (photo.depth > 0))] = 0
    for labels, count in ((photo.label40, 40), (photo.label13, 13)):
        if labels is not None:
            labels[labels > count] = 0
    return photo
