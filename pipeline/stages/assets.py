"""The `assets` stage: furniture catalogues, converted piece by piece, and their index.

Off by default; then the index is empty and nothing is fetched. A piece is kept while its
fingerprint holds: a killed run resumes, and a changed catalogue, parameter or converter leaves no
stale pieces.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.worker import Item
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.records import Trash, data_lock
from pbrnet.pipeline.stages.runner import StageError, opened_farm
from pbrnet.pipeline.terminal import counted, lines_of
from pbrnet.scenes.assets.index import (
    OWN_TABLE,
    AssetIndex,
    IndexEntry,
    RefusedPiece,
    index_entry,
    save_index,
)
from pbrnet.scenes.files import remove_partials
from pbrnet.scenes.own_assets.convert import convert_any
from pbrnet.scenes.own_assets.table import read_table
from pbrnet.scenes.sweethome.catalogue.packages import DOWNLOADS, find_catalogues, read_catalogues
from pbrnet.scenes.sweethome.catalogue.pieces import PieceJob, current, index_of, piece_jobs

_SHOWN = 10  # refused pieces listed on the terminal; the index holds all of them


@dataclass(frozen=True)
class AssetSummary:
    """The new index, and numbers of pieces made, kept and removed."""

    index: AssetIndex
    made: int
    kept: int
    removed: int
    seconds: float

    def __str__(self) -> str:
        if not self.index.libraries:
            return "assets: no furniture catalogues (assets.enabled is false)"
        total = len(self.index.pieces) + len(self.index.refused)
        lines = [
            f"assets: {self.made} made, {self.kept} kept, {self.removed} removed, "
            f"{self.seconds:.1f} s",
            f"{len(self.index.pieces)} of {counted(total, 'piece')} usable, "
            f"from {counted(len(self.index.libraries), 'catalogue')}",
        ]
        lines += [
            f"  {library.key}: {library.usable} of {library.pieces}, {library.licence}"
            for library in self.index.libraries
        ]
        lines += [f"  refused {piece.key}: {piece.reason}" for piece in self.index.refused[:_SHOWN]]
        if len(self.index.refused) > _SHOWN:
            lines.append(f"  and {len(self.index.refused) - _SHOWN} more, see catalogue.json")
        return lines_of(lines)


def run_assets(data: Path, params: Params, scheduler: str | None = None) -> AssetSummary:
    """Fill `data/assets` and write its index.

    Raises `MachineError` if a catalogue cannot be found or fetched, `InputError` if a catalogue
    file is damaged, `StageError` if pieces failed for reasons outside of them.
    """
    started = time.monotonic()
    data = Path(data).resolve()
    root = data / "assets"
    with data_lock(data, "assets"):
        root.mkdir(parents=True, exist_ok=True)
        remove_partials(root)
        if not params.assets.enabled:
            removed = _remove_orphans(root, {}, params.farm)
            save_index(root, AssetIndex())
            return AssetSummary(AssetIndex(), 0, 0, removed, time.monotonic() - started)
        wanted = params.assets
        files = find_catalogues(wanted.folder, wanted.debian, root, OWN_TABLE)
        catalogues = read_catalogues(files, read_table)
        sizes = wanted.max_triangles, wanted.texture_size
        jobs, refused = piece_jobs(root, catalogues, *sizes, key("assets"))
        removed = _remove_orphans(root, jobs, params.farm)
        kept = {name: index_entry(asset) for name, job in jobs.items() if (asset := current(job))}
        work = [job for name, job in jobs.items() if name not in kept]
        made, failures = _convert_all(data, params.farm, scheduler, work, len(kept), refused)
        index = index_of(catalogues, {**kept, **made}, refused)
        save_index(root, index)
        if failures:
            raise StageError(
                f"assets: {counted(len(failures), 'piece')} failed, {len(made)} made, "
                f"{len(kept)} kept",
                *(f"  {failure}" for failure in failures[:_SHOWN]),
                "Everything else is done; run the same command again to retry.",
            )
        return AssetSummary(index, len(made), len(kept), removed, time.monotonic() - started)


def _convert_all(
    data: Path,
    params: FarmParams,
    scheduler: str | None,
    jobs: Sequence[PieceJob],
    kept: int,
    refused: list[RefusedPiece],
) -> tuple[dict[str, IndexEntry], list[str]]:
    """Return the usable pieces among `jobs` and the failures; adds to `refused`."""
    made: dict[str, IndexEntry] = {}
    failures: list[str] = []
    if not jobs:
        return made, failures
    by_key = {job.piece.key: job for job in jobs}
    items = [Item(key, key.partition("/")[0], job) for key, job in by_key.items()]
    with Progress(kept + len(items), "assets", "pieces") as progress:
        progress.advance(kept)
        try:
            with opened_farm(data, params, scheduler, len(items)) as farm:
                for outcome in farm.run(convert_any, items):
                    job = by_key[outcome.key]
                    if outcome.error:
                        failures.append(f"{outcome.key}: {outcome.error}")
                    elif "refused" in outcome.value:
                        reason = outcome.value["refused"]
                        refused.append(RefusedPiece(outcome.key, job.piece.name, reason))
                    else:
                        made[outcome.key] = outcome.value["usable"]
                    progress.advance(1, outcome.key)
        finally:
            for folder in {job.out.parent for job in jobs}:
                remove_partials(folder)
    return made, failures


def _remove_orphans(root: Path, wanted: dict[str, Any], params: FarmParams) -> int:
    """Move converted pieces that are no longer wanted to the trash, others back; downloads stay."""
    pieces = {piece.parent for piece in root.glob("*/*/piece.json")}
    orphans = sorted(one for one in pieces if one.relative_to(root).as_posix() not in wanted)
    trash = Trash(root.parent, params.trash_days)
    trash.add(orphans)
    trash.put_back(
        job.out
        for job in wanted.values()
        if not current(job) and current(replace(job, out=trash.place(job.out)))
    )
    trash.sweep()
    for folder in sorted(root.iterdir()):
        if folder.is_dir() and folder.name != DOWNLOADS and not any(folder.iterdir()):
            folder.rmdir()
    return len(orphans)
