"""Parameters of packing: files, splits, limits beyond which views are rejected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from pbrnet.scenes.checked import param, within


@dataclass(frozen=True)
class CheckParams:
    """Limits beyond which a view is rejected from the dataset; every rejection is listed.

    `max_noise` is the relative standard error, root mean square over pixels: 0 is exact; 1 is an
    image in which every pixel has its light from a single block of samples.
    """

    max_noise: float = param(0.9, "relative, before denoising", within(0))
    min_valid: float = param(0.5, "share of pixels with a surface", within(0, 1))
    max_black: float = param(0.9, "share of pixels at exactly 0", within(0, 1))
    max_blown: float = param(0.5, "share of pixels at the half-float limit", within(0, 1))
    max_fireflies: float = param(0.02, "share of pixels", within(0, 1))
    max_firefly_light: float = param(0.5, "share of the light, in the brightest", within(0, 1))


@dataclass(frozen=True)
class SplitParams:
    """Shares of the floor plans in each split; the rest is the training split.

    `test_only` holds names of plans, or of scenes for their whole plan, or patterns such as
    "villa-*".
    """

    validation: float = param(0.1, "", within(0, 0.9))
    test: float = param(0.2, "", within(0, 0.9))
    test_only: tuple[str, ...] = param((), "further test plans or scenes: names or patterns")


@dataclass(frozen=True)
class DatasetParams:
    """Packing into Parquet."""

    shard_mb: int = param(192, "most megabytes of a file", within(1, 4096))
    row_group: int = param(16, "rows that are read together", within(1, 1024))
    preview_width: int = param(256, "pixels", within(16, 2048))
    splits: SplitParams = param(SplitParams(), "shares of the floor plans; the rest is train")
    checks: CheckParams = param(CheckParams(), "limits beyond which a view is rejected")


def kept_back(test_only: Sequence[str], plans: Mapping[str, str]) -> set[str]:
    """Return the plans that the names and patterns of `test_only` match.

    `plans` maps scene ids to plans; a match of a scene holds out its whole plan.
    """
    return {
        plan
        for scene, plan in plans.items()
        if any(fnmatchcase(name, pattern) for name in (scene, plan) for pattern in test_only)
    }
