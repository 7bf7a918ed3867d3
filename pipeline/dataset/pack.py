"""Packing of the dataset: checks of every view's frames, and Parquet shards by split.

Reads `data/scenes`, `data/cameras` and the frames; writes `data/dataset/`, which is complete or
absent: shards by split, a README card, `croissant.json`, `rejected.csv` (views sampled = rows +
rejected) and `scenes.csv` (every scene, also those without any view).

The same frames and parameters give the same bytes, whatever the number of threads. Memory is
bounded by one row group per split and a few views in preparation, whatever the number of views.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from pbrnet import reader
from pbrnet.pipeline.channels import SURFACES
from pbrnet.pipeline.dataset.checks import (
    Rejection,
    broken_walks,
    check_light,
    load_frames,
    read_failures,
    surfaces_of,
)
from pbrnet.pipeline.dataset.columns import CLASSES, Column, dataset_columns
from pbrnet.pipeline.dataset.description.card import DatasetSummary, dataset_card
from pbrnet.pipeline.dataset.description.croissant import write_croissant
from pbrnet.pipeline.dataset.description.facts import (
    DatasetFacts,
    ViewFacts,
    attribution_of,
    citation_file,
    licence_of,
    view_facts,
)
from pbrnet.pipeline.dataset.rows import RowSource, make_row
from pbrnet.pipeline.dataset.shards import SUMS, ShardWriter, read_sums, verify_sums, write_sums
from pbrnet.pipeline.frames import fingerprint
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.splits import SPLITS, Source, read_sources, split_plans
from pbrnet.pipeline.views import View
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import (
    atomic_directory,
    digest_file,
    exists,
    read_json,
    remove_partials,
    write_csv,
    write_json,
    write_text,
)

PACKED = "packed.json"  # below the data folder
_SUMMARY = ("rows", "scenes", "rejected", "unlit", "bytes")  # fields of `DatasetSummary`
A = TypeVar("A")
B = TypeVar("B")


@dataclass(frozen=True)
class Rejected:
    """A view that is not in the dataset."""

    view: View
    why: Rejection


@dataclass(frozen=True)
class Packed:
    """Shards, rows and rejected views of one pass over all views."""

    files: tuple[str, ...]  # shard names, sorted
    rows: Counter[str]  # per scene
    rejected: tuple[Rejected, ...]
    facts: tuple[ViewFacts, ...]  # of the rows


def pack_dataset(data: Path, params: Params) -> DatasetSummary:
    """Check and pack all views below `data`; `data/dataset` appears by rename.

    A dataset that was packed from the same frames, scenes, cameras and parameters is kept;
    `data/packed.json` says from which.
    Raises `InputError` if there are no views, if none passes the checks, or if a scene or camera
    file is broken, and `MachineError` if the disk is full.
    """
    data = Path(data)
    with data_lock(data, "dataset"):
        remove_partials(data)
        packer = _Packer(data, params, read_sources(data), read_failures(data))
        origin = packer.origin()
        kept = packed_summary(data, origin, params.farm.checksums)
        if kept is not None:
            return kept
        with atomic_directory(data / "dataset") as partial:
            summary = packer.write_dataset(partial)
        save_summary(data, origin, summary)
        return summary


def is_packed(data: Path, params: Params) -> bool:
    """Return whether `pack_dataset` has nothing to do; checksums are not compared."""
    try:
        packer = _Packer(data, params, read_sources(data), read_failures(data))
        return packed_summary(data, packer.origin(), verify=False) is not None
    except InputError:
        return False


@dataclass(frozen=True)
class _Packer:
    """Packing of a data folder; `failures` are the messages of frames that were not rendered."""

    data: Path
    params: Params
    sources: Sequence[Source]
    failures: Mapping[tuple[str, str], str]

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the dataset."""
        return dataset_columns(self.params)

    def origin(self) -> str:
        """Return a digest of all that determines the dataset; of files it takes size and time."""
        params = self.params
        sections: tuple[str, ...] = (
            *("seed", "channels", "image", "illumination", "groundtruth", "light", "noisy"),
            *("environment", "shading", "transport", "dataset", "tone"),
            *(["optics"] if params.optics.active else []),
        )
        patterns = ["scenes/*/scene.json", "cameras/*.json", "failures/*.json"]
        patterns += [f"{kind}/*/*.exr" for kind in params.kinds]
        files = [path for pattern in patterns for path in sorted(self.data.glob(pattern))]
        states = [(path, path.stat()) for path in files]
        return fingerprint(
            key=key("dataset"),
            reader=digest_file(Path(reader.__file__)),
            links=params.cameras.has_links,
            **{name: getattr(params, name) for name in sections},
            files=[
                (path.relative_to(self.data).as_posix(), state.st_size, state.st_mtime_ns)
                for path, state in states
            ],
        )

    def write_dataset(self, folder: Path) -> DatasetSummary:
        """Write all files of the dataset into a folder."""
        params = self.params
        candidates = [source for source in self.sources if source.views]
        splits = split_plans(candidates, params.dataset.splits, params.seed)
        packed = self._pack(folder, splits)
        walks = broken_walks(
            (view for source in self.sources for view in source.views),
            (item.view for item in packed.rejected),
        )
        dropped: frozenset[tuple[str, str]] = frozenset()
        if walks and params.dataset.checks.whole_walks:
            dropped, walks = frozenset(walks), {}
            packed = self._pack_again(packed, folder, splits, dropped)
        kept = [source for source in candidates if packed.rows[source.scene.scene_id]]
        if not kept:
            reasons = Counter(item.why.reason for item in packed.rejected)
            raise InputError(
                f"{self.data}: none of {len(packed.rejected)} views passes the checks ("
                + ", ".join(f"{name}: {count}" for name, count in sorted(reasons.items()))
                + f"); first: {packed.rejected[0].why.detail}"
            )
        dealt = split_plans(kept, params.dataset.splits, params.seed)
        if len(kept) < len(candidates) and {splits[s.plan] for s in kept} != {*dealt.values()}:
            # Rejections emptied a whole split: deal the plans that are left, and pack again.
            splits, packed = dealt, self._pack_again(packed, folder, dealt, dropped)
        _write_rejected(folder / "rejected.csv", packed.rejected)
        _write_scenes(folder / "scenes.csv", self.sources, splits, packed)
        summary = replace(_summarise(folder, self.sources, splits, packed), walks=walks)
        scenes = [source.scene for source in kept]
        write_text(folder / "README.md", dataset_card(summary, self.columns, scenes, params))
        shutil.copyfile(reader.__file__, folder / "pbrnet_reader.py")
        samples = params.groundtruth.spp
        write_croissant(folder, self.columns, scenes, summary.facts, samples)
        licences = sorted({credit.licence for scene in scenes for credit in scene.credits})
        write_text(folder / "CITATION.cff", citation_file(licences))
        if "labels" in params.kinds:
            write_json(folder / "classes.json", CLASSES)
        write_sums(folder)
        return summary

    def _pack_again(
        self,
        packed: Packed,
        folder: Path,
        splits: Mapping[str, str],
        dropped: Collection[tuple[str, str]],
    ) -> Packed:
        """Remove the shards of a pass and do another one."""
        for name in packed.files:
            (folder / name).unlink()
        return self._pack(folder, splits, dropped)

    def _pack(
        self, folder: Path, splits: Mapping[str, str], dropped: Collection[tuple[str, str]] = ()
    ) -> Packed:
        """Write the shards; `splits`: the split of each plan. `dropped` walks are rejected."""
        params = self.params.dataset
        rows: Counter[str] = Counter()
        rejected: list[Rejected] = []
        facts: list[ViewFacts] = []
        work = [(source, view) for source in self.sources for view in source.views]
        threads = len(os.sched_getaffinity(0))

        def prepare(item: tuple[Source, View]) -> dict[str, Any] | Rejection:
            source, view = item
            row = self._row(source, view, splits.get(source.plan, "train"))
            if view.walk in dropped and not isinstance(row, Rejection):
                return Rejection("walk", f"{view.trajectory}: another frame of it is rejected")
            return row

        with (
            ExitStack() as stack,
            ThreadPoolExecutor(threads) as pool,
            Progress(len(work), "dataset") as progress,
        ):
            writers = {}
            for split in SPLITS:
                cap = params.shard_mb * 1_000_000
                writers[split] = ShardWriter(folder, split, self.columns, params.row_group, cap)
                stack.callback(writers[split].abandon)
            made = _in_order(pool, prepare, work, 2 * threads)
            for (_, view), row in zip(work, made, strict=True):
                if isinstance(row, Rejection):
                    rejected.append(Rejected(view, row))
                else:
                    writers[row["split"]].add(row)
                    rows[view.scene_id] += 1
                    facts.append(view_facts(row, self.params.shading.albedo))
                progress.advance()
            files = [name for split in SPLITS for name in writers[split].close()]
        return Packed(tuple(sorted(files)), rows, tuple(rejected), tuple(facts))

    def _row(self, source: Source, view: View, split: str) -> dict[str, Any] | Rejection:
        """Return the row of a view, or the reason of its rejection."""
        params = self.params
        sizes = {kind: params.size_of(kind) for kind in params.kinds}
        limits, lights = params.dataset.checks, params.light.images
        frames = surfaces_of(
            self.data, view, source.views, self.failures, params.kinds, sizes["inputs"], limits
        )
        if isinstance(frames, Rejection):
            return frames
        others = [kind for kind in params.kinds if kind not in SURFACES]
        light = load_frames(self.data, view, self.failures, others)
        if isinstance(light, Rejection):
            return light
        frames |= light
        why = check_light(view, frames, sizes, limits, lights)
        if why is not None:
            return why
        row = RowSource(source.scene, view, split, frames, params.tone)
        return make_row(self.columns, row, params.dataset.preview_width)


def packed_summary(data: Path, origin: str, verify: bool) -> DatasetSummary | None:
    """Return the summary of a dataset that was packed from `origin`; None if there is none.

    Its files must be those that were written: by name, with `verify` by their checksums.
    """
    path, folder = data / PACKED, data / "dataset"
    try:
        known = read_json(path) if exists(path) else {}
        if known.get("origin") != origin or known.get("sums") != digest_file(folder / SUMS):
            return None
        if verify:
            verify_sums(folder)
        elif not all((folder / name).is_file() for name in read_sums(folder / SUMS)):
            return None
        walks = {(scene, walk): count for scene, walk, count in known["walks"]}
        values = {name: known[name] for name in _SUMMARY}
        values |= {name: {one: known[name][one] for one in SPLITS} for name in ("rows", "scenes")}
        files = tuple(known["files"])
        return DatasetSummary(
            **values, files=files, facts=DatasetFacts(()), walks=walks, packed=False
        )
    except (InputError, OSError, AttributeError, KeyError, TypeError, ValueError):
        return None


def save_summary(data: Path, origin: str, summary: DatasetSummary) -> None:
    """Write what a dataset was packed from, and its summary, to `data/packed.json`."""
    values = {name: getattr(summary, name) for name in (*_SUMMARY, "files")}
    walks = [(*walk, count) for walk, count in summary.walks.items()]
    sums = digest_file(data / "dataset" / SUMS)
    write_json(data / PACKED, {"origin": origin, "sums": sums, "walks": walks, **values})


def _in_order(
    pool: ThreadPoolExecutor, function: Callable[[A], B], items: Iterable[A], window: int
) -> Iterator[B]:
    """Yield results of `function` in the order of `items`, at most `window` computed ahead."""
    pending: deque[Future[B]] = deque()
    for item in items:
        pending.append(pool.submit(function, item))
        if len(pending) >= window:
            yield pending.popleft().result()
    while pending:
        yield pending.popleft().result()


def _write_rejected(path: Path, rejected: Iterable[Rejected]) -> None:
    write_csv(
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
    write_csv(path, header + counts, lines)


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
        sum(not view.lit_panorama for view in packed.facts),
        packed.files,
        sum((folder / name).stat().st_size for name in packed.files),
        DatasetFacts(packed.facts),
    )
