"""Estimated seconds of scenes and views, from the ledger, for the scheduling of the farm.

Only the order of the work depends on these figures, never a pixel.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from statistics import mean

import pyarrow as pa

Estimate = Callable[[str, str, str], float]  # stage, scene, view -> seconds


def estimator(ledger: pa.Table) -> Estimate:
    """Return a function that estimates the seconds of a stage, scene and view.

    A view that was made before has its recorded seconds. Another one has the mean of its stage,
    times the mean ratio of its scene to other scenes over the stages recorded for it. Stages that
    the ledger does not contain count as 1 s.
    """
    known: dict[tuple[str, str, str], float] = {}
    stages: dict[str, list[float]] = defaultdict(list)
    columns = ledger.select(["stage", "scene_id", "view_id", "seconds"]).to_pydict().values()
    for stage, scene, view, seconds in zip(*columns, strict=True):
        known[stage, scene, view] = seconds
        stages[stage].append(seconds)
    usual = {stage: mean(values) or 1.0 for stage, values in stages.items()}
    scenes: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (stage, scene, _), seconds in known.items():
        scenes[scene][stage].append(seconds / usual[stage])
    slower = {
        scene: mean(mean(values) for values in by_stage.values())
        for scene, by_stage in scenes.items()
    }

    def estimate(stage: str, scene: str, view: str) -> float:
        if (stage, scene, view) in known:
            return known[stage, scene, view]
        return usual.get(stage, 1.0) * slower.get(scene, 1.0)

    return estimate
