"""The `scenes` stage: procedural homes and imported scenes in `data/scenes`."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.farm.versions import STAGE_FILES_KEY, STAGE_KEY
from pbrnet.pipeline.frames import fingerprint
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import Failure, data_lock
from pbrnet.pipeline.stages.limits import Limits
from pbrnet.pipeline.stages.runner import StagePlan, Summary, Target, begin, execute, finish
from pbrnet.pipeline.stages.scene_work import HomeJob, ImportJob, ImportVariant, make_scene
from pbrnet.scenes.assets.index import INDEX, load_index
from pbrnet.scenes.contract import load_scene, scene_folders
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_file, exists, remove_partials, resolved, write_text
from pbrnet.scenes.layout.describe import described, layout_text
from pbrnet.scenes.layout.from_scene import described_scene
from pbrnet.scenes.opened_files import unchanged
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.design import HomeSeeds, design_home
from pbrnet.scenes.registry import ImportEntry
from pbrnet.scenes.seeds import derive

_LONGEST_NAME = 100  # characters; `-v12` and the like follow
_GENERAL_NAMES = ("scene", "main", "main_template_color", "index")  # the third: of a PBRS house


def run_scenes(
    data: Path,
    params: Params,
    scheduler: str | None = None,
    only: Collection[str] | None = None,
) -> Summary:
    """Fill `data/scenes`: homes from seeds, then the imports that the parameters name.

    A scene of another tool (`pbrnet import`) is left alone and used like the others; scenes of
    this stage that the parameters, or `only`, do not ask for go to the trash.
    """
    data = Path(data).resolve()
    with data_lock(data, "scenes"):
        remove_partials(data / "scenes")
        plan = plan_scenes(data, params, only)
        begin(plan)
        made = execute([plan], scheduler)
        return finish(plan, made)


def describe_homes(data: Path, wanted: SceneParams, seed: int, out: Path) -> list[Path]:
    """Write the procedural homes of the parameters to a folder as layouts; returns the files.

    No scene is made. A home is a file `home-0000.layout.json`, see `pbrnet.scenes.layout`.
    """
    written = []
    for job in home_jobs(Path(data).resolve() / "scenes", wanted, seed):
        varied = frozenset(job.params.vary) if job.variant else frozenset()
        seeds = HomeSeeds(job.seed, job.variant, varied)
        design = design_home(job.params, seeds, job.assets)
        place = Path(out) / f"{job.scene_id}.layout.json"
        place.parent.mkdir(parents=True, exist_ok=True)
        write_text(place, layout_text(described(design, job.scene_id, job.seed)))
        written.append(place)
    return written


def describe_scenes(folders: Iterable[Path], out: Path) -> list[Path]:
    """Write scene folders as layouts to a folder; returns the files."""
    written = []
    for scene in map(load_scene, folders):
        if not scene.rooms:
            raise InputError(f"{scene.folder}: has no rooms, so no layout")
        place = Path(out) / f"{scene.scene_id}.layout.json"
        if place in written:
            raise InputError(f"{scene.folder}: a second scene with the id {scene.scene_id!r}")
        place.parent.mkdir(parents=True, exist_ok=True)
        write_text(place, layout_text(described_scene(scene)))
        written.append(place)
    return written


def plan_scenes(data: Path, params: Params, only: Collection[str] | None = None) -> StagePlan:
    """Return what the stage will do, with the scenes `only` if given; nothing is changed."""
    root = data / "scenes"
    size = view_size(params)
    plan = StagePlan(data, params.farm, size, "scenes", "scenes", make_scene, renders=False)
    wanted: dict[str, HomeJob | ImportJob] = {}
    jobs: list[HomeJob | ImportJob] = [*home_jobs(root, params.scenes, params.seed)]
    jobs += import_jobs(root, params.scenes, params.seed, plan.failures)
    for job in jobs:
        if job.scene_id in wanted:
            raise InputError(
                f"scenes.imports: two scenes have the id {job.scene_id!r}; give one of them "
                "another id"
            )
        wanted[job.scene_id] = job
    if only is not None:
        wanted = {scene_id: job for scene_id, job in wanted.items() if scene_id in only}
    marks = {one: stage_fingerprint(one) for one in scene_folders(root)}
    others = sum(mark is None for mark in marks.values())
    plan.notes += [f"{others} of 'pbrnet import'"] if others else []
    if not wanted and not plan.failures and not others:
        raise ParameterError(
            f"scenes.homes: 0 homes, no imports, and no scene in {root} leave nothing to do; "
            "raise scenes.homes, or import scenes with: pbrnet import"
        )
    plan.orphans = [one for one, mark in marks.items() if mark and one.name not in wanted]
    for scene_id, job in wanted.items():
        if is_up_to_date(job, marks.get(job.folder)):
            plan.kept += 1
        elif job.folder in marks and marks[job.folder] is None:
            error = f"{job.folder} contains a scene of another tool; rename or remove it"
            plan.failures.append(Failure("scenes", scene_id, "", error))
        elif _is_in(plan.trash.place(job.folder), job):
            plan.returning.append(job.folder)
        else:
            plan.add(job, Target(job.folder, "scenes", scene_id))
    return plan


def home_jobs(root: Path, wanted: SceneParams, seed: int) -> Iterable[HomeJob]:
    """Yield a job for each procedural home and variant, with its fingerprint.

    The fingerprint covers the seed, the parameters, the furniture index and the key
    of the generator. Raises `InputError` if catalogue furniture is asked for and there is none.
    """
    furnished = replace(wanted, catalogue_share=wanted.furnished_share)
    yield from _homes(root, wanted, seed, "home", wanted.homes)
    yield from _homes(root, furnished, seed, "furnished", wanted.furnished_homes)


def _homes(
    root: Path, wanted: SceneParams, root_seed: int, name: str, count: int
) -> Iterable[HomeJob]:
    """Yield homes `name`-0000 and so on."""
    share = wanted.catalogue_share
    assets = root.parent / "assets"
    further: dict[str, Any] = {}  # what the fingerprint has only where it is not the default
    if share > 0 and count:
        if not load_index(assets).pieces:
            option, asked = (
                ("catalogue_share", share) if name == "home" else (f"{name}_homes", count)
            )
            raise InputError(
                f"scenes.{option}: {asked:g}, but {assets} holds no "
                "furniture; set assets.enabled to true and run first: pbrnet assets"
            )
        further = {
            "share": share,
            "triangles": wanted.catalogue_triangles,
            "catalogue": digest_file(assets / INDEX),
        }
    if wanted.outdoors != "surroundings":
        further["outdoors"] = wanted.outdoors
    for index, variant in product(range(count), range(wanted.variants)):
        scene_id = f"{name}-{index:04d}" + (f"-v{variant}" if variant else "")
        setting = index + (variant if "light" in wanted.vary else 0)
        lighting = wanted.lighting[setting % len(wanted.lighting)]
        seed = derive(root_seed, name, index)
        expected = fingerprint(
            kind="home",
            revision=key("scenes.homes"),
            scene_id=scene_id,
            seed=seed,
            lighting=lighting,
            rooms=(wanted.rooms_min, wanted.rooms_max),
            styles=wanted.styles,
            texture_size=wanted.texture_size,
            varied=(variant, *sorted(wanted.vary)) if variant else (),
            **further,
        )
        yield HomeJob(root / scene_id, scene_id, wanted, seed, lighting, variant, expected, assets)


def import_jobs(
    root: Path, wanted: SceneParams, root_seed: int, failures: list[Failure]
) -> Iterable[ImportJob]:
    """Yield a job for each import and variant; a missing file is added to `failures`."""
    limits = Limits(
        wanted.import_seconds,
        wanted.import_memory,
        options=("scenes.import_seconds", "scenes.import_memory"),
    )
    for named in wanted.imports:
        entry = ImportEntry(file=named) if isinstance(named, str) else named
        path = resolved(Path(entry.file).expanduser())
        scene_id = entry.id or scene_name(path)
        options = entry.options()
        missing = [one for one in (path, options.get("root", path)) if not exists(one)]
        if missing:
            error = (
                f"{entry.file}: no such file"
                if missing[0] == path
                else f"{missing[0]}: no such folder (root of {entry.file})"
            )
            failures.append(Failure("scenes", scene_id, "", error))
            continue
        content: dict[str, Any] = {"file": path.name, "revision": key("scenes.imports")}
        if options:
            content["options"] = entry.given()
        if "catalogue" in options and exists(options["catalogue"] / INDEX):
            content["catalogue"] = digest_file(options["catalogue"] / INDEX)
        expected = fingerprint(kind="import", scene_id=scene_id, **content)
        yield ImportJob(root / scene_id, scene_id, path, expected, limits, options)
        seed = derive(root_seed, "import", scene_id)
        for variant in range(1, wanted.variants):
            own_id = f"{scene_id}-v{variant}"
            expected = fingerprint(
                kind="import",
                scene_id=own_id,
                seed=seed,
                lighting=wanted.lighting,
                texture_size=wanted.texture_size,
                varied=(variant, *sorted(wanted.vary)),
                **content,
            )
            made = ImportVariant(scene_id, variant, wanted, seed)
            yield ImportJob(root / own_id, own_id, path, expected, limits, options, made)


def scene_name(path: Path) -> str:
    """Return a scene id made from the name of a file, or of its folder for general names."""
    stem = path.stem if path.suffix else path.name
    if stem.lower() in _GENERAL_NAMES and path.parent.name:
        stem = path.parent.name
    return re.sub(r"[^A-Za-z0-9]+", "-", stem).strip("-")[:_LONGEST_NAME].strip("-") or "scene"


def _is_in(folder: Path, job: HomeJob | ImportJob) -> bool:
    """Return whether a folder, of the trash, holds the scene of a job."""
    return is_up_to_date(replace(job, folder=folder), stage_fingerprint(folder))


def is_up_to_date(job: HomeJob | ImportJob, mark: str | None) -> bool:
    """Return whether the scene of a job is there: `mark` is that of its folder.

    For an import, all files that it looked for must be unchanged: none edited, none removed, none
    added in a place where it looked.
    """
    if mark != job.fingerprint:
        return False
    if isinstance(job, HomeJob):
        return True
    return unchanged(load_scene(job.folder).source.get(STAGE_FILES_KEY), job.source_folder)


def stage_fingerprint(folder: Path) -> str | None:
    """Return the fingerprint that this stage left in a scene; None if it made no scene there.

    For a scene that cannot be read it is the empty string: the stage makes it again.
    """
    if not folder.is_dir():
        return None
    try:
        found = load_scene(folder).source.get(STAGE_KEY)
    except InputError:
        return ""
    return str(found) if found is not None else None
