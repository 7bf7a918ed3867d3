"""Pieces of catalogues: what is to be converted, conversion on a worker, and their index."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pbrnet.scenes.assets.index import (
    Asset,
    AssetIndex,
    IndexEntry,
    LibraryEntry,
    Provenance,
    RefusedPiece,
    index_entry,
    load_asset,
)
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.sweethome.catalogue.convert import PieceJob, convert, piece_fingerprint
from pbrnet.scenes.sweethome.catalogue.library import UnusablePiece
from pbrnet.scenes.sweethome.catalogue.packages import Catalogue


def piece_jobs(
    root: Path, catalogues: Iterable[Catalogue], max_triangles: int, texture_size: int, key: int
) -> tuple[dict[str, PieceJob], list[RefusedPiece]]:
    """Return a job for each piece by its key, and the pieces that cannot be read.

    `key` is that of the converter, `root` the folder of all assets.
    """
    jobs: dict[str, PieceJob] = {}
    refused: list[RefusedPiece] = []
    for one in catalogues:
        library = one.library
        refused += [RefusedPiece(*row) for row in library.refused]
        provenance = Provenance(
            *(one.path.name, one.sha256, library.name, library.version),
            *(library.provider, one.package),
        )
        for piece in library.pieces:
            limits = max_triangles, texture_size
            digest = piece_fingerprint(piece, one.sha256, *limits, key)
            out = root / piece.key
            jobs[piece.key] = PieceJob(one.path, piece, out, provenance, digest, *limits)
    return jobs, refused


def current(job: PieceJob) -> Asset | None:
    """Return the piece on disk if it is complete and has the job's fingerprint, else None."""
    try:
        asset = load_asset(job.out)
    except InputError:
        return None
    files = [part.mesh for part in asset.parts]
    files += [name for part in asset.parts for name in (part.texture, part.alpha) if name]
    current = asset.fingerprint == job.fingerprint and all((job.out / f).is_file() for f in files)
    return asset if current else None


def convert_piece(job: PieceJob) -> dict[str, Any]:
    """Convert one piece on a worker; a refusal is a result, not a failure."""
    try:
        asset = convert(job)
    except UnusablePiece as reason:
        return {"refused": str(reason)}
    return {"usable": index_entry(asset)}


def index_of(
    catalogues: Iterable[Catalogue],
    usable: Mapping[str, IndexEntry],
    refused: Sequence[RefusedPiece],
) -> AssetIndex:
    """Return the index of the catalogues, with their usable pieces and the refused ones."""
    counts = Counter(key.partition("/")[0] for key in usable)
    libraries = tuple(
        LibraryEntry(
            key=one.library.key,
            file=one.path.name,
            sha256=one.sha256,
            name=one.library.name,
            version=one.library.version,
            licence=one.library.licence,
            provider=one.library.provider,
            package=one.package,
            pieces=len(one.library.pieces) + len(one.library.refused),
            usable=counts[one.library.key],
        )
        for one in catalogues
    )
    return AssetIndex(
        libraries,
        tuple(sorted(usable.values(), key=lambda piece: piece.key)),
        tuple(sorted(refused, key=lambda piece: piece.key)),
    )
