"""Rendering of frames of every view: the common part of the stages that write EXR files.

A frame is kept while its fingerprint holds. Out-of-date frames are rendered again and orphan
frames, which belong to no view any more, are removed. So a killed run resumes, a changed parameter
leaves no stale data, and a run with nothing to do starts no worker.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.frames import frame_path, holds
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import (
    TRACE_OF,
    frame_fingerprint,
    settings_of,
    trace_seed,
)
from pbrnet.pipeline.records import Failure, data_lock
from pbrnet.pipeline.splits import split_sampling
from pbrnet.pipeline.stages.cameras import camera_fingerprints
from pbrnet.pipeline.stages.render_jobs import FrameJob, render_frames
from pbrnet.pipeline.stages.runner import StagePlan, Summary, Target, execute, finish, threaded
from pbrnet.pipeline.stages.scene_listing import (
    SAFE_NAME,
    active_renderer,
    list_scenes,
    scene_digests,
)
from pbrnet.pipeline.terminal import say
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import remove_partials

# Kinds of frames that each stage renders: those that the parameters ask for, of each its folder.
FRAME_STAGES: dict[str, tuple[Kind, ...]] = {
    "inputs": ("inputs", "materials", "labels", "video"),
    "illumination": ("illumination", "visibility"),
    "groundtruth": ("shading", "color", "light", "noisy", "environment", "transport"),
    "shading": ("shading",),  # half of groundtruth, as the next one
    "color": ("color",),
}


def run_frames(stage: str, data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Bring the frames of a stage of `FRAME_STAGES` up to date for all views of `data`."""
    started = time.monotonic()
    data, kinds = Path(data).resolve(), FRAME_STAGES[stage]
    for kind in kinds[1:]:  # DVC expects every output folder of a stage, also an empty one
        (data / kind).mkdir(parents=True, exist_ok=True)
    with data_lock(data, stage):
        renderer = active_renderer(params.farm)
        wanted = [kind for kind in kinds if kind in params.kinds]
        plan = StagePlan(stage, "views" if len(wanted) == 1 else "frames", render_frames)
        scenes = list_scenes(data, plan)
        digests = scene_digests(data, scenes)
        of_cameras = ViewParams(params.cameras, params.image)
        cameras = camera_fingerprints(scenes, of_cameras, params.seed, digests, renderer)
        views = _views(data, cameras, plan)
        expected: dict[Path, _ExpectedFrame] = {}
        seen = sorted({view.scene_id for view in views})
        sampling = split_sampling(
            [scenes[name] for name in seen],
            *(params.groundtruth, params.noisy, params.dataset.splits, params.seed),
        )
        settings = {
            name: settings_of(replace(params, groundtruth=truth, noisy=noisy), wanted)
            for name, (truth, noisy) in sampling.items()
        }
        for kind in kinds:
            for view in views if kind in wanted else ():
                own, scene = settings[view.scene_id][kind], digests[view.scene_id]
                digest = frame_fingerprint(kind, view, own, params.seed, scene, renderer)
                expected[frame_path(data, kind, view)] = _ExpectedFrame(kind, view, own, digest)
            # An unreadable scene may be repaired: its frames are not orphans.
            unreadable = {failure.scene_id for failure in plan.failures}
            plan.removed += _remove_orphans(data / kind, expected, unreadable)
        stale = _stale(expected, params.farm.checksums)
        plan.kept = len(expected) - len(stale)
        for paths in _by_trace(stale):
            frames = [expected[path] for path in paths]
            view, first = frames[0].view, frames[0].kind
            job = FrameJob(
                data,
                view,
                digests[view.scene_id],
                {frame.kind: frame.settings for frame in frames},
                {frame.kind: frame.fingerprint for frame in frames},
                trace_seed(first, view, params.seed),
            )
            plan.add(job, *(expected[path].target(path) for path in paths))
        made = execute(data, params.farm, scheduler, plan, renderer)
        # A worker of an earlier run may still have been alive and have overwritten a frame.
        written = {path: expected[path] for path in stale if made[path]}
        for path in _stale(written, verify=False):
            made[path] = False
            target = expected[path].target(path)
            error = f"{path} was overwritten by another run; run the same command again"
            plan.failures.append(Failure(target.stage, target.scene_id, target.view_id, error))
        return finish(data, plan, made, started)


@dataclass(frozen=True)
class _ExpectedFrame:
    """A frame that the data folder should hold."""

    kind: Kind
    view: View
    settings: Any  # of its trace
    fingerprint: str

    def target(self, path: Path) -> Target:
        return Target(path, self.kind, self.view.scene_id, self.view.view_id)


def _by_trace(frames: dict[Path, _ExpectedFrame]) -> list[list[Path]]:
    """Group frames that one trace renders; sorted by scene, then trace.

    In this order a worker changes scenes and kernels as rarely as possible.
    """
    groups: dict[tuple[str, str, str], list[Path]] = defaultdict(list)
    for path, frame in frames.items():
        trace = TRACE_OF[frame.kind]
        name = trace.kinds[0] if trace.together(frame.settings) else frame.kind
        groups[frame.view.scene_id, name, frame.view.view_id].append(path)
    return [groups[key] for key in sorted(groups)]


def _views(data: Path, expected: Mapping[str, str], plan: StagePlan) -> list[View]:
    """Return the views of all scenes, sorted; add broken camera files to the plan's failures.

    `expected`: the fingerprint of each scene's camera file.
    """
    views: list[View] = []
    stale = []
    for scene_id in expected:
        path = data / "cameras" / f"{scene_id}.json"
        try:
            if not path.is_file():
                raise InputError(f"{path}: no cameras for this scene; run first: pbrnet cameras")
            file = load_cameras(path)
            for view in file.views:
                if view.scene_id != scene_id or not SAFE_NAME.fullmatch(view.view_id):
                    raise InputError(
                        f"{path}: view {view.view_id!r} of scene {view.scene_id!r} cannot be "
                        f"a view of {scene_id!r}; run again: pbrnet cameras"
                    )
        except InputError as error:
            plan.failures.append(Failure(plan.stage, scene_id, "", str(error)))
            continue
        if file.fingerprint != expected[scene_id]:
            stale.append(scene_id)
        views += file.views
    if stale:
        say(
            f"note: the cameras of {_some(stale)} were sampled with other parameters or in "
            "another version of the scene; to sample them again, run: pbrnet cameras",
            err=True,
        )
    if not views and not plan.failures:
        raise InputError(
            f"{data / 'cameras'}: no scene has a view; 'pbrnet cameras' lists the reasons, and "
            "cameras.min_objects or cameras.min_score may be too high"
        )
    return sorted(views, key=lambda view: (view.scene_id, view.view_id))


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _stale(expected: dict[Path, _ExpectedFrame], verify: bool) -> dict[Path, _ExpectedFrame]:
    """Return the frames that are missing, truncated or have another fingerprint.

    With `verify` also those whose pixels do not match their checksum.
    """
    paths = list(expected)
    good = threaded(lambda path: holds(path, expected[path].fingerprint, verify), paths)
    return {path: expected[path] for path, fine in zip(paths, good, strict=True) if not fine}


def _remove_orphans(root: Path, expected: dict[Path, Any], unreadable: set[str]) -> int:
    """Remove orphan frames and partial files below `root`; return how many.

    Removes only EXR files one folder deep, partial files, and folders that are empty afterwards;
    frames of `unreadable` scenes stay. Other files are named in a note and kept.
    """
    removed = remove_partials(root)
    foreign = []
    for folder in sorted(root.iterdir()) if root.is_dir() else ():
        if not folder.is_dir():
            foreign.append(folder)
            continue
        removed += remove_partials(folder)
        for file in sorted(folder.iterdir()):
            if file in expected:
                continue
            if file.is_file() and file.suffix == ".exr":
                if folder.name not in unreadable:
                    file.unlink()
                    removed += 1
            else:
                foreign.append(file)
        if not any(folder.iterdir()):
            folder.rmdir()
    if foreign:
        say(
            f"note: kept files that this stage did not write: {_some([str(p) for p in foreign])}",
            err=True,
        )
    return removed
