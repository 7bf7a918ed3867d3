"""Announcement of a rendering command: its main settings, and what its stages will do."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from pathlib import Path

from dask.system import cpu_count

from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.costs.forecast import SCENE_STAGES
from pbrnet.pipeline.dataset.pack import is_packed
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.stages.plans import plan_stages
from pbrnet.pipeline.stages.runner import plan_line
from pbrnet.pipeline.terminal import say
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.errors import InputError

_TRUTHS = {"shading", "color", "light"}  # of one trace, which the forecast calls "truth"


def say_start(request: Request, stages: Collection[str] = ()) -> None:
    """Print on stderr what matters of a run that is about to start; see `start_lines`."""
    for line in start_lines(request, stages):
        say(line, err=True)


def start_lines(request: Request, stages: Collection[str] = ()) -> list[str]:
    """Return lines about images, samples, views and workers of a run.

    `stages`: the kinds of frames that are made, and `scenes` and `cameras`; all if empty.
    """
    params = request.params
    kinds = params.kinds
    wanted = {*SCENE_STAGES, *kinds} if not stages else {*stages} & {*SCENE_STAGES, *kinds}
    image = params.image
    lines = [
        f"images: {image.width}x{image.height}, framing {params.cameras.framing}, "
        f"channels {', '.join(params.channels)}"
    ]
    if wanted & _TRUTHS:
        lines.append(f"samples: {_samples(params.groundtruth)}")
    scenes, views = _counted(request.data)
    words = f"{views:,} of {scenes:,} scenes" if views else ""
    if not views:
        scenes = params.scenes.most_scenes
        views = scenes * params.cameras.most_views
        words = f"at most {views:,} of {scenes:,} scenes" if scenes else ""
    lines += [f"views: {words}"] if words else []
    return [*lines, f"workers: {_workers(params.farm, request.scheduler)}"]


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


def _workers(params: FarmParams, scheduler: str | None) -> str:
    address = scheduler or os.environ.get("DASK_SCHEDULER_ADDRESS")
    if address:
        return f"from the dask scheduler {address}"
    return f"up to {params.workers or cpu_count()} on this machine"


def say_plans(request: Request, names: Iterable[str]) -> None:
    """Print what stages will make, keep and remove: as output if that is all, else on stderr."""
    names, changes = list(names), False
    try:
        for plan in plan_stages(names, request.data, request.params):
            say(plan_line(request.data, plan, request.params.farm), err=not request.dry_run)
            changes |= bool(plan.items or plan.later or plan.orphans or plan.returning)
        if "dataset" in names:
            kept = not changes and is_packed(request.data, request.params)
            words = "up to date" if kept else "to be packed"
            say(f"dataset: {words}", err=not request.dry_run)
    except InputError as error:
        if not request.params.assets.enabled:
            raise
        say(f"not known before the catalogues are available: {error}", err=not request.dry_run)
