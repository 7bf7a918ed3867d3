"""Check of a dataset by rendering random rows anew: of a copy that someone else made, say.

Only the scenes of the drawn rows are made, and only the drawn views rendered, where no row depends
on other views. Surfaces (`pbrnet.pipeline.channels.SURFACES`), cameras and texts must be equal to
the bit. Images of light, whose last bits depend on the processor's instruction set, may deviate by
`BOUND`, far less than another seed or one sample more would change them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.cameras.settings import CameraParams
from pbrnet.pipeline.channels import SURFACES, dataset_channels
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.export.rows import DatasetRows, ViewRow
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.splits import SplitParams
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.views import load_cameras, save_cameras
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, read_csv
from pbrnet.scenes.seeds import generator

BOUND = 0.01  # mean deviation of an image of light, relative to its mean
_EXACT = frozenset(one.name for one in dataset_channels() if one.kind in SURFACES)


@dataclass(frozen=True)
class Verdict:
    """Outcome of a check: rows by outcome, and what is wrong by the name of the row."""

    equal: int  # to the bit
    close: int  # light within `BOUND`, all else equal
    largest: float  # deviation among those
    faults: Mapping[str, str]

    @property
    def lines(self) -> list[str]:
        """Lines for the terminal."""
        total = self.equal + self.close + len(self.faults)
        found = f"{self.equal} of {total} rows equal to the bit"
        if self.close:
            found += f", {self.close} with light within {self.largest:.2g} of its mean"
        return [found, *(f"{name}: {fault}" for name, fault in self.faults.items())]


def verify_rows(
    dataset: Path, params: Params, count: int, seed: int, work: Path, scheduler: str | None
) -> Verdict:
    """Render `count` random rows of a dataset's folder anew below `work` and compare them.

    `params` are those of its recipe; `seed` draws the rows. A check that was cut off goes on.
    Raises `InputError` for a damaged dataset, and `StageError` if a stage fails.
    """
    given = DatasetRows(dataset)
    rng = generator(seed, "verify")
    numbers = rng.choice(len(given.rows), min(count, len(given.rows)), replace=False)
    drawn = [given.rows[number] for number in sorted(numbers.tolist())]
    plans = _plans(dataset, params.cameras)
    deviations, faults = list[float](), dict[str, str]()
    names = digest_bytes(*(row.name.encode() for row in drawn))[:12]
    for part, rows in _by_sampling(drawn).items():
        folder = work / names / part  # a camera file holds the drawn views alone
        _render(folder, params, rows, plans, scheduler)
        again = DatasetRows(folder / "dataset")
        for row, deviation, fault in _compared(given, again, rows):
            if fault:
                faults[row.name] = fault
            else:
                deviations.append(deviation)
    close = [each for each in deviations if each > 0]
    return Verdict(len(deviations) - len(close), len(close), max(close, default=0.0), faults)


def _plans(dataset: Path, cameras: CameraParams) -> dict[str, str]:
    """Return the plan of each scene if scenes of one plan share cameras; else nothing."""
    path = dataset / "scenes.csv"
    if not cameras.share_cameras:
        return {}
    if not path.is_file():
        raise InputError(f"{path}: no such file; cameras.share_cameras needs the plans in it")
    return {row["scene_id"]: row["plan"] for row in read_csv(path)}


def _by_sampling(rows: Sequence[ViewRow]) -> dict[str, list[ViewRow]]:
    """Return the rows of test views, and of the others, whose samples may be fewer."""
    parts = {"test": [row for row in rows if row.split == "test"]}
    parts["train"] = [row for row in rows if row.split != "test"]
    return {name: rows for name, rows in parts.items() if rows}


def _render(
    folder: Path,
    params: Params,
    rows: Sequence[ViewRow],
    plans: Mapping[str, str],
    scheduler: str | None,
) -> None:
    """Make the scenes of the rows, render their views and pack them.

    All rows are of test views, which never have fewer samples, or none is. One split takes them
    all: those of a few scenes would differ from those of the whole dataset.
    """
    params = replace(params, dataset=replace(params.dataset, splits=SplitParams(0.0, 0.0)))
    if rows[0].split == "test":
        params = replace(
            params,
            groundtruth=replace(params.groundtruth, train_spp=0),
            noisy=replace(params.noisy, train=()),
        )
    scenes = {row.scene_id for row in rows}
    shared = {plans[name] for name in scenes if name in plans}
    scenes |= {name for name, plan in plans.items() if plan in shared}
    run_scenes(folder, params, scheduler, scenes)
    run_cameras(folder, params, scheduler)
    if not _joined(params.cameras):
        names = {row.name for row in rows}
        for path in sorted((folder / "cameras").glob("*.json")):
            file = load_cameras(path)
            views = [one for one in file.views if "/".join(one.name) in names]
            save_cameras(path, replace(file, views=tuple(views)))
    for stage in ("inputs", "illumination", "groundtruth"):
        run_frames(stage, folder, params, scheduler)
    pack_dataset(folder, params)


def _joined(cameras: CameraParams) -> bool:
    """Test whether rows depend on other views of their scene: walks, pairs and overlapping sets."""
    return bool(
        cameras.walks or cameras.stereo_baseline or cameras.overlap_views or cameras.trajectories
    )


def _compared(
    given: DatasetRows, again: DatasetRows, rows: Sequence[ViewRow]
) -> Iterator[tuple[ViewRow, float, str]]:
    """Yield for each row the deviation of its light and what is wrong, if anything."""
    made = {row.name: row for row in again.rows}
    images = given.image_names()
    missing = sorted({*images} ^ {*again.image_names()})
    # The split is that of the whole dataset; previews are drawn from the other cells.
    left = {name for name in given.columns if name == "split" or name.startswith("preview")}
    values = sorted((given.columns & again.columns) - left - {*images})
    for row in rows:
        if missing or row.name not in made:
            columns = f"images on one side only: {', '.join(missing)}"
            yield row, 0.0, columns if missing else "no accepted view of the recipe"
            continue
        (_, one), (_, two) = (
            next(each.read([own], images, values))
            for each, own in ((given, row), (again, made[row.name]))
        )
        faults = [name for name in values if not _same(name, one.values[name], two.values[name])]
        worst = 0.0
        for name in images:
            deviation = _deviation(one.images[name], two.images[name])
            if deviation > (0 if name in _EXACT else BOUND):
                faults.append(name)
            worst = max(worst, deviation)
        yield row, worst, f"other {', '.join(faults)}" if faults else ""


def _same(name: str, one: Any, two: Any) -> bool:
    """Test whether two cells of a column are equal; numbers and noise, within `BOUND`.

    The renderer's last part, the instruction set, may differ.
    """
    if name == "renderer":
        return bool(one.rpartition(", ")[0] == two.rpartition(", ")[0])
    if name == "noise_lights" and one is not None and two is not None:
        return len(one) == len(two) and np.allclose(one, two, rtol=BOUND, atol=0)
    numbers = isinstance(one, float) and isinstance(two, float)
    return bool(one == two or (numbers and math.isclose(one, two, rel_tol=BOUND)))


def _deviation(one: AnyArray, two: AnyArray) -> float:
    """Mean absolute difference of images, relative to the first's mean; 0 for equal bits."""
    if one.shape != two.shape:
        return math.inf
    if np.array_equal(one, two, equal_nan=one.dtype.kind == "f"):
        return 0.0
    first, second = one.astype(np.float64), two.astype(np.float64)
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return math.inf
    difference = float(np.abs(first - second).mean())
    return difference / max(float(np.abs(first).mean()), 1e-30)
