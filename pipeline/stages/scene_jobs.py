"""Which scenes the parameters ask for: a job and a fingerprint each, and whose a folder is."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import scenes
from pipeline.farm.scene_digest import STAGE_MARK
from pipeline.frames import fingerprint
from pipeline.params import Params
from pipeline.records import Failure
from pipeline.stages.import_files import digest_import, scene_name
from pipeline.stages.scene_work import HomeJob, ImportJob, ImportVariant
from scenes.assets.index import INDEX, load_index
from scenes.contract import load_scene, scene_folders
from scenes.errors import InputError
from scenes.files import digest_bytes, digest_file
from scenes.import_options import ImportEntry
from scenes.seeds import derive


def home_jobs(root: Path, params: Params) -> Iterable[HomeJob]:
    wanted = params.scenes
    yield from _homes(root, params, "home", wanted.homes, wanted.catalogue_share)
    yield from _homes(root, params, "furnished", wanted.furnished_homes, wanted.furnished_share)


def _homes(root: Path, params: Params, name: str, count: int, share: float) -> Iterable[HomeJob]:
    """Homes `name`-0000 and so on, with a share of their furniture from the catalogues."""
    wanted = replace(params.scenes, catalogue_share=share)
    assets = root.parent / "assets"
    bought: dict[str, Any] = {}
    if share > 0 and count:
        if not load_index(assets).pieces:
            option = "catalogue_share" if name == "home" else f"{name}_homes"
            raise InputError(
                f"scenes.{option}: {getattr(params.scenes, option):g}, but {assets} holds no "
                "furniture; set assets.enabled to true and run first: pbrnet assets"
            )
        bought = {
            "share": share,
            "triangles": wanted.catalogue_triangles,
            "catalogue": digest_file(assets / INDEX),
        }
    revision = _revision()
    for index, variant in product(range(count), range(wanted.variants)):
        scene_id = f"{name}-{index:04d}" + (f"-v{variant}" if variant else "")
        turn = index + (variant if "light" in wanted.vary else 0)
        lighting = wanted.lighting[turn % len(wanted.lighting)]
        seed = derive(params.seed, name, index)
        mark = fingerprint(
            kind="home",
            revision=revision,
            scene_id=scene_id,
            seed=seed,
            lighting=lighting,
            rooms=(wanted.rooms_min, wanted.rooms_max),
            texture_size=wanted.texture_size,
            varied=(variant, *sorted(wanted.vary)) if variant else (),
            **bought,
        )
        yield HomeJob(root / scene_id, scene_id, wanted, seed, lighting, variant, mark, assets)


def _revision() -> str:
    """A digest of the sources of `scenes`: what they make is made anew when they change.

    They stand for a revision: a scene is made in seconds, and frames ask for its content, not
    for this.
    """
    sources = sorted(Path(scenes.__file__).parent.rglob("*.py"))
    return digest_bytes(*(digest_file(source).encode() for source in sources))


def import_jobs(root: Path, params: Params, failures: list[Failure]) -> Iterable[ImportJob]:
    wanted = params.scenes
    revision = _revision()
    for named in wanted.imports:
        entry = ImportEntry(named) if isinstance(named, str) else named
        path = Path(entry.file).expanduser().resolve()
        scene_id = entry.id or scene_name(path)
        options = entry.options()
        missing = [one for one in (path, options.get("root", path)) if not one.exists()]
        if missing:
            words = (
                f"{entry.file}: no such file" if missing[0] == path else f"{missing[0]}: no root"
            )
            failures.append(Failure("scenes", scene_id, "", words))
            continue
        content: dict[str, Any] = {"content": digest_import(path, entry), "revision": revision}
        if options:
            content["options"] = entry.given()
        mark = fingerprint(kind="import", scene_id=scene_id, **content)
        yield ImportJob(root / scene_id, scene_id, path, mark, options)
        seed = derive(params.seed, "import", scene_id)
        for variant in range(1, wanted.variants):
            own_id = f"{scene_id}-v{variant}"
            mark = fingerprint(
                kind="import",
                scene_id=own_id,
                seed=seed,
                lighting=wanted.lighting,
                texture_size=wanted.texture_size,
                varied=(variant, *sorted(wanted.vary)),
                **content,
            )
            made = ImportVariant(scene_id, variant, wanted, seed)
            yield ImportJob(root / own_id, own_id, path, mark, options, made)


def mark_of(folder: Path) -> str | None:
    """The fingerprint this stage left in a complete scene; None: another tool's, or none.

    A broken scene of ours counts as ours without fingerprint, to be made again.
    """
    if not folder.is_dir():
        return None
    try:
        mark = load_scene(folder).source.get(STAGE_MARK)
    except InputError:
        return ""
    return str(mark) if mark is not None else None


def remove_old_scenes(root: Path, wanted: set[str]) -> int:
    removed = 0
    for folder in scene_folders(root):
        if folder.name not in wanted and mark_of(folder):
            shutil.rmtree(folder)
            removed += 1
    return removed
