"""The `scenes` stage: procedural homes and imported scenes in `data/scenes`."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import Failure, data_lock
from pbrnet.pipeline.stages.runner import StagePlan, Summary, Target, begin, execute, finish
from pbrnet.pipeline.stages.scene_jobs import (
    home_jobs,
    import_jobs,
    is_up_to_date,
    old_scenes,
    stage_fingerprint,
)
from pbrnet.pipeline.stages.scene_work import HomeJob, ImportJob, make_scene
from pbrnet.pipeline.stages.trash import Trash
from pbrnet.scenes.contract import scene_folders
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import remove_partials


def run_scenes(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Fill `data/scenes`: homes from seeds, then the imports that the parameters name.

    A scene of another tool (`pbrnet import`) is left alone and used like the others; scenes of
    this stage that the parameters no longer ask for go to the trash.
    """
    started = time.monotonic()
    data = Path(data).resolve()
    with data_lock(data, "scenes"):
        remove_partials(data / "scenes")
        plan = plan_scenes(data, params)
        begin(data, params.farm, plan)
        made = execute(data, params.farm, scheduler, plan)
        return finish(data, params.farm, plan, made, started)


def plan_scenes(data: Path, params: Params) -> StagePlan:
    """Return what the stage will do; nothing is changed."""
    root = data / "scenes"
    plan = StagePlan("scenes", "scenes", make_scene, view_size(params), renders=False)
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
    others = [one for one in scene_folders(root) if stage_fingerprint(one) is None]
    if not wanted and not plan.failures and not others:
        raise ParameterError(
            f"scenes.homes: 0 homes, no imports, and no scene in {root} leave nothing to do; "
            "raise scenes.homes, or import scenes with: pbrnet import"
        )
    plan.orphans = old_scenes(root, set(wanted))
    trash = Trash(data, params.farm.trash_days)
    for scene_id, job in wanted.items():
        if is_up_to_date(job):
            plan.kept += 1
        elif stage_fingerprint(job.folder) is None and (job.folder / "scene.json").is_file():
            error = f"{job.folder} contains a scene of another tool; rename or remove it"
            plan.failures.append(Failure("scenes", scene_id, "", error))
        elif is_up_to_date(replace(job, folder=trash.place(job.folder))):
            plan.returning.append(job.folder)
        else:
            plan.add(job, Target(job.folder, "scenes", scene_id))
    return plan
