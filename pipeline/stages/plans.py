"""Plans of the stages of a run, before any of them changes a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.cameras import plan_cameras
from pbrnet.pipeline.stages.frame_stage import FRAME_STAGES, plan_frames
from pbrnet.pipeline.stages.runner import NOTHING_PENDING, Pending, StagePlan, Target
from pbrnet.pipeline.stages.scenes import plan_scenes


def plan_stages(names: Iterable[str], data: Path, params: Params) -> Iterator[StagePlan]:
    """Yield what stages of these names will do one after the other, from `scenes` to frames.

    A stage whose scenes or cameras are made before it has at most as many files to make as it has
    views per scene. Checksums are left to the stages.
    """
    pending, data = NOTHING_PENDING, Path(data).resolve()
    params = replace(params, farm=replace(params.farm, checksums=False))
    for name in names:
        if name == "scenes":
            plan = plan_scenes(data, params)
            gone = frozenset(folder.name for folder in plan.orphans)
            pending = Pending(_changed(plan), gone)
        elif name == "cameras":
            plan = plan_cameras(data, params, pending)[0]
            plan.later = [Target(data, name, scene) for scene in sorted(pending.changed)]
            pending = Pending(pending.changed | _changed(plan), pending.gone)
        elif name in FRAME_STAGES:
            plan = plan_frames(name, data, params, pending)[0]
            plan.later = [
                Target(data, kind, scene, f"view {number}")
                for scene in sorted(pending.changed)
                for number in range(params.cameras.most_views)
                for kind in FRAME_STAGES[name]
                if kind in params.kinds
            ]
        else:
            continue
        yield plan


def _changed(plan: StagePlan) -> frozenset[str]:
    """Return the scenes that a stage makes or puts back from the trash."""
    made = {target.scene_id for targets in plan.targets.values() for target in targets}
    return frozenset(made | {path.name.removesuffix(".json") for path in plan.returning})
