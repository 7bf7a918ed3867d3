"""The `inputs` stage: rasterised geometry buffers of every view, in `data/inputs`."""

from __future__ import annotations

from pathlib import Path

from pipeline.params import Params
from pipeline.stages.frame_stage import run_frames
from pipeline.stages.runner import Summary


def run_inputs(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/inputs`: depth, normal, reflectance, valid mask and object ids.

    The sets `materials` and `labels` of `channels` add `data/materials` and `data/labels`.
    """
    # DVC expects every output folder of a stage, also an empty one.
    for kind in ("materials", "labels"):
        (Path(data) / kind).mkdir(parents=True, exist_ok=True)
    return run_frames("inputs", ("inputs", "materials", "labels"), data, params, scheduler)
