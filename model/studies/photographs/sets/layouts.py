"""Layouts of sets of pictures, and the opening of a set by its path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pbrnet.model.studies.photographs.sets.contract import PhotographSet, Purpose
from pbrnet.model.studies.photographs.sets.folders import FolderSet, is_folder_set
from pbrnet.model.studies.photographs.sets.hypersim import Hypersim, is_hypersim
from pbrnet.model.studies.photographs.sets.nyu_file import NyuFile, is_nyu_file
from pbrnet.model.studies.photographs.sets.packed import PackedViews, is_packed
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import exists

# Test of a path, and the reader of the layout that it has.
LAYOUTS: tuple[tuple[Callable[[Path], bool], Callable[[Path, Purpose], PhotographSet]], ...] = (
    (is_nyu_file, NyuFile),
    (is_hypersim, Hypersim),
    (is_folder_set, FolderSet),
    (is_packed, PackedViews),
)


def open_set(path: Path, purpose: Purpose) -> PhotographSet:
    """Open the set at a path, of whichever layout, for training or for testing.

    Raises `InputError` for a path of no layout, and as the readers do.
    """
    if not exists(path):
        raise InputError(f"{path}: no such file or folder")
    for fits, reader in LAYOUTS:
        if fits(path):
            return reader(path, purpose)
    raise InputError(
        f"{path}: no set of pictures; expected nyu_depth_v2_labeled.mat, a folder with rgb and "
        "depth, Hypersim's folder, or a packed data set"
    )
