"""The stages that fill the data folder: scenes, cameras, inputs, illumination, ground truth.

Each one is the same in outline: say what should be there and by what fingerprint, keep what holds,
remove what belongs to nothing any more, have the farm make the rest, and check that all of it is
there. So a killed run resumes, a changed parameter never leaves stale data, and a run with
nothing to do starts no worker.
"""

from __future__ import annotations

import re
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline.farm.scene_digest import scene_digest
from pipeline.frames import Kind, fingerprint, frame_path, holds, kinds_of
from pipeline.params import Params
from pipeline.passes.registry import TRUTHS, frame_fingerprint, traced_together
from pipeline.records import Failure, data_lock
from pipeline.render.scene import renderer_version, set_variant
from pipeline.stages import view_sampling
from pipeline.stages.render_jobs import CameraJob, FrameJob, render_frames, sample_scene
from pipeline.stages.runner import Summary, Target, Work, carry_out, finish, threaded
from pipeline.stages.scene_jobs import home_jobs, import_jobs, mark_of, remove_old_scenes
from pipeline.stages.scene_work import HomeJob, ImportJob, make_scene
from pipeline.views import CameraFile, View, load_cameras
from scenes.checked import plain
from scenes.contract import Scene, load_scene, scene_folders
from scenes.errors import InputError
from scenes.files import remove_partials

Part = Literal["shading", "color"]
_SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")


def run_scenes(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Fill `data/scenes`: homes from seeds, then the imports that the parameters name.

    A scene that another tool put there (`pbrnet import`) is left alone and used like the rest;
    scenes of this stage that the parameters no longer ask for are removed.
    """
    started = time.monotonic()
    data = Path(data).resolve()
    with data_lock(data, "scenes"):
        root = data / "scenes"
        remove_partials(root)
        work = Work("scenes", "scenes", make_scene, renders=False)
        wanted: dict[str, HomeJob | ImportJob] = {}
        jobs: list[HomeJob | ImportJob] = [*home_jobs(root, params)]
        jobs += import_jobs(root, params, work.failures)
        for job in jobs:
            if job.scene_id in wanted:
                raise InputError(f"scenes.imports: two scenes would be named {job.scene_id!r}")
            wanted[job.scene_id] = job
        work.removed = remove_old_scenes(root, set(wanted))
        for scene_id, job in wanted.items():
            mark = mark_of(job.folder)
            if mark == job.fingerprint:
                work.kept += 1
            elif mark is None and (job.folder / "scene.json").is_file():
                work.failures.append(
                    Failure(
                        "scenes",
                        scene_id,
                        "",
                        f"{job.folder} is a scene from elsewhere; rename or remove it",
                    )
                )
            else:
                work.add(job, Target(job.folder, "scenes", scene_id))
        made = carry_out(data, params, scheduler, work)
        return finish(data, work, made, started)


def run_cameras(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Write `data/cameras/<scene_id>.json` for every scene."""
    started = time.monotonic()
    data = Path(data).resolve()
    with data_lock(data, "cameras"):
        root = data / "cameras"
        remove_partials(root)
        renderer = _renderer(params)
        work = Work("cameras", "scenes", sample_scene)
        scenes = _scenes(data, work)
        digests = _digests(data, scenes)
        spared = {failure.scene_id for failure in work.failures}
        work.removed = _remove_old_cameras(root, {*scenes, *spared})
        for scene_id in scenes:
            path = root / f"{scene_id}.json"
            mark = _camera_fingerprint(scene_id, params, digests[scene_id], renderer)
            if _cameras_hold(path, mark):
                work.kept += 1
            else:
                job = CameraJob(
                    path,
                    data / "scenes" / scene_id,
                    digests[scene_id],
                    params,
                    params.seed,
                    mark,
                )
                work.add(job, Target(path, "cameras", scene_id))
        made = carry_out(data, params, scheduler, work, renderer)
        return finish(data, work, made, started, lambda: _camera_notes(root, scenes))


def run_inputs(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/inputs`: depth, normal, reflectance, valid mask and object ids."""
    return _run_frames("inputs", ("inputs",), data, params, scheduler)


def run_illumination(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/illumination`: panoramas of the visible light sources.

    With them comes `data/visibility`, their shadows, where `illumination.shadow_rays` asks for it.
    """
    # A folder even without frames in it: DVC wants to find what a stage may write.
    (Path(data) / "visibility").mkdir(parents=True, exist_ok=True)
    return _run_frames("illumination", ("illumination", "visibility"), data, params, scheduler)


def run_groundtruth(
    data: Path,
    params: Params,
    scheduler: str | None = None,
    parts: Sequence[Part] = ("shading", "color"),
) -> Summary:
    """Render `data/shading` and `data/color`, or one of them.

    With both comes `data/noisy`, where `noisy.spp` asks for it; else it is left empty.
    """
    if len(parts) == 1:
        return _run_frames(parts[0], tuple(parts), data, params, scheduler)
    # A folder even without frames in it: DVC wants to find what a stage may write.
    (Path(data) / "noisy").mkdir(parents=True, exist_ok=True)
    kinds: tuple[Kind, ...] = (*parts, "noisy")
    return _run_frames("groundtruth", kinds, data, params, scheduler)


def _run_frames(
    stage: str, kinds: tuple[Kind, ...], data: Path, params: Params, scheduler: str | None
) -> Summary:
    started = time.monotonic()
    data = Path(data).resolve()
    with data_lock(data, stage):
        renderer = _renderer(params)
        work = Work(stage, "views" if len(kinds) == 1 else "frames", render_frames)
        scenes = _scenes(data, work)
        digests = _digests(data, scenes)
        views = _views(data, params, scenes, digests, renderer, work)
        wanted: dict[Path, _WantedFrame] = {}
        for kind in kinds:
            for view in views if kind in kinds_of(params) else ():
                mark = frame_fingerprint(kind, view, params, digests[view.scene_id], renderer)
                wanted[frame_path(data, kind, view)] = _WantedFrame(kind, view, mark)
            # A scene that cannot be read now may be whole again tomorrow: its frames stay.
            spared = {failure.scene_id for failure in work.failures}
            work.removed += _remove_stranger_frames(data / kind, wanted, spared)
        stale = _not_holding(wanted, params.farm.checksums)
        work.kept = len(wanted) - len(stale)
        for paths in _in_one_trace(stale, params):
            view = wanted[paths[0]].view
            marks = {wanted[path].kind: wanted[path].mark for path in paths}
            job = FrameJob(data, view, digests[view.scene_id], params, marks)
            work.add(job, *(wanted[path].target(path) for path in paths))
        made = carry_out(data, params, scheduler, work, renderer)
        # An earlier run's worker may have outlived it and written its frame over ours.
        for path in _not_holding(
            {path: wanted[path] for path in stale if made[path]}, verify=False
        ):
            made[path] = False
            target = wanted[path].target(path)
            error = f"{path} was overwritten by another run; run again"
            work.failures.append(Failure(target.stage, target.scene_id, target.view_id, error))
        return finish(data, work, made, started)


@dataclass(frozen=True)
class _WantedFrame:
    """A frame that should be there, and its fingerprint."""

    kind: Kind
    view: View
    mark: str

    def target(self, path: Path) -> Target:
        return Target(path, self.kind, self.view.scene_id, self.view.view_id)


def _in_one_trace(wanted: dict[Path, _WantedFrame], params: Params) -> list[list[Path]]:
    """Frames, those of one trace together; by scene, then kind: a worker changes neither more
    often than it must."""
    together = traced_together(params)
    groups: dict[tuple[str, str, str], list[Path]] = defaultdict(list)
    for path, frame in wanted.items():
        kind = "truth" if together and frame.kind in TRUTHS else frame.kind
        groups[frame.view.scene_id, kind, frame.view.view_id].append(path)
    return [groups[key] for key in sorted(groups)]


def _renderer(params: Params) -> str:
    set_variant(params.farm.variant)
    return renderer_version()


def _scenes(data: Path, work: Work) -> dict[str, Scene]:
    """All readable scenes by id; the others become failures of the stage."""
    scenes = {}
    for folder in scene_folders(data / "scenes"):
        try:
            scene = load_scene(folder)
            if scene.scene_id != folder.name:
                raise InputError(
                    f"{folder}: its scene.json says {scene.scene_id!r}; rename the folder"
                )
            if not _SAFE_NAME.fullmatch(scene.scene_id):
                raise InputError(
                    f"{folder}: a scene id may hold letters, digits, '.', '_' and '-' only"
                )
            scenes[scene.scene_id] = scene
        except InputError as error:
            work.failures.append(Failure(work.stage, folder.name, "", str(error)))
    if not scenes and not work.failures:
        raise InputError(f"{data / 'scenes'}: no scenes there; run first: pbrnet scenes")
    return scenes


def _digests(data: Path, scenes: Iterable[str]) -> dict[str, str]:
    names = list(scenes)
    digests = threaded(lambda name: scene_digest(data / "scenes" / name), names)
    return dict(zip(names, digests, strict=True))


def _camera_fingerprint(scene_id: str, params: Params, digest: str, renderer: str) -> str:
    return fingerprint(
        kind="cameras",
        revision=view_sampling.REVISION,
        scene_id=scene_id,
        cameras=plain(params.cameras),
        image=plain(params.image),
        scene=digest,
        renderer=renderer,
        seed=params.seed,
    )


def _cameras_hold(path: Path, mark: str) -> bool:
    try:
        return load_cameras(path).fingerprint == mark
    except InputError:
        return False


def _camera_notes(root: Path, scenes: Iterable[str]) -> list[str]:
    """Lines for the terminal: views, and why the other candidates were not taken."""
    files = [load_cameras(root / f"{scene_id}.json") for scene_id in scenes]
    rejected: Counter[str] = Counter()
    for file in files:
        rejected += Counter(file.rejected)
    total = sum(len(file.views) for file in files)
    lines = [f"{total} views of {sum(file.candidates for file in files)} candidates; not taken:"]
    lines += [f"  {count:>8}  {reason}" for reason, count in rejected.most_common()]
    lines += [f"no view in {file.scene_id}: {_why_none(file)}" for file in files if not file.views]
    return lines


def _why_none(file: CameraFile) -> str:
    if not file.rejected:
        return "it has no rooms"
    reasons = sorted(file.rejected.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{reason} ({count})" for reason, count in reasons)


def _views(
    data: Path,
    params: Params,
    scenes: dict[str, Scene],
    digests: dict[str, str],
    renderer: str,
    work: Work,
) -> list[View]:
    """The views of all scenes, sorted; broken camera files become failures."""
    views: list[View] = []
    stale = []
    for scene_id in scenes:
        path = data / "cameras" / f"{scene_id}.json"
        try:
            if not path.is_file():
                raise InputError(f"{path}: no cameras for this scene; run first: pbrnet cameras")
            file = load_cameras(path)
            for view in file.views:
                if view.scene_id != scene_id or not _SAFE_NAME.fullmatch(view.view_id):
                    raise InputError(
                        f"{path}: view {view.view_id!r} of scene {view.scene_id!r} cannot be "
                        f"a view of {scene_id!r}; run again: pbrnet cameras"
                    )
        except InputError as error:
            work.failures.append(Failure(work.stage, scene_id, "", str(error)))
            continue
        if file.fingerprint != _camera_fingerprint(scene_id, params, digests[scene_id], renderer):
            stale.append(scene_id)
        views += file.views
    if stale:
        print(
            f"note: the cameras of {_some(stale)} were sampled with other parameters or in "
            "another version of the scene; 'pbrnet cameras' renews them",
            file=sys.stderr,
        )
    if not views and not work.failures:
        raise InputError(
            f"{data / 'cameras'}: no scene has a view; 'pbrnet cameras' says why, and "
            "cameras.min_objects or cameras.min_score may be too high"
        )
    return sorted(views, key=lambda view: (view.scene_id, view.view_id))


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _not_holding(wanted: dict[Path, _WantedFrame], verify: bool) -> dict[Path, _WantedFrame]:
    """Those whose frame is missing, truncated or was made from something else; with `verify`
    also those whose pixels are damaged."""
    paths = list(wanted)
    good = threaded(lambda path: holds(path, wanted[path].mark, verify), paths)
    return {path: wanted[path] for path, fine in zip(paths, good, strict=True) if not fine}


def _remove_stranger_frames(root: Path, wanted: dict[Path, Any], spared: set[str]) -> int:
    """Remove frames below `root` that belong to no view, and what killed runs left behind.

    Only what looks like ours goes: EXR files one folder deep, partial files, and folders that
    are empty then. Anything else is named and left alone.
    """
    removed = remove_partials(root)
    foreign = []
    for folder in sorted(root.iterdir()) if root.is_dir() else ():
        if not folder.is_dir():
            foreign.append(folder)
            continue
        removed += remove_partials(folder)
        for file in sorted(folder.iterdir()):
            if file in wanted:
                continue
            if file.is_file() and file.suffix == ".exr":
                if folder.name not in spared:
                    file.unlink()
                    removed += 1
            else:
                foreign.append(file)
        if not any(folder.iterdir()):
            folder.rmdir()
    if foreign:
        print(
            f"note: not ours, left alone: {_some([str(path) for path in foreign])}",
            file=sys.stderr,
        )
    return removed


def _remove_old_cameras(root: Path, wanted: set[str]) -> int:
    removed = 0
    for file in sorted(root.glob("*.json")):
        if file.is_file() and file.stem not in wanted:
            file.unlink()
            removed += 1
    return removed
