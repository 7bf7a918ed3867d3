"""NYU Depth v2 as published: `nyu_depth_v2_labeled.mat`, with `splits.mat` beside it.

`splits.mat` has the official numbers of training and test pictures. `classMapping40.mat`, if it is
there, maps the 894 classes to NYU40; without it only classes that have the name of one of NYU40
count, and all others are unknown. Pictures are cropped to the part without a white frame.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from pbrnet.model.studies.photographs.sets.contract import (
    Key,
    Photograph,
    Purpose,
    checked,
    listing_digest,
)
from pbrnet.model.studies.photographs.sets.folders import (
    NYU_HEIGHT,
    NYU_LEFT,
    NYU_TOP,
    NYU_WIDTH,
    nyu_intrinsics,
)
from pbrnet.model.studies.photographs.sets.hdf5 import member, open_hdf5, whole
from pbrnet.scenes.arrays import AnyArray, UInt8Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import exists, read_bytes
from pbrnet.scenes.importing.semantics import NYU40_NAMES

_MAX_MAT = 2**24  # bytes of the small files
_MAX_NAMES = 10_000
_OTHER_SPELLINGS = {"refridgerator": "refrigerator", "book": "books"}


def is_nyu_file(path: Path) -> bool:
    """Return whether a path is that of the labelled set."""
    return path.suffix == ".mat"


class NyuFile:
    """Reader of the labelled set; raises `InputError` for a missing or damaged file."""

    def __init__(self, path: Path, purpose: Purpose) -> None:
        self.path = path
        with open_hdf5(path) as file:
            runs = _texts(file, "scenes")
            names = _texts(file, "names")
            count = len(member(file, "images", (None, 3, 640, 480), "u"))
        if len(runs) != count:
            raise InputError(f"{path}: {len(runs)} scenes of {count} images")
        self._numbers = _split(path.with_name("splits.mat"), purpose, count)
        self.keys = [Key(f"{number:04d}", runs[number]) for number in self._numbers]
        mapping = path.with_name("classMapping40.mat")
        self._mapping = mapping if exists(mapping) else None
        self._class = _mapped(names) if self._mapping is None else _read_mapping(mapping)

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read pictures as `PhotographSet.read` does."""
        with open_hdf5(self.path) as file:
            images = member(file, "images", (None, 3, 640, 480), "u")
            depths = member(file, "depths", (None, 640, 480), "f")
            labels = member(file, "labels", (None, 640, 480), "u")
            for number in numbers:
                place = self._numbers[number]
                classes = _cropped(labels[place])
                known = classes < len(self._class)
                yield checked(
                    Photograph(
                        key=self.keys[number],
                        image=_cropped(images[place]),
                        depth=_cropped(depths[place]).astype(np.float32),
                        intrinsics=nyu_intrinsics(NYU_WIDTH, NYU_HEIGHT),
                        label40=np.where(known, self._class[np.where(known, classes, 0)], 0).astype(
                            np.uint8
                        ),
                    )
                )

    def fingerprint(self) -> str:
        """Return the digest of the files' names and sizes, and of the chosen pictures."""
        files = [self.path, *([self._mapping] if self._mapping else [])]
        return listing_digest(files, *(key.name for key in self.keys))


def _cropped(image: AnyArray) -> AnyArray:
    """Return an image (..., W, H) of the file as (h, w, ...), without the frame."""
    turned = np.ascontiguousarray(np.transpose(image))
    return turned[NYU_TOP : NYU_TOP + NYU_HEIGHT, NYU_LEFT : NYU_LEFT + NYU_WIDTH].copy()


def _texts(file: Any, name: str) -> list[str]:
    """Read a cell array of texts, stored as references to arrays of characters."""
    references = whole(file, name, (1, None), "O")[0]
    if len(references) > _MAX_NAMES:
        raise ValueError(f"{len(references)} entries of {name!r}")
    return ["".join(map(chr, np.ravel(file[one][()])[:200])) for one in references]


def _split(path: Path, purpose: Purpose, count: int) -> list[int]:
    """Read the official numbers of a split, from 0."""
    if not exists(path):
        raise InputError(f"{path}: no such file; NYU Depth v2 offers it beside the labelled set")
    found = _read_mat(path, f"{purpose}Ndxs")
    numbers = sorted(int(one) - 1 for one in np.ravel(found))
    if not numbers or numbers[0] < 0 or numbers[-1] >= count:
        raise InputError(f"{path}: numbers outside 1 to {count}")
    return numbers


def _mapped(names: list[str]) -> UInt8Array:
    """Return the NYU40 class of every label by the names of the classes; label 0 is unknown."""
    spelled = [_OTHER_SPELLINGS.get(name, name) for name in names]
    known = {name: number for number, name in enumerate(NYU40_NAMES) if name}
    return np.array([0, *(known.get(name, 0) for name in spelled)], np.uint8)


def _read_mapping(path: Path) -> UInt8Array:
    mapping = np.ravel(_read_mat(path, "mapClass")).astype(int)
    if not mapping.size or mapping.min() < 0 or mapping.max() > 40:
        raise InputError(f"{path}: classes outside 1 to 40")
    return np.array([0, *mapping], np.uint8)


def _read_mat(path: Path, name: str) -> AnyArray:
    """Read a numeric array of a small file of MATLAB's version 5."""
    try:
        found = loadmat(io.BytesIO(read_bytes(path, _MAX_MAT)), variable_names=[name])[name]
        return np.asarray(found, np.float64)
    except InputError:
        raise
    except Exception as error:  # the reader raises what damaged files lead it to
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: damaged, or without {name!r} ({reason})") from None
