"""Scenes beside a released dataset: one exported file for each, in its folder `scenes`.

They are exported to `OUT/exports/scenes-FORMAT` and kept there, so that an interrupted release
exports only what is missing or changed, and linked into the dataset.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from pbrnet.pipeline.dataset.description.facts import attribution_of, licence_of
from pbrnet.pipeline.dataset.shards import SCENES, write_sums
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.scene_export.export import TARGETS, export_scene
from pbrnet.pipeline.splits import Source, read_sources
from pbrnet.pipeline.templating import plain_markdown
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import (
    atomic_directory,
    digest_bytes,
    digest_file,
    digest_folder,
    exists,
    read_json,
    read_text,
    remove_partials,
    write_json,
    write_text,
)

FORMATS = tuple(name for name in TARGETS if name != "usd")  # of one file a scene: usdz for USD
_MADE = "made.json"  # from which scene each export was made, and its files


@dataclass(frozen=True)
class Made:
    """An export that was made: a digest of what it was made from, and the sums of its files."""

    origin: str
    files: dict[str, str]


@dataclass(frozen=True)
class Beside:
    """Scenes that a release holds: each with the names of its files, and those left out."""

    format: str
    files: tuple[tuple[Scene, tuple[str, ...]], ...]
    unlicensed: tuple[str, ...]  # scenes whose licence or author is unknown

    @property
    def count(self) -> int:
        """Number of files."""
        return sum(len(names) for _, names in self.files)


def add_scenes(out: Path, format_: str) -> Beside:
    """Export the scenes of the release in `out` to `out/dataset/scenes`, and list them on its card.

    Scenes without views, and those whose licence or author is unknown, are left out. Checksums are
    renewed. Raises `InputError` for a scene that cannot be exported.
    """
    dataset, folder = out / "dataset", out / "exports" / f"scenes-{format_}"
    sources = [source for source in read_sources(out) if source.views]
    with data_lock(out, "release --scenes"):
        folder.mkdir(parents=True, exist_ok=True)
        remove_partials(folder)
        known = [source for source in sources if not _is_unknown(source.scene)]
        files = tuple(_exported(out, folder, format_, known))
        with atomic_directory(dataset / SCENES) as partial:
            for _, names in files:
                for name in names:
                    _link(folder / name, partial / name)
        left = tuple(source.scene.scene_id for source in sources if _is_unknown(source.scene))
        beside = Beside(format_, files, left)
        card = dataset / "README.md"
        write_text(card, read_text(card).rstrip("\n") + "\n\n" + _section(beside) + "\n")
        write_sums(dataset)
    return beside


def _exported(
    out: Path, folder: Path, format_: str, sources: Sequence[Source]
) -> Iterator[tuple[Scene, tuple[str, ...]]]:
    """Yield each scene with the names of its files in `folder`; what is up to date is kept."""
    made = _records(folder)
    with Progress(len(sources), "scenes", unit="scenes") as progress:
        for source in sources:
            scene = source.scene
            origin = _origin(out, scene)
            record = made.get(scene.scene_id)
            if record is None or record.origin != origin or not _is_whole(folder, record.files):
                target = folder / f"{scene.scene_id}{TARGETS[format_].suffixes[0]}"
                done = export_scene(scene.folder, format_, target)
                sums = {path.name: digest_file(path) for path in done.files}
                record = made[scene.scene_id] = Made(origin, sums)
                write_json(folder / _MADE, {name: plain(one) for name, one in made.items()})
            progress.advance()
            yield scene, tuple(record.files)


def _records(folder: Path) -> dict[str, Made]:
    """The record of the exports in `folder`; {} if there is none or it is damaged."""
    path = folder / _MADE
    try:
        found = read_json(path) if exists(path) else {}
        return {name: build(Made, one, str(path), InputError) for name, one in found.items()}
    except (InputError, AttributeError):  # made again
        return {}


def _is_whole(folder: Path, files: dict[str, str]) -> bool:
    """Test whether the files of an export are there, as they were written."""
    return bool(files) and all(
        exists(path := folder / name) and digest_file(path) == sum_ for name, sum_ in files.items()
    )


def _origin(out: Path, scene: Scene) -> str:
    """Digest of all that an export is made from."""
    cameras = out / "cameras" / f"{scene.scene_id}.json"
    parts = (version("pbrnet"), digest_folder(scene.folder), digest_file(cameras))
    return digest_bytes(*(part.encode() for part in parts))


def _is_unknown(scene: Scene) -> bool:
    credits = scene.credits
    return not credits or any("unknown" in (one.author, one.licence) for one in credits)


def _link(source: Path, target: Path) -> None:
    """Link a file, or copy it where the file system has no links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _section(beside: Beside) -> str:
    """The section of the card: files, licences, authors."""
    lines = [
        "## Scenes",
        "",
        f"`{SCENES}/` holds the scenes themselves, {TARGETS[beside.format].title}, by "
        f"`pbrnet export-scene --to {beside.format}`.",
        "",
        "| files | licence | title, author (licence) |",
        "|---|---|---|",
    ]
    for scene, names in beside.files:
        shown = ", ".join(f"`{name}`" for name in names)
        licence, credit = plain_markdown(licence_of(scene)), plain_markdown(attribution_of(scene))
        lines.append(f"| {shown} | {licence} | {credit} |")
    if beside.unlicensed:
        left = ", ".join(f"`{name}`" for name in beside.unlicensed)
        lines += ["", f"Left out, because their licence or author is unknown: {left}."]
    return "\n".join(lines)
