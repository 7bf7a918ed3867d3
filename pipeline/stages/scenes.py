"""The `scenes` stage: procedural homes and imported scenes in `data/scenes`."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.farm.limits import Limits, StoppedError, run_limited
from pbrnet.pipeline.farm.versions import memory_columns
from pbrnet.pipeline.frames import fingerprint
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import Failure, data_lock
from pbrnet.pipeline.stages.runner import StagePlan, Summary, Target, begin, execute, finish
from pbrnet.scenes.assets.index import INDEX, load_index
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import (
    STAGE_FILES_KEY,
    STAGE_KEY,
    Scene,
    load_scene,
    save_scene,
    scene_folders,
)
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_file, exists, remove_partials, resolved
from pbrnet.scenes.looks import HomeSettings
from pbrnet.scenes.opened_files import OpenedFiles, unchanged
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.registry import ImportEntry, import_scene, scene_name
from pbrnet.scenes.seeds import derive
from pbrnet.scenes.variants.vary import VariantSettings, import_variant


@dataclass(frozen=True)
class HomeJob:
    """Make one procedural home."""

    folder: Path
    scene_id: str
    fingerprint: str
    home: HomeSettings
    assets: Path  # converted catalogues, of which the home takes a share


@dataclass(frozen=True)
class ImportJob:
    """Import one scene file, as it is or as a variant of the scene `of`."""

    folder: Path
    scene_id: str
    fingerprint: str
    path: Path
    limits: Limits
    options: dict[str, Any]  # of `import_scene`
    of: str = ""
    variant: VariantSettings | None = None

    @property
    def source_folder(self) -> Path:
        """Folder that the import reads from."""
        return self.path if self.path.is_dir() else self.path.parent


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


def make_scene(job: HomeJob | ImportJob) -> dict[str, Any]:
    """Write one scene folder, with the job's fingerprint in its `scene.json`.

    Returns its costs, or why an import was stopped, which another attempt would not change. Imports
    run in child processes within limits.
    """
    if isinstance(job, HomeJob):
        _stamp(job, make_home(job.folder, job.scene_id, job.home, job.assets))
        return {"costs": memory_columns()}
    try:
        peak = run_limited(partial(_import, job), job.limits, str(job.path)) / (1 << 20)
    except StoppedError as error:
        return {"failed": {"scenes": str(error)}}
    return {"costs": {"memory_mb": peak, "peak_mb": peak}}


def _import(job: ImportJob) -> None:
    opened, place = OpenedFiles(job.source_folder), (job.path, job.folder, job.scene_id)
    if job.variant is None:
        scene = import_scene(*place, opened, **job.options)
    else:
        scene = import_variant(*place, job.variant, job.of, opened, **job.options)
    _stamp(job, scene, **{STAGE_FILES_KEY: opened.record()})


def _stamp(job: HomeJob | ImportJob, scene: Scene, **keys: Any) -> None:
    """Write the fingerprint and further keys to a scene's source.

    Until then the folder is out of date: a kill in between costs a repeat.
    """
    save_scene(
        job.folder, replace(scene, source={**scene.source, STAGE_KEY: job.fingerprint, **keys})
    )


def home_jobs(root: Path, wanted: SceneParams, seed: int) -> Iterator[HomeJob]:
    """Yield a job for each home of the parameters, with its fingerprint."""
    assets = root.parent / "assets"
    for scene_id, home in homes_of(wanted, seed, assets):
        content = plain(home, brief=True)
        mark = fingerprint(kind="home", revision=key("scenes.homes"), scene_id=scene_id, **content)
        yield HomeJob(root / scene_id, scene_id, mark, home, assets)


def homes_of(
    wanted: SceneParams, root_seed: int, assets: Path
) -> Iterator[tuple[str, HomeSettings]]:
    """Yield id and settings of each home and variant: `home-0000` and so on, then `furnished-0000`.

    Raises `InputError` if catalogue furniture is asked for and there is none in `assets`.
    """
    furnished = replace(wanted, catalogue_share=wanted.furnished_share)
    for name, count, own in (
        ("home", wanted.homes, wanted), ("furnished", wanted.furnished_homes, furnished),
    ):  # fmt: skip
        digest = ""
        if own.catalogue_share > 0 and count:
            if not load_index(assets).pieces:
                asked = f"catalogue_share: {own.catalogue_share:g}"
                asked = asked if name == "home" else f"furnished_homes: {count:g}"
                raise InputError(
                    f"scenes.{asked}, but {assets} holds no "
                    "furniture; set assets.enabled to true and run first: pbrnet assets"
                )
            digest = digest_file(assets / INDEX)
        for index, variant in product(range(count), range(wanted.variants)):
            setting = index + (variant if "light" in wanted.vary else 0)
            lighting = wanted.lighting[setting % len(wanted.lighting)]
            scene_id = f"{name}-{index:04d}" + (f"-v{variant}" if variant else "")
            yield scene_id, own.home(derive(root_seed, name, index), lighting, variant, digest)


def import_jobs(
    root: Path, wanted: SceneParams, root_seed: int, failures: list[Failure]
) -> Iterator[ImportJob]:
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
        yield ImportJob(root / scene_id, scene_id, expected, path, limits, options)
        seed = derive(root_seed, "import", scene_id)
        for variant in range(1, wanted.variants):
            own_id, varied = f"{scene_id}-v{variant}", VariantSettings.of(wanted, seed, variant)
            expected = fingerprint(kind="import", scene_id=own_id, **content, **plain(varied))
            yield ImportJob(
                root / own_id, own_id, expected, path, limits, options, scene_id, varied
            )


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
