"""The `inputs` stage: rasterised geometry buffers of every view, in `data/inputs`."""

from __future__ import annotations

from pathlib import Path

from pipeline.params import Params
from pipeline.stages.frame_stage import run_frames
from pipeline.stages.runner import Summary


def run_inputs(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/inputs`: depth, normal, reflectance, valid mask and object ids."""
    return run_frames("inputs", ("inputs",), data, params, scheduler)
