"""The `cameras` stage: views sampled in every scene, in `data/cameras`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from pbrnet.pipeline.cameras.camera_files import described_collisions
from pbrnet.pipeline.cameras.settings import CameraParams, ViewParams
from pbrnet.pipeline.cameras.trajectory_files import Trajectory, read_trajectory, trajectories_of
from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.frames import fingerprint
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import Failure, data_lock
from pbrnet.pipeline.stages.render_jobs import CameraJob, sample_scene
from pbrnet.pipeline.stages.runner import (
    NOTHING_PENDING,
    Pending,
    StagePlan,
    Summary,
    Target,
    accepted_renderers,
    begin,
    execute,
    finish,
    list_scenes,
    scene_digests,
)
from pbrnet.pipeline.terminal import views_of
from pbrnet.pipeline.views import CameraFile, load_cameras
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, exists, remove_partials


def run_cameras(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Write `data/cameras/<scene_id>.json` for every scene."""
    data = Path(data).resolve()
    with data_lock(data, "cameras"):
        root = data / "cameras"
        remove_partials(root)
        plan, scenes = plan_cameras(data, params)
        begin(plan)
        first = first_scenes(scenes, params.cameras)
        made: dict[Path, bool] = {}
        # Scenes that take the cameras of another scene come after those.
        for taking in (False, True):
            part = StagePlan(
                data, plan.farm, plan.view, "cameras", "scenes", sample_scene, plan.accepted
            )
            for item in plan.items:
                scene_id, job = item.group, item.payload
                if (first[scene_id] != scene_id) != taking:
                    continue
                if taking:
                    lender = root / f"{first[scene_id]}.json"
                    if not made.get(lender, lender.is_file()):
                        error = f"there are no cameras of {first[scene_id]} to share"
                        part.failures.append(Failure("cameras", scene_id, "", error))
                        continue
                    job = replace(job, shared=load_cameras(lender).views)
                part.add(job, *plan.targets[item.key])
            made |= execute([part], scheduler)
            plan.failures += part.failures
            plan.renderers += part.renderers
        return finish(plan, made, lambda: _notes(root, scenes, {path.stem for path in made}))


def plan_cameras(
    data: Path, params: Params, pending: Pending = NOTHING_PENDING
) -> tuple[StagePlan, dict[str, Scene]]:
    """Return what the stage will do, and its scenes; nothing is changed.

    `pending` scenes are left aside, as they will be others by then.
    """
    root, renderers = data / "cameras", accepted_renderers(params.farm)
    size = view_size(params)
    plan = StagePlan(data, params.farm, size, "cameras", "scenes", sample_scene, renderers)
    scenes = list_scenes(plan, pending.scenes)
    first = first_scenes(scenes, params.cameras)
    for given in params.cameras.trajectories:
        if not (data / "scenes" / given.scene).is_dir() and given.scene not in pending.changed:
            raise InputError(
                f"cameras.trajectories: there is no scene {given.scene!r} in {data / 'scenes'}"
            )
        source = first.get(given.scene, given.scene)
        if source != given.scene:
            raise InputError(
                f"cameras.trajectories: {given.scene} shares the cameras of {source}; name that"
            )
    digests = scene_digests(data, scenes)
    spared = {*scenes, *(failure.scene_id for failure in plan.failures), *pending.changed}
    plan.orphans = [file for file in sorted(root.glob("*.json")) if file.stem not in spared]
    views = ViewParams(params.cameras, params.image)
    expected = camera_fingerprints(scenes, views, params.seed, digests, renderers)
    for scene_id, marks in expected.items():
        path, stored = root / f"{scene_id}.json", len(scenes[scene_id].source.get("views", ()))
        if file := _current(path, marks):
            plan.kept += 1
        elif file := _current(plan.trash.place(path), marks):
            plan.returning.append(path)
        else:
            place, own = data / "scenes" / scene_id, first[scene_id] == scene_id
            walks = _trajectories(scene_id, params.cameras) if own else ()
            own_views = views.without_files
            job = CameraJob(path, place, digests[scene_id], own_views, params.seed, marks, walks)
            plan.add(job, Target(path, "cameras", scene_id))
        plan.views[scene_id] = len(file.views) if file else params.cameras.most_views(1, stored)
    return plan, scenes


def first_scenes(scenes: Mapping[str, Scene], params: CameraParams) -> dict[str, str]:
    """Return for each scene the one whose cameras it has: itself, or the first of its plan."""
    first: dict[str, str] = {}
    plans: dict[str, str] = {}
    for scene_id in sorted(scenes):
        plan = scenes[scene_id].plan if params.share_cameras else ""
        first[scene_id] = plans.setdefault(plan, scene_id) if plan else scene_id
    return first


def camera_fingerprints(
    scenes: Mapping[str, Scene],
    params: ViewParams,
    seed: int,
    digests: Mapping[str, str],
    renderers: Iterable[str],
) -> dict[str, dict[str, str]]:
    """Return the fingerprints of each scene's camera file, by renderer that samples it.

    `digests` are those of the scenes.
    """
    found: dict[str, dict[str, str]] = {name: {} for name in scenes}
    first = first_scenes(scenes, params.cameras)
    for renderer in renderers:
        own = {
            name: camera_fingerprint(name, params, seed, digests[name], renderer) for name in scenes
        }
        for name, source in first.items():
            shares = source != name
            found[name][renderer] = (
                fingerprint(own=own[name], shared=own[source]) if shares else own[name]
            )
    return found


def camera_fingerprint(
    scene_id: str, params: ViewParams, seed: int, digest: str, renderer: str
) -> str:
    """Return the fingerprint of cameras of a scene's own; `digest` is that of the scene."""
    files = trajectories_of(scene_id, params.cameras)
    given = [digest_file(path) if exists(path) else "" for path in files]
    return fingerprint(
        kind="cameras",
        revision=key("cameras"),
        scene_id=scene_id,
        **vars(params.without_files),
        scene=digest,
        renderer=renderer,
        seed=seed,
        **({"trajectories": given, "collisions": key("trajectories")} if given else {}),
        **({"walks": key("walks")} if params.cameras.walks else {}),
    )


def _trajectories(scene_id: str, params: CameraParams) -> tuple[Trajectory, ...]:
    """Return the trajectories that the parameters name for a scene, with names of their own."""
    files = trajectories_of(scene_id, params)
    return tuple(read_trajectory(path, f"path-{number:02d}") for number, path in enumerate(files))


def _current(path: Path, expected: Mapping[str, str]) -> CameraFile | None:
    """Return a camera file if it has one of the fingerprints that are expected by renderer."""
    try:
        file = load_cameras(path)
    except InputError:
        return None
    return file if file.fingerprint in expected.values() else None


def _notes(root: Path, scenes: Iterable[str], made: Collection[str]) -> list[str]:
    """Lines for the terminal: the number of views; of scenes `made`, what was rejected and why."""
    all_files = [load_cameras(root / f"{scene_id}.json") for scene_id in scenes]
    files = [file for file in all_files if file.scene_id in made]
    rejected: Counter[str] = Counter()
    for file in files:
        rejected += Counter(file.rejected)
    lines = [views_of(sum(len(file.views) for file in all_files), len(all_files))]
    if files:
        candidates = sum(file.candidates for file in files)
        lines.append(f"of {candidates} new candidates {rejected.total()} were rejected:")
    lines += [f"  {count:>8}  {reason}" for reason, count in rejected.most_common()]
    lines += [
        f"little furniture in {file.scene_id}: parts of the building counted as objects"
        for file in files
        if file.unfurnished
    ]
    lines += [
        f"searched {room} of {file.scene_id} again: {rules}"
        for file in files
        for room, rules in (file.relaxed or {}).items()
    ]
    lines += [
        f"left out: {name} of {file.scene_id} ({reason})"
        for file in files
        for name, reason in file.stored_left_out.items()
    ]
    for file in files:
        frames = Counter(view.trajectory for view in file.views)
        lines += [
            f"{name} of {file.scene_id}: {described_collisions(found, frames[name])}"
            for name, found in file.collisions.items()
            if frames[name]
        ]
    empty = [file for file in all_files if not file.views]
    lines += [f"no view in {file.scene_id}: {_reasons(file)}" for file in empty]
    return lines


def _reasons(file: CameraFile) -> str:
    if not file.rejected:
        return "it has no rooms"
    reasons = sorted(file.rejected.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{reason} ({count})" for reason, count in reasons)
