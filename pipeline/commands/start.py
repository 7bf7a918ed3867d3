"""Announcement of a rendering command: its main settings, and the plans of its stages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from dask.system import cpu_count

from pbrnet.pipeline.channels import TRACED
from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.costs.forecast import SCENE_STAGES
from pbrnet.pipeline.dataset.pack import is_packed
from pbrnet.pipeline.farm.cluster import scheduler_address
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.stages.cameras import plan_cameras
from pbrnet.pipeline.stages.frame_stage import FRAME_STAGES, plan_frames
from pbrnet.pipeline.stages.runner import NOTHING_PENDING, Pending, StagePlan, Target, plan_line
from pbrnet.pipeline.terminal import counted, say
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.errors import InputError


def start_lines(request: Request, stages: Collection[str] = ()) -> list[str]:
    """Return lines about images, samples, views and workers of a run that is about to start.

    `stages`: the kinds of frames that are made, and `scenes` and `cameras`, whose plan has the
    number of views; all if empty.
    """
    params = request.params
    kinds = params.kinds
    wanted = {*SCENE_STAGES, *kinds} if not stages else {*stages} & {*SCENE_STAGES, *kinds}
    image = params.image
    lines = [
        f"images: {image.width}x{image.height}, framing {params.cameras.framing}, "
        f"channels {', '.join(params.channels)}"
    ]
    if wanted & set(TRACED):
        lines.append(f"samples: {_samples(params.groundtruth)}")
    scenes, views = _counted(request.data)
    if views and "cameras" not in stages:
        lines.append(f"views: {views:,} of {counted(scenes, 'scene')}")
    elif not stages and (scenes := params.scenes.most_scenes):
        views = params.cameras.most_views(scenes)
        lines.append(f"views: at most {views:,} of {counted(scenes, 'scene')}")
    address = scheduler_address(request.scheduler)
    local = f"up to {params.farm.workers or cpu_count()} on this machine"
    return [*lines, f"workers: {f'from the dask scheduler {address}' if address else local}"]


def _samples(truth: GroundTruthParams) -> str:
    """Describe the samples per pixel of the ground truth, and its denoiser."""
    words = [f"{truth.spp} per pixel"]
    if truth.noise:
        words = [f"{truth.min_spp} to {truth.spp} per pixel, until the noise is {truth.noise:g}"]
    if truth.train_spp:
        words.append(f"{truth.train_spp} in training and validation views")
    words.append("not denoised" if truth.denoise == "none" else f"denoised by {truth.denoise}")
    return ", ".join(words)


def _counted(data: Path) -> tuple[int, int]:
    """Return the numbers of scenes with cameras, and of their views; 0 where none can be read."""
    files = sorted((data / "cameras").glob("*.json"))
    try:
        return len(files), sum(len(load_cameras(file).views) for file in files)
    except InputError:  # the stage will say so
        return 0, 0


def say_plans(request: Request, names: Iterable[str]) -> bool:
    """Print what stages will make, keep and remove: as output if that is all, else on stderr.

    Returns False if that is not known yet.
    """
    names, changes = list(names), False
    try:
        for plan in plan_stages(names, request):
            say(plan_line(plan), err=not request.dry_run)
            changes |= bool(plan.items or plan.later or plan.orphans or plan.returning)
        if "dataset" in names:
            kept = not changes and is_packed(request.data, request.params)
            words = "up to date" if kept else "to be packed"
            say(f"dataset: {words}", err=not request.dry_run)
    except InputError as error:
        if not request.params.assets.enabled:
            raise
        say(f"not known before the catalogues are available: {error}", err=not request.dry_run)
        return False
    return True


def plan_stages(names: Iterable[str], request: Request) -> Iterator[StagePlan]:
    """Yield what stages of these names will do one after the other, from `scenes` to frames.

    A stage whose scenes or cameras are made before it has at most as many files to make as those
    have views. Checksums are left to the stages.
    """
    pending, data = NOTHING_PENDING, request.data.resolve()
    views: dict[str, int] = {}  # by scene
    params = replace(request.params, farm=replace(request.params.farm, checksums=False))
    for name in names:
        if name == "scenes":
            from pbrnet.pipeline.stages.scenes import plan_scenes  # stages that render do without

            plan = plan_scenes(data, params)
            gone = frozenset(folder.name for folder in plan.orphans)
            pending = Pending(_changed(plan), gone)
        elif name == "cameras":
            plan = plan_cameras(data, params, pending)[0]
            plan.later = [Target(data, name, scene) for scene in sorted(pending.changed)]
            plan.views |= dict.fromkeys(pending.changed, params.cameras.most_views())
            if plan.later and params.scenes.imports and params.cameras.stored_views:
                plan.notes.append("stored cameras of new imports not counted")
            pending, views = Pending(pending.changed | _changed(plan), pending.gone), plan.views
        elif name in FRAME_STAGES:
            plan = plan_frames(name, data, params, pending)[0]
            plan.later = [
                Target(data, kind, scene, f"view {number}")
                for scene in sorted(pending.changed)
                for number in range(views.get(scene, params.cameras.most_views()))
                for kind in FRAME_STAGES[name]
                if kind in params.kinds
            ]
        else:
            continue
        yield plan


def _changed(plan: StagePlan) -> frozenset[str]:
    """Return the scenes that a stage makes or puts back from the trash."""
    made = {target.scene_id for target in plan.outputs}
    return frozenset(made | {path.name.removesuffix(".json") for path in plan.returning})
