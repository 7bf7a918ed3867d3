"""Execution of an export: parts that appear by rename, so that a killed export resumes.

`export.json` in the folder names format, options, dataset and files. The same export again keeps
the parts that are there; another one replaces them, and refuses a folder with further files.
`credits.csv` has licence and author of each scene.
"""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pbrnet.pipeline.export.rows import DatasetRows, LensKind, ViewRow
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.records import data_lock
from pbrnet.scenes.errors import InputError, MachineError, PbrnetError
from pbrnet.scenes.files import (
    atomic_directory,
    atomic_file,
    exists,
    read_json,
    sweep,
    write_csv,
    write_json,
)

RECORD = "export.json"
CREDITS = "credits.csv"  # licence and author of each scene
_LOCK = ".lock"

Advance = Callable[[], None]


@dataclass(frozen=True)
class ExportOptions:
    """Options of the formats; each uses those that it can say."""

    images: Literal["png", "exr"] = "png"  # tone-mapped 8-bit, or linear
    exposure: Literal["scene", "view"] = "scene"  # of tone-mapped images
    points: int = 50_000  # of a scene's point cloud
    classes: Literal["category", "nyu40", "nyu13"] = "category"
    fps: float = 30.0  # frames a second of trajectories
    tar_views: int = 64  # views in a tar
    triangles: int = 4096  # of a room
    partial: bool = False  # leave out what the dataset lacks


@dataclass(frozen=True)
class Job:
    """An export: the rows, the folder of scenes, the options, and where it goes."""

    rows: DatasetRows
    scenes: Path
    options: ExportOptions
    out: Path


@dataclass(frozen=True)
class Part:
    """A file or folder of an export, which `write` fills; `views` is its share of the work.

    `write` receives a temporary path and a function to call after each view.
    """

    path: str  # relative to the export's folder
    views: int
    write: Callable[[Path, Advance], None]
    is_folder: bool = True


@dataclass(frozen=True)
class Format:
    """A format: its name, a title, the columns that it needs, and its parts.

    `finish` writes what is about all parts; it runs after them. `check` refuses datasets before
    anything is written.
    """

    name: str
    title: str
    needs: tuple[str, ...]
    parts: Callable[[Job], Sequence[Part]]
    finish: Callable[[Job], None] = lambda job: None
    check: Callable[[Job], None] = lambda job: None
    finished: tuple[str, ...] = ()  # what `finish` writes beside the parts
    uses: tuple[str, ...] = ()  # names of the options that change its files
    lenses: tuple[LensKind, ...] = ()  # that it can say, besides pinholes


def scene_parts(
    write: Callable[[Job, Sequence[ViewRow], Path, Advance], None], job: Job
) -> Sequence[Part]:
    """Return a folder for each scene, which `write` fills."""
    scenes = job.rows.scenes().items()
    return [Part(scene, len(rows), partial(write, job, rows)) for scene, rows in scenes]


@dataclass(frozen=True)
class Exported:
    """Result of an export: views and parts that it holds, and parts that were there already."""

    views: int
    parts: int
    kept: int


def run_export(form: Format, job: Job) -> Exported:
    """Write an export to `job.out`, or resume it.

    Raises `InputError` if the dataset lacks something, or if the folder holds something else.
    """
    job.rows.require(form.needs, form.name)
    job.rows.require_lenses(form.name, form.lenses)
    form.check(job)
    record = _record(form, job)
    _claim(job.out)
    with data_lock(job.out, f"export-data --to {form.name}"):
        sweep(job.out)
        parts = form.parts(job)
        tops = {part.path.partition("/")[0] for part in parts}
        record["files"] = sorted({*tops, *form.finished, CREDITS})
        earlier = read_json(job.out / RECORD) if exists(job.out / RECORD) else {}
        if earlier != record:
            _clear(job.out, earlier.get("files", ()) if isinstance(earlier, dict) else ())
            write_json(job.out / RECORD, record)
        kept = 0
        with Progress(sum(part.views for part in parts), form.name) as progress:
            for part in parts:
                target = job.out / part.path
                if target.exists():
                    kept += 1
                    progress.advance(part.views)
                    continue
                writing = atomic_directory if part.is_folder else atomic_file
                with writing(target) as path:
                    part.write(path, progress.advance)
        form.finish(job)
        _write_credits(job)
    return Exported(sum(part.views for part in parts), len(parts), kept)


def _record(form: Format, job: Job) -> dict[str, Any]:
    """Return all that determines the files of an export."""
    options = {name: value for name, value in asdict(job.options).items() if name in form.uses}
    return {
        "format": form.name,
        "revision": key("exports"),
        "options": options,
        "dataset": job.rows.fingerprint(),
        "rows": [[row.split, row.scene_id, row.view_id] for row in job.rows.rows],
    }


def _claim(folder: Path) -> None:
    """Raise `InputError` if a folder holds files that no export made."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: not a folder")
    found = {path.name for path in folder.iterdir()} - {_LOCK}
    if found and RECORD not in found:
        raise InputError(
            f"{folder}: contains other files; choose an empty or new folder with --out"
        )


def _write_credits(job: Job) -> None:
    """Write licence and attribution of every scene, if the dataset has them."""
    columns = ("licence", "attribution")
    if not job.rows.columns.issuperset(columns):
        return
    firsts = [rows[0] for rows in job.rows.scenes().values()]
    credits = [
        (row.scene_id, *(content.values[name] for name in columns))
        for row, content in job.rows.read(firsts, (), columns)
    ]
    write_csv(job.out / CREDITS, ("scene_id", *columns), credits)


def _clear(folder: Path, made: Iterable[str]) -> None:
    """Remove the files `made` of another export; raises `InputError` if there are others."""
    found = {path.name for path in folder.iterdir()} - {_LOCK, RECORD}
    others = sorted(found - {*made})
    if others:
        raise InputError(
            f"{folder}: {others[0]} is not listed in {RECORD}, so it is not replaced; move it "
            "away, or choose another folder with --out"
        )
    for name in sorted(found | {RECORD}):
        path = folder / name
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise PbrnetError(f"{path}: cannot be removed ({error.strerror})") from None


@contextmanager
def hdf5_file(path: Path) -> Iterator[Any]:
    """Yield an open HDF5 file in memory, written to `path` in the end.

    HDF5 ends the process if the disk is full while it writes.
    """
    h5py = library("h5py", "an export to HDF5")
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        path.write_bytes(file.id.get_file_image())


def library(name: str, purpose: str) -> Any:
    """Import and return a module; `MachineError` says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MachineError(
            f"{purpose} requires the library {name.split('.')[0]} ({error}); install it with: "
            "pip install 'pbrnet[export]'"
        ) from None
