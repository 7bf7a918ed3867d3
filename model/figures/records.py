"""Reader of everything the stages have written; notes what is missing or damaged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet.model.figures.row_pictures import uri
from pbrnet.pipeline.channels import RADIANCE_SCALE, RADIANCES
from pbrnet.pipeline.dataset.parquet import check_types, images_of, open_parquet
from pbrnet.pipeline.images import Picture, fit, read_picture
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.checked import build, check_name
from pbrnet.scenes.contract import Scene, load_scene, scene_folders
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_bytes, read_csv, read_json

Result = TypeVar("Result")
METRICS = {
    "ssim": ("SSIM", True, 3),
    "psnr": ("PSNR (dB)", True, 2),
    "flip": ("ꟻLIP", False, 3),
    "lpips": ("LPIPS", False, 3),
}


@dataclass(frozen=True)
class Places:
    """Folders of the stages' outputs."""

    data: Path = Path("data")
    models: Path = Path("models")
    metrics: Path = Path("metrics")
    plots: Path = Path("plots")
    predictions: Path = Path("predictions")


class Records:
    """Outputs of all stages; `missing` has a sentence for each that is missing or damaged."""

    def __init__(self, places: Places) -> None:
        self.places = places
        self.missing: list[str] = []
        self._tables: dict[Path, list[dict[str, Any]]] = {}
        self.scenes: list[Scene] = self._readable(
            scene_folders(places.data / "scenes"),
            load_scene,
            "A scene cannot be read: ",
            "No scenes yet; make them with: pbrnet scenes",
        )
        self.cameras: list[Any] = self._readable(
            sorted((places.data / "cameras").glob("*.json")),
            load_cameras,
            "A camera file cannot be read: ",
            "No cameras yet; make them with: pbrnet cameras",
        )
        self.shards: list[pq.ParquetFile] = self._readable(
            sorted((places.data / "dataset").glob("*.parquet")),
            _open_shard,
            "",
            "No dataset yet; make it with: pbrnet dataset",
        )
        self.evaluation: dict[str, Any] = self.json(
            places.metrics / "evaluation.json", "No evaluation yet; make it with: pbrnet evaluate"
        )
        self.models = {
            path.stem: self.json(path, "") for path in sorted(places.models.glob("*.json"))
        }

    def json(self, path: Path, absent: str) -> dict[str, Any]:
        """Read a JSON object; empty, with a note, if the file is missing or damaged.

        `absent`: the note for a missing file; empty for none.
        """
        if not path.is_file():
            if absent:
                self.missing.append(absent)
            return {}
        try:
            content = read_json(path)
        except InputError as error:
            self.missing.append(str(error))
            return {}
        if not isinstance(content, dict):
            self.missing.append(f"{path} is damaged (not a JSON object); make it again")
            return {}
        return content

    def study(self, name: str, kind: type[Result], command: str = "") -> Result | None:
        """Read `metrics/studies/NAME.json` as `kind`; as `result`.

        `command`: command that writes it, if not `pbrnet study NAME`.
        """
        path = self.places.metrics / "studies" / f"{name}.json"
        return self.result(path, kind, command or f"pbrnet study {name}")

    def result(self, path: Path, kind: type[Result], command: str) -> Result | None:
        """Read a JSON file that `command` writes; None if missing, with a note if damaged."""
        content = self.json(path, "")
        if not content:
            return None
        try:
            return build(kind, content, str(path), InputError)
        except InputError as error:
            self.missing.append(f"{error}; make it again with: {command}")
            return None

    def study_picture(self, name: str, width: int | None = 1200, png: bool = False) -> str:
        """Return `metrics/studies/NAME.png` as a data URI; an empty string if missing or damaged.

        `width`: largest width in pixels, None to keep the size; `png`: as PNG, without loss.
        """
        path = self.places.metrics / "studies" / f"{name}.png"
        picture = self._picture(path, f"pbrnet study {name}")
        if picture is None:
            return ""
        return uri(picture if width is None else fit(picture, width), png=png)

    def csv(self, path: Path, *numbers: str) -> list[dict[str, Any]]:
        """Read the lines of a CSV file; the columns `numbers` as floats, None where empty.

        Empty if the file is missing, or damaged, which is noted once.
        """
        if path not in self._tables:
            self._tables[path] = []
            if path.is_file():
                try:
                    self._tables[path] = _read_csv(path, numbers)
                except (InputError, KeyError, ValueError) as error:
                    self.missing.append(f"{path} is damaged ({error}); make it again")
        return self._tables[path]

    def _index(self) -> list[tuple[str, str]]:
        """Return (scene_id, view_id) of all rows, in the order of the shards."""
        keys = []
        for shard in self.shards:
            table = shard.read(columns=["scene_id", "view_id"])
            keys += list(
                zip(table["scene_id"].to_pylist(), table["view_id"].to_pylist(), strict=True)
            )
        return keys

    def spread(self, count: int) -> list[tuple[str, str]]:
        """Return at most `count` keys of rows, spread evenly over all scenes."""
        keys = sorted(self._index())
        if not keys:
            return []
        places = np.unique(np.linspace(0, len(keys) - 1, min(count, len(keys))).round())
        return [keys[int(place)] for place in places]

    def rows(self, wanted: set[tuple[str, str]]) -> dict[tuple[str, str], dict[str, Any]]:
        """Read the `wanted` rows, images as arrays, one row group at a time."""
        rows = {}
        for shard in self.shards:
            for group in range(shard.num_row_groups):
                ids = shard.read_row_group(group, columns=["scene_id", "view_id"]).to_pylist()
                chosen = [
                    index
                    for index, row in enumerate(ids)
                    if (row["scene_id"], row["view_id"]) in wanted
                ]
                if chosen:
                    table = shard.read_row_group(group).take(chosen)
                    for row in _unpack(table, self.places.data / "dataset"):
                        rows[row["scene_id"], row["view_id"]] = row
        return rows

    def scores(self) -> list[dict[str, Any]]:
        """Return the lines of `metrics/evaluation.csv`."""
        return self.csv(self.places.metrics / "evaluation.csv", *METRICS)

    def example_keys(self) -> dict[str, list[tuple[str, str]]]:
        """Return the keys of the best and worst views of the evaluation."""
        chosen = self.evaluation.get("examples", {})
        return {
            group: [(str(key[0]), str(key[1])) for key in chosen.get(group, []) if len(key) == 2]
            for group in ("best", "worst")
        }

    def example_picture(self, scene_id: str, view_id: str, part: str) -> Picture | None:
        """Read a picture of an example view; None if missing or damaged."""
        path = self.places.metrics / "examples" / f"{scene_id}--{view_id}--{part}.png"
        return self._picture(path, "pbrnet evaluate", scene_id, view_id)

    def _picture(self, path: Path, command: str, *names: str) -> Picture | None:
        """Read a picture that `command` writes; None if missing, with a note if damaged.

        `names` are parts of its path from outside.
        """
        try:
            for name in names:
                check_name(name, "the name of an example", error=InputError)
            return read_picture(read_bytes(path)) if path.is_file() else None
        except (InputError, OSError, ValueError):
            note = f"{path} is damaged; make it again with: {command}"
            if note not in self.missing:
                self.missing.append(note)
            return None

    def _readable(
        self, paths: Sequence[Path], read: Callable[[Path], Result], damaged: str, absent: str
    ) -> list[Result]:
        """Read files; note those that cannot be read, and that there are none."""
        found = []
        for path in paths:
            try:
                found.append(read(path))
            except InputError as error:
                self.missing.append(f"{damaged}{error}")
        if not found:
            self.missing.append(absent)
        return found


def _open_shard(path: Path) -> pq.ParquetFile:
    shard = open_parquet(path)
    check_types(path, shard.schema_arrow, shard.schema_arrow.names)
    return shard


def _read_csv(path: Path, numbers: Sequence[str]) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = [*read_csv(path)]
    for line in lines:
        for name in numbers:
            line[name] = float(line[name]) if line[name] else None
    return lines


def _unpack(table: pa.Table, folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a table, images as arrays of their shape.

    Radiance is in the renderer's unit.
    """
    about = {field.name: field.metadata or {} for field in table.schema}
    images = [name for name, facts in about.items() if b"dtype" in facts]
    matrices = [name for name, facts in about.items() if b"shape" in facts and name not in images]
    rows: list[dict[str, Any]] = table.drop_columns(images).to_pylist()
    for row in rows:
        row.update({name: np.array(row[name]) for name in matrices if row[name] is not None})
    for name in images:
        for row, image in zip(rows, images_of(folder, table, name), strict=True):
            if name in RADIANCES:
                image = image.astype(np.float32) * np.float32(row.get(RADIANCE_SCALE, 1))
            row[name] = image
    return rows
