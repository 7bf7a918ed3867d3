"""The dataset stage: check every view's frames and pack them into Parquet shards.

Reads `data/scenes`, `data/cameras` and the frames; writes `data/dataset/`, which
is complete or absent: shards by split, a README card, `croissant.json`, `rejected.csv` (views
sampled = rows + rejected) and `scenes.csv` (every scene, also those without any view).

The same frames and parameters give the same bytes, whatever the number of threads. Memory is
bounded by one row group per split and a few views in preparation, whatever the number of views.
"""

from __future__ import annotations

import csv
import os
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.card import (
    DatasetSummary,
    attribution_of,
    dataset_card,
    licence_of,
    write_croissant,
)
from pipeline.checks import (
    Frames,
    Rejection,
    check_frames,
    kinds_of,
    load_frames,
    noise_of,
    read_failures,
)
from pipeline.columns import Column, arrow_schema, dataset_columns
from pipeline.frames import DENOISED, DENOISED_SHADING, NOISY_SHADING, RGB, Frame
from pipeline.params import Params, SplitParams, ToneParams
from pipeline.pictures import fit, png_bytes, tone_picture
from pipeline.progress import Progress
from pipeline.records import data_lock
from pipeline.sums import write_sums
from pipeline.tonemap import exposure_of
from pipeline.views import CameraFile, View, load_cameras
from scenes.contract import Scene, load_scene, scene_folders
from scenes.errors import InputError
from scenes.files import atomic_directory, remove_partials, write_text
from scenes.seeds import derive

A = TypeVar("A")
B = TypeVar("B")
SPLITS = ("train", "validation", "test")
# Text columns whose values recur from row to row.
REPEATED = (
    "scene_id",
    "split",
    "room_type",
    "lighting",
    "renderer",
    "source",
    "licence",
    "attribution",
)


@dataclass(frozen=True)
class Source:
    """A scene with its camera file, None where the cameras stage left none."""

    scene: Scene
    cameras: CameraFile | None

    @property
    def plan(self) -> str:
        """Scenes of one plan stay in one split."""
        return self.scene.plan or self.scene.scene_id

    @property
    def views(self) -> list[View]:
        """Views sampled in it, sorted by id."""
        views = self.cameras.views if self.cameras else ()
        return sorted(views, key=lambda view: view.view_id)


@dataclass(frozen=True)
class Rejected:
    """A view that is not in the dataset."""

    view: View
    why: Rejection


@dataclass(frozen=True)
class Packed:
    """What one pass over all views wrote."""

    files: tuple[str, ...]  # shard names, sorted
    rows: Counter[str]  # per scene
    rejected: tuple[Rejected, ...]
    unlit: int  # rows whose panorama holds no light


def pack_dataset(data: Path, params: Params) -> DatasetSummary:
    """Check and pack all views below `data`; `data/dataset` appears by rename.

    Raises `InputError` if there are no views, if none passes the checks, or if a scene or
    camera file is broken, and `MachineError` if the disk is full.
    """
    data = Path(data)
    with data_lock(data, "dataset"):
        return _pack_dataset(data, params)


def _pack_dataset(data: Path, params: Params) -> DatasetSummary:
    remove_partials(data)
    sources = read_sources(data)
    failures = read_failures(data)
    folder = data / "dataset"
    with atomic_directory(folder) as partial:
        candidates = [source for source in sources if source.views]
        splits = split_plans(candidates, params.dataset.splits, params.seed)
        packed = _pack(partial, data, sources, splits, failures, params)
        kept = [source for source in candidates if packed.rows[source.scene.scene_id]]
        if not kept:
            reasons = Counter(item.why.reason for item in packed.rejected)
            raise InputError(
                f"{data}: none of {len(packed.rejected)} views passes the checks ("
                + ", ".join(f"{name}: {count}" for name, count in sorted(reasons.items()))
                + f"); first: {packed.rejected[0].why.detail}"
            )
        if _emptied(kept, candidates, splits, params):
            # Rejections emptied a whole split: deal the plans that are left, and pack again.
            for name in packed.files:
                (partial / name).unlink()
            splits = split_plans(kept, params.dataset.splits, params.seed)
            packed = _pack(partial, data, sources, splits, failures, params)
        _write_rejected(partial / "rejected.csv", packed.rejected)
        _write_scenes(partial / "scenes.csv", sources, splits, packed)
        summary = _summarise(partial, sources, splits, packed)
        columns = _columns(params)
        scenes = [source.scene for source in kept]
        write_text(partial / "README.md", dataset_card(summary, columns, scenes, params))
        write_croissant(partial, columns, scenes)
        write_sums(partial)
    return summary


def read_sources(data: Path) -> list[Source]:
    """All scenes below `data`, sorted by id, with their camera files.

    Raises `InputError` if there are none, or cameras of a scene that is not there.
    """
    cameras = {}
    for path in sorted((data / "cameras").glob("*.json")):
        file = load_cameras(path)
        if file.scene_id != path.stem:
            raise InputError(f"{path}: holds the cameras of {file.scene_id!r}; rename or remove it")
        cameras[file.scene_id] = file
    sources = []
    for folder in scene_folders(data / "scenes"):
        scene = load_scene(folder)
        sources.append(Source(scene, cameras.pop(scene.scene_id, None)))
    if cameras:
        name = min(cameras)
        raise InputError(
            f"{data}/cameras/{name}.json: there is no scene {name!r} in {data}/scenes; "
            "run: pbrnet cameras"
        )
    if not any(source.views for source in sources):
        raise InputError(f"{data}: no scene has any view yet; run: pbrnet scenes, pbrnet cameras")
    return sources


def split_plans(sources: Sequence[Source], shares: SplitParams, seed: int) -> dict[str, str]:
    """Plan -> split, so that whole plans fall into one split; deterministic in `seed`.

    Every plan draws a number from the seed and its own name. Within a light setting, plans stand
    in the order of their numbers, spread evenly over [0, 1); all plans in that order are dealt
    first to test, then to validation, the rest to train. So each split sees the light settings in
    proportion, no split is empty by chance (from two plans on there is a test plan, from three
    on a validation plan, where their shares are above 0), and adding a scene moves at most the
    plans at the borders. Plans that `shares.test_only` names are dealt to test beforehand.
    """
    kept_back = shares.kept_back({source.scene.scene_id: source.plan for source in sources})
    strata: dict[str, dict[str, int]] = defaultdict(dict)
    settings: dict[str, str] = {}
    for source in sorted(sources, key=lambda source: source.scene.scene_id):
        if source.plan in kept_back:
            continue
        setting = settings.setdefault(source.plan, source.scene.lighting)
        strata[setting][source.plan] = derive(seed, "split", source.plan)
    places: dict[str, tuple[float, int]] = {}
    for draws in strata.values():
        for rank, plan in enumerate(sorted(draws, key=lambda plan: (draws[plan], plan))):
            places[plan] = ((rank + 0.5) / len(draws), draws[plan])
    order = sorted(places, key=lambda plan: (places[plan], plan))
    test = _quota(shares.test, len(order), least=2)
    validation = _quota(shares.validation, len(order), least=3)
    while order and test + validation >= len(order):
        if validation >= test and validation:
            validation -= 1
        else:
            test -= 1
    names = ["test"] * test + ["validation"] * validation
    dealt = dict(zip(order, names + ["train"] * (len(order) - len(names)), strict=True))
    return dealt | dict.fromkeys(sorted(kept_back), "test")


def make_row(
    source: Source, view: View, split: str, frames: Frames, tone: ToneParams, preview_width: int
) -> dict[str, Any]:
    """One row by column name; images as arrays in the frames' own precision."""
    scene = source.scene
    inputs, panorama = frames["inputs"].channels, frames["illumination"].channels
    shading, color = frames["shading"], frames["color"]
    own_shading, own_color = exposure_of(shading.rgb, tone), exposure_of(color.rgb, tone)
    preview = fit(tone_picture(color.rgb, own_color), preview_width)
    return {
        "scene_id": view.scene_id,
        "view_id": view.view_id,
        "split": split,
        "room_type": view.room_type,
        "lighting": scene.lighting,
        "preview": {"bytes": png_bytes(preview), "path": f"{view.scene_id}-{view.view_id}.png"},
        "width": view.width,
        "height": view.height,
        "depth": inputs["Z"],
        "normal": _interleave(inputs, "N.X", "N.Y", "N.Z"),
        "reflectance": _interleave(inputs, *(f"albedo.{band}" for band in RGB)),
        "valid": (inputs["valid"] > 0).astype(np.uint8),
        "intensity": panorama["intensity.Y"],
        "distance": panorama["distance.Z"],
        "shading": _interleave(shading.channels, *RGB),
        "color": _interleave(color.channels, *RGB),
        "K": view.intrinsics,
        "camera_to_world": view.pose,
        "exposure_shading": own_shading.scale,
        "white_shading": own_shading.white,
        "exposure_color": own_color.scale,
        "white_color": own_color.white,
        "spp": color.meta.get("spp"),
        "noise_shading": noise_of(shading),
        "noise_color": noise_of(color),
        "score": view.score,
        "objects": _objects_in(view, scene),
        "seed": _signed(color.meta.get("seed")),
        "renderer": str(color.meta.get("renderer", "unknown")),
        "source": str(scene.source.get("kind", "unknown")),
        "licence": licence_of(scene),
        "attribution": attribution_of(scene),
        **(_noisy_cells(frames["noisy"]) if "noisy" in frames else {}),
    }


def _noisy_cells(frame: Frame) -> dict[str, Any]:
    return {
        "noisy_color": _interleave(frame.channels, *RGB),
        "noisy_shading": _interleave(frame.channels, *NOISY_SHADING),
        "denoised_color": _interleave(frame.channels, *DENOISED),
        "denoised_shading": _interleave(frame.channels, *DENOISED_SHADING),
        "noisy_spp": frame.meta.get("spp"),
    }


def _objects_in(view: View, scene: Scene) -> int:
    """How many objects, parts of the building aside, cover more than 1 % of what is seen."""
    furniture = {thing.id for thing in scene.objects if not thing.is_structure}
    least = 0.01 * sum(view.seen.values())
    return sum(pixels > least for name, pixels in view.seen.items() if name in furniture)


class ShardWriter:
    """Rows of one split into row groups and capped files; keeps one row group in memory.

    Close it to get the shards' final names; a writer that is left by an exception leaves
    nothing usable, its folder is thrown away.
    """

    def __init__(
        self, folder: Path, split: str, columns: tuple[Column, ...], row_group: int, cap: int
    ) -> None:
        self.folder, self.split, self.columns = folder, split, columns
        self.row_group, self.cap = row_group, cap
        self.schema = arrow_schema(columns)
        self._rows: list[dict[str, Any]] = []
        self._parts: list[Path] = []
        self._last_group = 0
        self._stream: BinaryIO | None = None
        self._writer: pq.ParquetWriter | None = None

    def add(self, row: Mapping[str, Any]) -> None:
        """Add a row; writes a row group when enough are together."""
        self._rows.append(dict(row))
        if len(self._rows) >= self.row_group:
            self._flush()

    def close(self) -> list[str]:
        """Write what is left and name the files `<split>-00000-of-0000N.parquet`."""
        if self._rows:
            self._flush()
        self._finish()
        names = []
        for index, part in enumerate(self._parts):
            name = f"{self.split}-{index:05d}-of-{len(self._parts):05d}.parquet"
            part.replace(self.folder / name)
            names.append(name)
        return names

    def abandon(self) -> None:
        """Let go of the open file, whether or not it can be completed."""
        if self._writer is not None:
            # On a full disk the footer fails as the rows before it did.
            with suppress(OSError, pa.ArrowException):
                self._writer.close()
            self._writer = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _flush(self) -> None:
        if self._stream is not None and self._stream.tell() + self._last_group > self.cap:
            self._finish()
        if self._stream is None:
            self._open()
        assert self._stream is not None and self._writer is not None
        before = self._stream.tell()
        self._writer.write_table(to_table(self._rows, self.columns), row_group_size=self.row_group)
        self._last_group = self._stream.tell() - before
        self._rows.clear()

    def _open(self) -> None:
        part = self.folder / f"{self.split}-{len(self._parts):05d}.part"
        self._parts.append(part)
        self._stream = part.open("wb")
        images = [column.name for column in self.columns if column.is_image]
        # Exact floats rarely repeat, but their exponent bytes do: split the bytes, skip the
        # dictionary. `valid` is all runs of 0 and 1, which a dictionary packs to bits.
        floats = [column.name for column in self.columns if column.is_image and _is_float(column)]
        plain = [name for name in self.schema.names if name not in images]
        self._writer = pq.ParquetWriter(
            self._stream,
            self.schema,
            compression="zstd",
            compression_level=3,
            use_dictionary=[*REPEATED, "valid.list.element"],
            use_byte_stream_split=[f"{name}.list.element" for name in floats],
            write_statistics=[name for name in plain if name != "preview"],
        )

    def _finish(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None


def to_table(rows: Sequence[Mapping[str, Any]], columns: tuple[Column, ...]) -> pa.Table:
    """Rows as an Arrow table of `arrow_schema(columns)`."""
    arrays = []
    for column in columns:
        values = [row[column.name] for row in rows]
        if column.shape:
            for value in values:
                if value.shape != column.shape:
                    raise ValueError(f"{column.name}: shape {value.shape}, not {column.shape}")
            flat = np.concatenate([np.ascontiguousarray(value).reshape(-1) for value in values])
            arrays.append(
                pa.FixedSizeListArray.from_arrays(pa.array(flat, column.dtype), type=column.type)
            )
        else:
            arrays.append(pa.array(values, column.type))
    return pa.Table.from_arrays(arrays, schema=arrow_schema(columns))


def _pack(
    folder: Path,
    data: Path,
    sources: Sequence[Source],
    splits: Mapping[str, str],
    failures: Mapping[tuple[str, str], str],
    params: Params,
) -> Packed:
    columns = _columns(params)
    cap = params.dataset.shard_mb * 1_000_000
    rows: Counter[str] = Counter()
    rejected: list[Rejected] = []
    unlit = 0
    work = [(source, view) for source in sources for view in source.views]
    threads = len(os.sched_getaffinity(0))

    def prepare(item: tuple[Source, View]) -> dict[str, Any] | Rejection:
        source, view = item
        return _prepare(data, source, view, splits.get(source.plan, "train"), failures, params)

    with (
        ExitStack() as stack,
        ThreadPoolExecutor(threads) as pool,
        Progress(len(work), "dataset") as progress,
    ):
        writers = {}
        for split in SPLITS:
            writers[split] = ShardWriter(folder, split, columns, params.dataset.row_group, cap)
            stack.callback(writers[split].abandon)
        for (_, view), row in zip(work, _in_order(pool, prepare, work, 2 * threads), strict=True):
            if isinstance(row, Rejection):
                rejected.append(Rejected(view, row))
            else:
                writers[row["split"]].add(row)
                rows[view.scene_id] += 1
                unlit += not row["intensity"].any()
            progress.advance()
        files = [name for split in SPLITS for name in writers[split].close()]
    return Packed(tuple(sorted(files)), rows, tuple(rejected), unlit)


def _prepare(
    data: Path,
    source: Source,
    view: View,
    split: str,
    failures: Mapping[tuple[str, str], str],
    params: Params,
) -> dict[str, Any] | Rejection:
    """A view's row, or why it has none."""
    frames = load_frames(data, view, failures, kinds_of(params))
    if isinstance(frames, Rejection):
        return frames
    size, panorama = _sizes(params)
    why = check_frames(view, frames, size, panorama, params.dataset.checks)
    if why is not None:
        return why
    return make_row(source, view, split, frames, params.tone, params.dataset.preview_width)


def _in_order(
    pool: ThreadPoolExecutor, function: Callable[[A], B], items: Iterable[A], window: int
) -> Iterator[B]:
    """Results of `function` in the order of `items`, at most `window` of them ahead of time."""
    pending: deque[Future[B]] = deque()
    for item in items:
        pending.append(pool.submit(function, item))
        if len(pending) >= window:
            yield pending.popleft().result()
    while pending:
        yield pending.popleft().result()


def _emptied(
    kept: Sequence[Source],
    candidates: Sequence[Source],
    splits: Mapping[str, str],
    params: Params,
) -> bool:
    """Whether a split has lost all its plans to rejections though the others could fill it."""
    if len(kept) == len(candidates):
        return False
    filled = {splits[source.plan] for source in kept}
    wanted = set(split_plans(kept, params.dataset.splits, params.seed).values())
    return filled != wanted


def _quota(share: float, plans: int, least: int) -> int:
    return max(1, round(share * plans)) if share > 0 and plans >= least else 0


def _sizes(params: Params) -> tuple[tuple[int, int], tuple[int, int]]:
    image, panorama = params.image, params.illumination
    return (image.width, image.height), (panorama.width, panorama.width // 2)


def _columns(params: Params) -> tuple[Column, ...]:
    return dataset_columns(*_sizes(params), noisy=params.noisy.spp > 0)


def _is_float(column: Column) -> bool:
    return bool(pa.types.is_floating(column.dtype))


def _interleave(channels: Mapping[str, npt.NDArray[Any]], *names: str) -> npt.NDArray[Any]:
    """Planes (H, W) as (H, W, C), in the planes' own precision."""
    return np.stack([channels[name] for name in names], axis=-1)


def _signed(seed: Any) -> int | None:
    """A 64-bit seed as two's complement, which Parquet's integers can hold."""
    if not isinstance(seed, int):
        return None
    seed &= (1 << 64) - 1
    return seed - (1 << 64) if seed >= 1 << 63 else seed


def _write_rejected(path: Path, rejected: Iterable[Rejected]) -> None:
    _write_csv(
        path,
        ("scene_id", "view_id", "reason", "detail"),
        (
            (item.view.scene_id, item.view.view_id, item.why.reason, item.why.detail)
            for item in rejected
        ),
    )


def _write_scenes(
    path: Path, sources: Sequence[Source], splits: Mapping[str, str], packed: Packed
) -> None:
    lines = []
    for source in sources:
        scene, views = source.scene, source.views
        seen_rooms = {view.room for view in views}
        empty = [room.id for room in scene.rooms if room.id not in seen_rooms]
        rows = packed.rows[scene.scene_id]
        candidates = source.cameras.candidates if source.cameras else 0
        lines.append(
            (
                scene.scene_id,
                splits.get(source.plan, "train") if rows else "",
                source.plan,
                str(scene.source.get("kind", "unknown")),
                scene.lighting,
                len(scene.rooms),
                " ".join(empty),
                candidates,
                len(views),
                rows,
                len(views) - rows,
                licence_of(scene),
                attribution_of(scene),
            )
        )
    header = ("scene_id", "split", "plan", "source", "lighting", "rooms", "rooms_without_view")
    counts = ("candidates", "views", "rows", "rejected", "licence", "attribution")
    _write_csv(path, header + counts, lines)


def _write_csv(path: Path, header: Sequence[str], lines: Iterable[Sequence[Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(lines)


def _summarise(
    folder: Path, sources: Sequence[Source], splits: Mapping[str, str], packed: Packed
) -> DatasetSummary:
    rows: Counter[str] = Counter()
    scenes: Counter[str] = Counter()
    for source in sources:
        count = packed.rows[source.scene.scene_id]
        if count:
            split = splits.get(source.plan, "train")
            rows[split] += count
            scenes[split] += 1
    reasons = Counter(item.why.reason for item in packed.rejected)
    return DatasetSummary(
        {split: rows[split] for split in SPLITS},
        {split: scenes[split] for split in SPLITS},
        dict(sorted(reasons.items())),
        packed.unlit,
        packed.files,
        sum((folder / name).stat().st_size for name in packed.files),
    )
