"""The `illumination` stage: panoramas of the light sources that each camera sees."""

from __future__ import annotations

from pathlib import Path

from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.runner import Summary


def run_illumination(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/illumination`: panoramas of the visible light sources.

    With `illumination.shadow_rays` also `data/visibility`: the share of their direct light that
    reaches each pixel's surface.
    """
    # DVC expects every output folder of a stage, also an empty one.
    (Path(data) / "visibility").mkdir(parents=True, exist_ok=True)
    return run_frames("illumination", ("illumination", "visibility"), data, params, scheduler)
