"""Rendering of frames of every view: the common part of the stages that write EXR files.

A frame is kept while its fingerprint holds. Out-of-date frames are rendered again and orphan
frames, which belong to no view any more, go to the trash. So a killed run resumes, a changed
parameter leaves no stale data, and a run with nothing to do starts no worker.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.channels import SURFACES, TRACED, Kind
from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.dataset.checks import Rejection, surfaces_of
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.farm.worker import Item
from pbrnet.pipeline.frames import frame_path, holds
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import TRACE_OF, frame_fingerprint, settings_of, trace_seed
from pbrnet.pipeline.records import Failure, Trash, data_lock
from pbrnet.pipeline.splits import split_sampling
from pbrnet.pipeline.stages.cameras import camera_fingerprints
from pbrnet.pipeline.stages.render_jobs import FrameJob, render_frames
from pbrnet.pipeline.stages.runner import (
    NOTHING_PENDING,
    SAFE_NAME,
    Pending,
    StageError,
    StagePlan,
    Summary,
    Target,
    accepted_renderers,
    begin,
    execute,
    finish,
    list_scenes,
    scene_digests,
    threaded,
)
from pbrnet.pipeline.terminal import say
from pbrnet.pipeline.views import ImageParams, View, load_cameras
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import remove_partials

_MADE_AGAIN = ("missing", "damaged", "stale")  # reasons for a rejection that do not last

# Kinds of frames that each stage renders: those that the parameters ask for, of each its folder.
FRAME_STAGES: dict[str, tuple[Kind, ...]] = {
    "inputs": SURFACES,
    "illumination": ("illumination", "visibility"),
    "groundtruth": (*TRACED, "noisy", "environment", "transport"),
    "shading": ("shading",),  # half of groundtruth, as the next one
    "color": ("color",),
}


def run_frames(stage: str, data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Bring the frames of a stage of `FRAME_STAGES` up to date for all views of `data`."""
    (outcome,) = run_frame_stages([stage], data, params, scheduler)
    if isinstance(outcome, StageError):
        raise outcome
    return outcome


def run_frame_stages(
    stages: Sequence[str], data: Path, params: Params, scheduler: str | None = None
) -> list[Summary | StageError]:
    """Bring the frames of stages up to date together: a worker opens each scene once for all.

    `stages` in their order. A scene's light is rendered when its surfaces have been, as the
    dataset's checks of these decide for which views. Returns what each stage did.
    """
    data = Path(data).resolve()
    found: list[Summary | StageError] = []
    with data_lock(data, stages[0]):
        plans: list[StagePlan] = []
        expected: dict[Path, ExpectedFrame] = {}
        queue = LightQueue(data, params.kinds, params.image, params.dataset.checks)
        for stage in stages:
            kinds = FRAME_STAGES[stage]
            for kind in kinds[1:]:  # DVC expects every output folder of a stage, also an empty one
                (data / kind).mkdir(parents=True, exist_ok=True)
            plan, frames = plan_frames(stage, data, params, waiting=queue.waiting)
            begin(plan)
            plan.removed += sum(_tidy(data / kind) for kind in kinds)
            plans.append(plan)
            expected |= frames
            queue.add(plan)
        outputs = [[target.path for target in plan.outputs] for plan in plans]
        made = execute(plans, scheduler, queue.following)
        for plan, paths in zip(plans, outputs, strict=True):
            try:
                done = _finished(plan, {path: made[path] for path in paths}, expected)
                found.append(done if len(plans) == 1 else replace(done, seconds=None))
            except StageError as error:
                found.append(error)
    return found


def _finished(
    plan: StagePlan, made: dict[Path, bool], expected: Mapping[Path, ExpectedFrame]
) -> Summary:
    """Check and count what a stage has made; raises `StageError` for failures."""
    # A worker of an earlier run may still have been alive and have overwritten a frame.
    written = {path: expected[path] for path, fine in made.items() if fine}
    for path in _stale(written, verify=False):
        made[path] = False
        target = expected[path].target(path)
        error = f"{path} was overwritten by another run; run the same command again"
        plan.failures.append(Failure(target.stage, target.scene_id, target.view_id, error))
    left = [f"left out: {scene}/{view}: {why}" for (scene, view), why in plan.left_out.items()]
    return finish(plan, made, lambda: left)


class LightQueue:
    """Items of light that wait for the surfaces of their scene, which are made beside them.

    `add` takes the plans in the order of their stages; `waiting` are the scenes whose surfaces are
    to be made.
    """

    def __init__(
        self, data: Path, kinds: Sequence[Kind], image: ImageParams, checks: CheckParams
    ) -> None:
        self.data, self._rules = data, (kinds, image, checks)
        self.waiting: Counter[str] = Counter()  # by scene: items of surfaces that have not ended
        self._surfaces: dict[str, str] = {}  # their scenes by key
        self._held: dict[str, list[Item]] = defaultdict(list)  # by scene
        self._plan: dict[str, StagePlan] = {}  # of the held items

    def add(self, plan: StagePlan) -> None:
        """Note what a stage will make, and what it holds back."""
        if FRAME_STAGES[plan.stage] == SURFACES:
            self._surfaces = {item.key: item.group for item in plan.items}
            self.waiting.update(self._surfaces.values())
        for item in plan.held:
            self._held[item.group].append(item)
            self._plan[item.group] = plan

    def following(self, key: str) -> tuple[list[Item], list[Item]]:
        """Return the items that may begin once the item `key` has ended, and those left out."""
        scene = self._surfaces.get(key)
        if scene is None:
            return [], []
        self.waiting[scene] -= 1
        held = self._held[scene] if not self.waiting[scene] else []
        if not held:
            return [], []
        plan = self._plan[scene]
        due = {item.payload.view.name for item in held}
        views = load_cameras(self.data / "cameras" / f"{scene}.json").views
        left = _rejected(self.data, views, due, *self._rules)
        plan.left_out |= left
        begun = [item for item in held if item.payload.view.name not in left]
        return begun, [item for item in held if item.payload.view.name in left]


def plan_frames(
    stage: str,
    data: Path,
    params: Params,
    pending: Pending = NOTHING_PENDING,
    waiting: Collection[str] = (),
) -> tuple[StagePlan, dict[Path, ExpectedFrame]]:
    """Return what a stage will do, and the frames it should find in the end.

    Nothing is changed. `pending` scenes are left aside, as they will be others by then. Light of
    the scenes `waiting`, whose surfaces are yet to be made, is held back.
    """
    kinds, renderers = FRAME_STAGES[stage], accepted_renderers(params.farm)
    wanted = [kind for kind in kinds if kind in params.kinds]
    unit = "views" if len(wanted) == 1 else "frames"
    size = view_size(params)
    plan = StagePlan(data, params.farm, size, stage, unit, render_frames, renderers)
    scenes = list_scenes(plan, pending.scenes)
    digests = scene_digests(data, scenes)
    of_cameras = ViewParams(params.cameras, params.image)
    cameras = camera_fingerprints(scenes, of_cameras, params.seed, digests, renderers)
    views = _views(data, cameras, plan, bool(pending.scenes))
    expected: dict[Path, ExpectedFrame] = {}
    seen = sorted({view.scene_id for view in views})
    sampling = split_sampling(
        [scenes[name] for name in seen],
        *(params.groundtruth, params.noisy, params.dataset.splits, params.seed),
    )
    settings = {
        name: settings_of(replace(params, groundtruth=truth, noisy=noisy), wanted)
        for name, (truth, noisy) in sampling.items()
    }
    # An unreadable scene may be repaired: its frames are not orphans.
    spared = {failure.scene_id for failure in plan.failures} | pending.changed
    for kind in kinds:
        for view in views if kind in wanted else ():
            own, scene = settings[view.scene_id][kind], digests[view.scene_id]
            mark = partial(frame_fingerprint, kind, view, own, params.seed, scene)
            frame = ExpectedFrame(kind, view, own, mark, renderers)
            expected[frame_path(data, kind, view)] = frame
        orphans = _frames_below(data / kind) - expected.keys()
        plan.orphans += sorted(path for path in orphans if path.parent.name not in spared)
        plan.unsure += sum(path.parent.name in pending.changed for path in orphans)
    stale = _stale(expected, params.farm.checksums)
    plan.returning = _current(plan.trash, stale, params.farm.checksums)
    stale = {path: frame for path, frame in stale.items() if path not in set(plan.returning)}
    plan.kept = len(expected) - len(stale) - len(plan.returning)
    light = kinds[0] in TRACED
    if light:
        due = {frame.view.name for frame in stale.values() if frame.view.scene_id not in waiting}
        checks = params.dataset.checks
        plan.left_out = _rejected(data, views, due, params.kinds, params.image, checks)
        left = {path for path, frame in stale.items() if frame.view.name in plan.left_out}
        plan.orphans += sorted(path for path in left if path.exists())
        stale = {path: frame for path, frame in stale.items() if path not in left}
    for paths in _by_trace(stale):
        frames = [expected[path] for path in paths]
        view, first = frames[0].view, frames[0].kind
        job = FrameJob(
            data,
            view,
            digests[view.scene_id],
            {frame.kind: frame.settings for frame in frames},
            {frame.kind: dict(frame.fingerprints()) for frame in frames},
            trace_seed(first, view, params.seed),
        )
        targets = [expected[path].target(path) for path in paths]
        phase = list(FRAME_STAGES).index(stage)
        plan.add(job, *targets, phase=phase, held=light and view.scene_id in waiting)
    return plan, expected


@dataclass(frozen=True)
class ExpectedFrame:
    """A frame that the data folder should hold."""

    kind: Kind
    view: View
    settings: Any  # of its trace
    mark: Callable[[str], str]  # from the renderer to the fingerprint
    renderers: tuple[str, ...]  # any of which may make it

    def fingerprints(self) -> Iterator[tuple[str, str]]:
        """Yield the renderers with the fingerprint that their frame has."""
        return ((renderer, self.mark(renderer)) for renderer in self.renderers)

    def holds(self, path: Path, verify: bool) -> bool:
        """Test whether it lies at `path`; with `verify` its pixels are read, too."""
        return holds(path, (mark for _, mark in self.fingerprints()), verify)

    def target(self, path: Path) -> Target:
        return Target(path, self.kind, self.view.scene_id, self.view.view_id)


def _rejected(
    data: Path,
    views: Sequence[View],
    due: Collection[tuple[str, str]],
    kinds: Sequence[Kind],
    image: ImageParams,
    checks: CheckParams,
) -> dict[tuple[str, str], str]:
    """Return by scene and view id which of the views `due` the dataset will reject, and why.

    It rejects them for frames without light; those that are missing, damaged or of another camera
    do not count, as they are made again.
    """
    whole = {view.walk for view in views if view.name in due and view.trajectory}
    asked = [
        view for view in views if view.name in due or (checks.whole_walks and view.walk in whole)
    ]
    by_scene: dict[str, list[View]] = defaultdict(list)
    for view in views:
        by_scene[view.scene_id].append(view)

    def fault(view: View) -> str:
        others = by_scene[view.scene_id]
        found = surfaces_of(data, view, others, {}, kinds, (image.width, image.height), checks)
        if isinstance(found, Rejection) and found.reason not in _MADE_AGAIN:
            return f"{found.reason}, {found.detail}"
        return ""

    faults = dict(zip([view.name for view in asked], threaded(fault, asked), strict=True))
    if checks.whole_walks:
        broken = {view.walk for view in asked if faults[view.name] and view.trajectory}
        for view in asked:
            if view.walk in broken:
                faults[view.name] = faults[view.name] or "another frame of its walk is rejected"
    return {name: why for name, why in faults.items() if why and name in due}


def _by_trace(frames: dict[Path, ExpectedFrame]) -> list[list[Path]]:
    """Group frames that one trace renders; sorted by scene, then trace.

    In this order a worker changes scenes and kernels as rarely as possible.
    """
    groups: dict[tuple[str, str, str], list[Path]] = defaultdict(list)
    for path, frame in frames.items():
        trace = TRACE_OF[frame.kind]
        name = trace.kinds[0] if trace.together(frame.settings) else frame.kind
        groups[frame.view.scene_id, name, frame.view.view_id].append(path)
    return [groups[key] for key in sorted(groups)]


def _views(
    data: Path, expected: Mapping[str, Mapping[str, str]], plan: StagePlan, may_be_none: bool
) -> list[View]:
    """Return the views of all scenes, sorted; add broken camera files to the plan's failures.

    `expected`: the fingerprints that each scene's camera file may have, by renderer.
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
        if file.fingerprint not in expected[scene_id].values():
            stale.append(scene_id)
        views += file.views
    if stale:
        say(
            f"note: the cameras of {_some(stale)} were sampled with other parameters or in "
            "another version of the scene; to sample them again, run: pbrnet cameras",
            err=True,
        )
    if not views and not plan.failures and not may_be_none:
        raise InputError(
            f"{data / 'cameras'}: no scene has a view; 'pbrnet cameras' lists the reasons, and "
            "cameras.min_objects or cameras.min_score may be too high"
        )
    return sorted(views, key=lambda view: (view.scene_id, view.view_id))


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _stale(expected: dict[Path, ExpectedFrame], verify: bool) -> dict[Path, ExpectedFrame]:
    """Return the frames that are missing, truncated or have another fingerprint.

    With `verify` also those whose pixels do not match their checksum.
    """
    paths = list(expected)
    good = threaded(lambda path: expected[path].holds(path, verify), paths)
    return {path: expected[path] for path, fine in zip(paths, good, strict=True) if not fine}


def _current(trash: Trash, stale: dict[Path, ExpectedFrame], verify: bool) -> list[Path]:
    """Return the paths of frames that lie up to date in the trash."""
    lying = {trash.place(path): path for path in stale if trash.place(path).is_file()}
    missing = _stale({place: stale[path] for place, path in lying.items()}, verify)
    return [path for place, path in lying.items() if place not in missing]


def _frames_below(root: Path) -> set[Path]:
    """Return the paths of the EXR files one folder deep, without partial files."""
    return {path for path in root.glob("*/*.exr") if path.is_file() and path.name[0] != "."}


def _tidy(root: Path) -> int:
    """Remove partial files and empty folders below `root`; return how many files.

    What this stage did not write is kept, and named in a note.
    """
    folders = [folder for folder in sorted(root.glob("*")) if folder.is_dir()]
    removed = sum(remove_partials(folder) for folder in (root, *folders))
    for folder in folders:
        if folder.exists() and not any(folder.iterdir()):
            folder.rmdir()
    known = {*folders, *_frames_below(root)}
    foreign = [path for path in sorted((*root.glob("*"), *root.glob("*/*"))) if path not in known]
    if foreign:
        say(
            f"note: kept files that this stage did not write: {_some([str(p) for p in foreign])}",
            err=True,
        )
    return removed
