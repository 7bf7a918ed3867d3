"""Parameters of the farm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pbrnet.scenes.checked import param, within

VISIBLE_CARDS = "CUDA_VISIBLE_DEVICES"  # the environment variable, known to CUDA
Variant = Literal["auto", "llvm_ad_rgb", "cuda_ad_rgb", "scalar_rgb"]


@dataclass(frozen=True)
class FarmParams:
    """Distribution of the work over dask workers; never changes a pixel."""

    workers: int = param(0, "0: one per card or allowed CPU", within(0, 4096))
    batch: int = param(8, "views of one scene per task", within(1, 1024))
    window: int = param(2, "tasks in flight per worker", within(1, 64))
    retries: int = param(2, "additional attempts for a failed view", within(0, 10))
    time_limit: int = param(3600, "seconds per view; 0: no limit", within(0, 1_000_000))
    recycle: int = param(
        100, "scenes after which a worker process is replaced; 0: never", within(0, 1_000_000)
    )
    checksums: bool = param(True, "verify the checksums of kept frames; false avoids reading them")
    trash_days: float = param(
        30.0, "days to keep orphans and replaced files in data/trash; 0: none", within(0, 36_500)
    )
    transfer: Literal["auto", "shared", "send"] = param(
        "auto", "shared: data folder; send: through dask; auto: per worker"
    )
    cache_mb: int = param(
        4096, "cache for received scenes on a worker's machine", within(1, 1 << 30)
    )
    variant: Variant = param("auto", "auto, llvm_ad_rgb, cuda_ad_rgb or scalar_rgb")
