"""Hostile sets of pictures, as the study of photographs reads them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link, with_value
from tests.hostile.mutations import damaged_bytes, damaged_json, damaged_text

NYU_FILE = "nyu/set.mat"
FOLDER, NYU, HYPERSIM = (
    f"study photographs {test} --row a={train} --dry-run"
    for test, train in (("set", "set"), (NYU_FILE, "set"), ("hyper", "set"))
)
ROWS = "study photographs set --rows rows.yaml --dry-run"
_DEPTH = "hyper/ai_001_001/images/scene_cam_00_geometry_hdf5/frame.0000.depth_meters.hdf5"
_CAMERAS = "hyper/metadata_camera_parameters.csv"


def _sets(folder: Path) -> None:
    from tests.fixtures.photographs import folder_set, hypersim_set, nyu_file

    folder_set(folder / "set", 2)
    nyu_file(folder / "nyu").rename(folder / NYU_FILE)
    hypersim_set(folder / "hyper", 1)
    (folder / "rows.yaml").write_text("- {name: a, train: [[set@1], [hyper]], varied: false}\n")


@case
def _hdf5(
    folder: Path, name: str, make: Callable[[Any], Any], path: str = NYU_FILE, command: str = NYU
) -> str:
    """A file whose array `name` is another one, made from the open file."""
    import h5py

    with h5py.File(folder / path, "a") as file:
        found = make(file)
        del file[name]
        if found is not None:
            file[name] = found
    return command


@case
def _huge(folder: Path, name: str, path: str, command: str) -> str:
    """An array that claims 2^40 values, none of them stored."""
    import h5py

    with h5py.File(folder / path, "a") as file:
        del file[name]
        file.create_dataset(name, (2**20, 2**20), "f4", chunks=(64, 64))
    return command


def _external(file: Any) -> Any:
    import h5py

    return h5py.ExternalLink("/etc/passwd", "/depths")


def _rows(text: str) -> Made:
    return with_file("rows.yaml", text, ROWS)


FAMILIES = (
    Family(
        "sets of photographs",
        90,
        _sets,
        (
            Victim("set/rgb/0.png", damaged_bytes, (FOLDER,)),
            Victim("set/depth/0.png", damaged_bytes, (FOLDER,)),
            Victim("set/label40/0.png", damaged_bytes, (FOLDER,)),
            Victim("set/intrinsics.json", damaged_json, (FOLDER,)),
            Victim("set/test.csv", damaged_text, (FOLDER,)),
            Victim(NYU_FILE, damaged_bytes, (NYU,)),
            Victim("nyu/splits.mat", damaged_bytes, (NYU,)),
            Victim(_DEPTH, damaged_bytes, (HYPERSIM,)),
            Victim(_CAMERAS, damaged_text, (HYPERSIM,)),
            Victim("rows.yaml", damaged_text, (ROWS,)),
        ),
        (
            with_link("set/rgb/0.png", "/dev/zero", FOLDER),
            with_link("set/depth/0.png", "0.png", FOLDER),
            with_value("set/intrinsics.json", FOLDER, ("fx",), 1e308),
            with_value("set/intrinsics.json", FOLDER, ("fx",), 1e-308),
            with_value("set/intrinsics.json", FOLDER, ("cx",), 10**400),
            with_file("set/train.txt", "../../etc/passwd\n", FOLDER),
            with_file("set/train.txt", "", FOLDER),
            with_link(NYU_FILE, "/dev/zero", NYU),
            with_file("nyu/classMapping40.mat", "x", NYU),
            _hdf5("depths", lambda file: None),
            _hdf5("depths", _external),
            _hdf5("depths", lambda file: np.full((2, 640, 480), np.nan, np.float32)),
            _hdf5("images", lambda file: np.zeros((2, 4, 640, 480), np.uint8)),
            _hdf5("scenes", lambda file: np.zeros((1, 2), np.uint8)),
            _huge("dataset", _DEPTH, HYPERSIM),
            _hdf5("dataset", lambda file: np.full((30, 40), "x", "S4"), _DEPTH, HYPERSIM),
            _hdf5("dataset", lambda file: np.full((30, 40), -1.0), _DEPTH, HYPERSIM),
            _rows("[]"),
            _rows("- {name: '', train: [[set]]}"),
            _rows("- {name: a, train: []}"),
            _rows("- {name: a, train: [[set@0]]}"),
            _rows("- {name: a, train: [[set@999]]}"),
            _rows("- &a {name: a, train: *a}"),
            _rows("[" * 5000),
        ),
        seconds=0.4,
    ),
)
