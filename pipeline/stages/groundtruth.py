"""The `groundtruth` stage: path-traced shading and colour of every view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.runner import Summary

Truth = Literal["shading", "color"]


def run_groundtruth(
    data: Path,
    params: Params,
    scheduler: str | None = None,
    truths: Sequence[Truth] = ("shading", "color"),
) -> Summary:
    """Render `data/shading` and `data/color`, or one of them.

    With both, `noisy.spp` adds `data/noisy`, and the sets `light`, `environment` and `transport` of
    `channels` add the folders of these names; without them these folders are left empty.
    """
    if len(truths) == 1:
        return run_frames(truths[0], tuple(truths), data, params, scheduler)
    # DVC expects every output folder of a stage, also an empty one.
    further: tuple[Kind, ...] = ("light", "noisy", "environment", "transport")
    for kind in further:
        (Path(data) / kind).mkdir(parents=True, exist_ok=True)
    kinds: tuple[Kind, ...] = (*truths, *further)
    return run_frames("groundtruth", kinds, data, params, scheduler)
