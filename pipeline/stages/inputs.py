"""The `inputs` stage: rasterised geometry buffers of every view, in `data/inputs`."""

from __future__ import annotations

from pathlib import Path

from pipeline.params import Params
from pipeline.stages.frame_stage import run_frames
from pipeline.stages.runner import Summary


def run_inputs(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/inputs`: depth, normal, reflectance, valid mask and object ids.

    The set `materials` of `channels` adds `data/materials`.
    """
    # DVC expects every output folder of a stage, also an empty one.
    (Path(data) / "materials").mkdir(parents=True, exist_ok=True)
    return run_frames("inputs", ("inputs", "materials"), data, params, scheduler)
