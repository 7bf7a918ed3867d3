"""Parameters of packing: files, splits, limits beyond which views are rejected."""

from __future__ import annotations

from dataclasses import dataclass

from pbrnet.pipeline.splits import SplitParams
from pbrnet.scenes.checked import param, within


@dataclass(frozen=True)
class CheckParams:
    """Limits beyond which a view is rejected from the dataset; every rejection is listed.

    `max_noise` is the relative standard error, root mean square over pixels: 0 is exact; 1 is an
    image in which every pixel has its light from a single block of samples.
    """

    max_noise: float = param(0.9, "relative noise before denoising", within(0))
    min_valid: float = param(0.5, "share of pixels with a surface", within(0, 1))
    max_black: float = param(0.9, "share of pixels at exactly 0", within(0, 1))
    max_blown: float = param(0.5, "share of pixels at the half-float limit", within(0, 1))
    max_fireflies: float = param(0.02, "share of firefly pixels", within(0, 1))
    max_firefly_light: float = param(0.5, "share of the light in the brightest ones", within(0, 1))
    max_flow_error: float = param(0.01, "pixels, error of the optical flow", within(0))
    max_called_hidden: float = param(0.05, "share of visible points marked as hidden", within(0, 1))
    max_called_visible: float = param(0.2, "share of hidden points marked as visible", within(0, 1))
    whole_walks: bool = param(
        False, "reject a walk with rejected frames as a whole; false: exit code 1"
    )


@dataclass(frozen=True)
class DatasetParams:
    """Packing into Parquet."""

    shard_mb: int = param(192, "maximum megabytes per file", within(1, 4096))
    row_group: int = param(16, "rows per row group, which are read together", within(1, 1024))
    preview_width: int = param(256, "pixels", within(16, 2048))
    splits: SplitParams = param(SplitParams(), "shares of the floor plans; the rest is train")
    checks: CheckParams = param(CheckParams(), "limits for the rejection of views")
