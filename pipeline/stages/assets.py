"""The `assets` stage: furniture catalogues, converted piece by piece, and their index.

Off by default; then the index is empty and nothing is fetched. A piece is kept while its
fingerprint holds: a killed run resumes, and a changed catalogue, parameter or converter leaves no
stale pieces.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pbrnet.pipeline.farm.cluster import Farm
from pbrnet.pipeline.farm.scheduling import Item
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.versions import code_version
from pbrnet.pipeline.farm.workspace import open_workspace
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.stages.render_jobs import use_code
from pbrnet.pipeline.terminal import lines_of
from pbrnet.scenes.assets.index import (
    Asset,
    AssetIndex,
    IndexEntry,
    LibraryEntry,
    Provenance,
    RefusedPiece,
    index_entry,
    load_asset,
    save_index,
)
from pbrnet.scenes.assets.piece import CataloguePiece
from pbrnet.scenes.errors import InputError, MachineError, PbrnetError
from pbrnet.scenes.files import (
    atomic_directory,
    digest_file,
    read_json,
    remove_partials,
    write_json,
)
from pbrnet.scenes.params import AssetParams
from pbrnet.scenes.sweethome.catalogue.convert import convert, piece_fingerprint
from pbrnet.scenes.sweethome.catalogue.library import Library, UnusablePiece, read_library

INSTALLED = Path("/usr/share/sweethome3d/furniture")  # catalogues of Debian's packages
SUFFIX = ".sh3f"
_DOWNLOADS = "packages"  # below data/assets: fetched packages
_PATIENCE = 900.0  # seconds for apt-get
_SHOWN = 10  # refused pieces listed on the terminal; the index holds all of them


class AssetError(PbrnetError):
    """Some pieces failed for reasons outside of them, and everything else is done."""

    exit_code = 1


@dataclass(frozen=True)
class _Source:
    """A catalogue file, and the package and version it was fetched in, or an empty string."""

    path: Path
    package: str


@dataclass(frozen=True)
class _PieceJob:
    source: Path
    piece: CataloguePiece
    out: Path
    provenance: Provenance
    fingerprint: str
    max_triangles: int
    texture_size: int


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
            f"{len(self.index.pieces)} of {total} pieces usable, "
            f"from {len(self.index.libraries)} catalogues",
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
    file is damaged, `AssetError` if pieces failed for reasons outside of them.
    """
    started = time.monotonic()
    data = Path(data).resolve()
    root = data / "assets"
    with data_lock(data, "assets"):
        root.mkdir(parents=True, exist_ok=True)
        remove_partials(root)
        if not params.assets.enabled:
            removed = _remove_orphans(root, {})
            save_index(root, AssetIndex())
            return AssetSummary(AssetIndex(), 0, 0, removed, time.monotonic() - started)
        sources = find_catalogues(params.assets, root)
        libraries = _read_all(sources)
        jobs, refused = _jobs(root, libraries, params.assets)
        removed = _remove_orphans(root, jobs)
        kept = {key: index_entry(asset) for key, job in jobs.items() if (asset := _current(job))}
        work = [job for key, job in jobs.items() if key not in kept]
        made, failures = _convert_all(data, params.farm, scheduler, work, len(kept), refused)
        index = AssetIndex(
            _entries(libraries, {**kept, **made}),
            tuple(sorted({**kept, **made}.values(), key=lambda piece: piece.key)),
            tuple(sorted(refused, key=lambda piece: piece.key)),
        )
        save_index(root, index)
        if failures:
            raise AssetError(
                f"assets: {len(failures)} pieces failed, {len(made)} made, {len(kept)} kept",
                *(f"  {failure}" for failure in failures[:_SHOWN]),
                "Everything else is done; run the same command again to retry.",
            )
        return AssetSummary(index, len(made), len(kept), removed, time.monotonic() - started)


def find_catalogues(params: AssetParams, root: Path) -> list[_Source]:
    """Return the catalogue files that the parameters name, sorted; fetch missing packages."""
    if params.folder:
        folder = Path(params.folder).expanduser()
        if not folder.is_dir():
            raise MachineError(
                f"assets.folder: {folder} is not a folder; name one that holds {SUFFIX} files"
            )
        found = [_Source(path, "") for path in _catalogues(folder)]
        if not found:
            raise MachineError(f"assets.folder: no {SUFFIX} file in {folder}")
        return found
    sources = []
    for package in params.debian:
        version = _installed_version(package)
        if version and _catalogues(INSTALLED):
            sources += [_Source(path, f"{package} {version}") for path in _catalogues(INSTALLED)]
            continue
        folder = root / _DOWNLOADS / package
        if not (folder / "package.json").is_file():
            _fetch(package, folder)
        facts = read_json(folder / "package.json")
        label = f"{package} {facts.get('version', '')}".strip()
        sources += [_Source(path, label) for path in _catalogues(folder)]
    return list({source.path.name: source for source in sources}.values())


def _catalogues(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.suffix.lower() == SUFFIX and p.is_file())


def _installed_version(package: str) -> str:
    query = ["dpkg-query", "--show", "--showformat=${db:Status-Status} ${Version}", "--", package]
    try:
        done = subprocess.run(query, capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    status, _, version = done.stdout.strip().partition(" ")
    return version if done.returncode == 0 and status == "installed" else ""


def _fetch(package: str, out: Path) -> None:
    """Download a Debian package and unpack its catalogues into the folder `out`."""
    advice = (
        f"; set assets.folder to a folder with {SUFFIX} files, install the package, "
        "or set assets.enabled to false"
    )
    with tempfile.TemporaryDirectory(prefix="pbrnet-assets-") as name:
        folder = Path(name)
        _command(["apt-get", "download", "--", package], folder, f"cannot fetch {package}", advice)
        debs = sorted(folder.glob("*.deb"))
        if not debs:
            raise MachineError(f"assets: apt-get downloaded no package for {package}{advice}")
        unpack = ["dpkg-deb", "--extract", str(debs[0]), str(folder / "tree")]
        _command(unpack, folder, f"cannot unpack {debs[0].name}", advice)
        found = [path for path in sorted((folder / "tree").rglob(f"*{SUFFIX}")) if path.is_file()]
        if not found:
            raise MachineError(f"assets: {package} holds no {SUFFIX} file{advice}")
        with atomic_directory(out) as partial:
            for path in found:
                shutil.copyfile(path, partial / path.name)
            parts = debs[0].stem.split("_")
            facts = {
                "package": package,
                "version": parts[1] if len(parts) > 1 else "",
                "file": debs[0].name,
                "sha256": digest_file(debs[0]),
            }
            write_json(partial / "package.json", facts)


def _command(command: Sequence[str], folder: Path, what: str, advice: str) -> None:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except FileNotFoundError:
        raise MachineError(f"assets: {what}: {command[0]} is not installed{advice}") from None
    except subprocess.TimeoutExpired:
        raise MachineError(
            f"assets: {what}: not finished after {_PATIENCE:.0f} s{advice}"
        ) from None
    if done.returncode:
        message = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
        raise MachineError(f"assets: {what}: {message}{advice}")


def _read_all(sources: Iterable[_Source]) -> list[tuple[_Source, str, Library]]:
    """Read each catalogue with its digest; two that would share a folder are refused."""
    libraries: list[tuple[_Source, str, Library]] = []
    for source in sources:
        library = read_library(source.path)
        taken = [other.key.lower() for _, _, other in libraries]
        if library.key.lower() in (*taken, _DOWNLOADS):
            raise InputError(f"{source.path}: another catalogue has this name; rename the file")
        libraries.append((source, digest_file(source.path), library))
    return libraries


def _jobs(
    root: Path, libraries: Iterable[tuple[_Source, str, Library]], params: AssetParams
) -> tuple[dict[str, _PieceJob], list[RefusedPiece]]:
    jobs: dict[str, _PieceJob] = {}
    refused: list[RefusedPiece] = []
    for source, sha256, library in libraries:
        refused += [RefusedPiece(*row) for row in library.refused]
        provenance = Provenance(
            source.path.name,
            sha256,
            library.name,
            library.version,
            library.provider,
            source.package,
        )
        for piece in library.pieces:
            jobs[piece.key] = _PieceJob(
                source.path,
                piece,
                root / piece.key,
                provenance,
                piece_fingerprint(
                    piece, sha256, params.max_triangles, params.texture_size, key("assets")
                ),
                params.max_triangles,
                params.texture_size,
            )
    return jobs, refused


def _current(job: _PieceJob) -> Asset | None:
    """Return the piece on disk if it is complete and has the job's fingerprint, else None."""
    try:
        asset = load_asset(job.out)
    except InputError:
        return None
    files = [part.mesh for part in asset.parts]
    files += [name for part in asset.parts for name in (part.texture, part.alpha) if name]
    current = asset.fingerprint == job.fingerprint and all((job.out / f).is_file() for f in files)
    return asset if current else None


def convert_piece(job: _PieceJob) -> dict[str, Any]:
    """Convert one piece on a worker; a refusal is a result, not a failure."""
    try:
        asset = convert(
            job.source,
            job.piece,
            job.out,
            job.provenance,
            job.fingerprint,
            job.max_triangles,
            job.texture_size,
        )
    except UnusablePiece as reason:
        return {"refused": str(reason)}
    return {"usable": index_entry(asset)}


def _convert_all(
    data: Path,
    params: FarmParams,
    scheduler: str | None,
    jobs: Sequence[_PieceJob],
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
    with (
        Progress(kept + len(items), "assets", "pieces") as progress,
        open_workspace(data, params.transfer, params.cache_mb) as workspace,
    ):
        progress.advance(kept)
        try:
            setup = partial(use_code, code_version(), workspace)
            needed = workspace.token_path
            with Farm(params, scheduler, setup, len(items), needed=needed) as farm:
                for outcome in farm.run(convert_piece, items):
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


def _entries(
    libraries: Iterable[tuple[_Source, str, Library]], usable: dict[str, IndexEntry]
) -> tuple[LibraryEntry, ...]:
    counts = Counter(key.partition("/")[0] for key in usable)
    return tuple(
        LibraryEntry(
            key=library.key,
            file=source.path.name,
            sha256=sha256,
            name=library.name,
            version=library.version,
            licence=library.licence,
            provider=library.provider,
            package=source.package,
            pieces=len(library.pieces) + len(library.refused),
            usable=counts[library.key],
        )
        for source, sha256, library in libraries
    )


def _remove_orphans(root: Path, wanted: dict[str, Any]) -> int:
    """Remove converted pieces that are no longer wanted; downloads stay."""
    removed = 0
    for file in sorted(root.glob("*/*/piece.json")):
        folder = file.parent
        if folder.relative_to(root).as_posix() not in wanted:
            shutil.rmtree(folder)
            removed += 1
    for folder in sorted(root.iterdir()):
        if folder.is_dir() and folder.name != _DOWNLOADS and not any(folder.iterdir()):
            folder.rmdir()
    return removed
