"""Sets in folders of image files: `rgb`, `depth` and `label40` or `label13`.

    intrinsics.json           fx, fy, cx, cy in pixels; may be absent for NYU Depth v2, see below
    rgb/NAME.jpg or .png      the pictures
    depth/NAME.png            16 bits, z-depth in millimetres, 0 where unknown
    label40/NAME.png          8 bits, class of NYU40, 0 or 255 where unknown; or label13; optional
    train.txt, test.csv       names to train on, a line each; names and runs to test on; optional

`test.csv` has the columns `name` and, for the clusters of the intervals, `run`. Without lists all
pictures serve both purposes. A folder with `test.csv` and without `intrinsics.json` is taken for
NYU Depth v2, cropped to the 560 columns and 426 rows without a frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pbrnet.model.studies.photographs.sets.contract import (
    Intrinsics,
    Key,
    Photograph,
    Purpose,
    checked,
    listing_digest,
)
from pbrnet.scenes.arrays import AnyArray, UInt8Array
from pbrnet.scenes.checked import build, check_name
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, read_csv, read_json, read_text, regular_file
from pbrnet.scenes.image_files import UnreadableImage, open_image

# NYU Depth v2 (Silberman et al. 2012): camera of 640x480 pixels, and the part without a frame.
NYU_CAMERA = Intrinsics(518.86, 519.47, 325.58, 253.74)
NYU_LEFT, NYU_TOP, NYU_WIDTH, NYU_HEIGHT = 41, 45, 560, 426
_PICTURES = (".jpg", ".jpeg", ".png")


def is_folder_set(path: Path) -> bool:
    """Return whether a path is a folder of this layout."""
    return (path / "rgb").is_dir() and (path / "depth").is_dir()


class FolderSet:
    """Reader of this layout; raises `InputError` for an empty or incomplete folder."""

    def __init__(self, path: Path, purpose: Purpose) -> None:
        self.path = path
        self._files = {
            file.stem: file
            for file in sorted((path / "rgb").iterdir())
            if file.suffix.lower() in _PICTURES
        }
        self.keys = self._listed(purpose)
        if not self.keys:
            raise InputError(f"{path}: no pictures to {purpose} on")
        self._labels = [name for name in ("label40", "label13") if (path / name).is_dir()][:1]

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read pictures as `PhotographSet.read` does."""
        for number in numbers:
            yield self._read(self.keys[number])

    def fingerprint(self) -> str:
        """Return the digest of names and sizes of pictures, depths and labels, and the camera."""
        names = [key.name for key in self.keys]
        files = (
            self.path / kind / f"{name}.png" for kind in ("depth", *self._labels) for name in names
        )
        camera = self.path / "intrinsics.json"
        return listing_digest(
            [*(self._files[name] for name in names), *filter(Path.is_file, files)],
            *([digest_file(camera)] if camera.is_file() else []),
        )

    def _listed(self, purpose: Purpose) -> list[Key]:
        """Names and runs of the pictures for this purpose."""
        train, test = self.path / "train.txt", self.path / "test.csv"
        if purpose == "test" and test.is_file():
            lines = read_csv(test)
            if lines and "name" not in lines[0]:
                raise InputError(f"{test}: no column 'name'")
            keys = [Key(line["name"], line.get("run", line["name"])) for line in lines]
        elif purpose == "train" and train.is_file():
            keys = [Key(name, name) for name in read_text(train).split()]
        else:
            keys = [Key(name, name) for name in self._files]
        for key in keys:
            check_name(key.name, "the name of a picture", str(self.path), InputError)
            if key.name not in self._files:
                raise InputError(f"{self.path / 'rgb' / key.name}: no such picture; it is listed")
        return keys

    def _read(self, key: Key) -> Photograph:
        image = _opened(self._files[key.name], "RGB")
        height, width = image.shape[:2]
        depth = _opened(self.path / "depth" / f"{key.name}.png", "I")
        labels: dict[str, UInt8Array] = {
            name: _opened(self.path / name / f"{key.name}.png", "L") for name in self._labels
        }
        return checked(
            Photograph(
                key=key,
                image=image,
                depth=(depth / 1000).astype(np.float32),
                intrinsics=self._intrinsics(width, height),
                label40=labels.get("label40"),
                label13=labels.get("label13"),
            )
        )

    def _intrinsics(self, width: int, height: int) -> Intrinsics:
        file = self.path / "intrinsics.json"
        if file.is_file():
            camera = build(Intrinsics, read_json(file), str(file), InputError)
            if min(camera.fx, camera.fy) <= 0:
                raise InputError(f"{file}: fx and fy must be above 0")
            return camera
        if not (self.path / "test.csv").is_file():
            raise InputError(f"{file}: no such file; it states fx, fy, cx, cy in pixels")
        return nyu_intrinsics(width, height)


def nyu_intrinsics(width: int, height: int) -> Intrinsics:
    """Return the camera of a picture of NYU Depth v2, cropped to the part without a frame."""
    x, y = width / NYU_WIDTH, height / NYU_HEIGHT
    camera = NYU_CAMERA
    cx, cy = (camera.cx - NYU_LEFT) * x, (camera.cy - NYU_TOP) * y
    return Intrinsics(camera.fx * x, camera.fy * y, cx, cy)


def _opened(file: Path, mode: str) -> AnyArray:
    """Return the pixels of an image file; `mode` is RGB, L for labels or I for depth."""
    regular_file(file)
    try:
        image = open_image(file, upright=mode == "RGB")
        if mode == "I" and not image.mode.startswith("I"):
            raise UnreadableImage(f"pixels of type {image.mode}; expected 16 bits, millimetres")
        if mode == "L" and image.mode not in ("L", "P"):
            raise UnreadableImage(f"pixels of type {image.mode}; expected classes of 8 bits")
        return np.array(image if mode != "RGB" else image.convert("RGB"))
    except (InputError, OSError) as error:
        raise InputError(f"{file}: {error}") from None
