"""The `inputs` stage: rasterised geometry buffers of every view, in `data/inputs`."""

from __future__ import annotations

from pathlib import Path

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.runner import Summary


def run_inputs(data: Path, params: Params, scheduler: str | None = None) -> Summary:
    """Render `data/inputs`: depth, normal, reflectance, valid mask and object ids.

    The sets `materials`, `labels` and `video` of `channels` add frames in folders of these names.
    """
    # DVC expects every output folder of a stage, also an empty one.
    for kind in ("materials", "labels", "video"):
        (Path(data) / kind).mkdir(parents=True, exist_ok=True)
    kinds: tuple[Kind, ...] = ("inputs", "materials", "labels", "video")
    return run_frames("inputs", kinds, data, params, scheduler)
