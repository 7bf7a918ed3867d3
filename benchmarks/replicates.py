"""Independent renders of a view of each home, by one variant.

    python -m benchmarks.replicates VARIANT DATA OUT COUNT SPP WIDTHxHEIGHT FIRST_SEED

Writes colour and shading to OUT, a `.npz` file: by home and image float32 (COUNT, H, W, 3).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.bench import pixels, resized
from pbrnet.pipeline.farm.settings import Variant
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import load_scene, scene_folders

_ALBEDO = 0.5


def replicates(
    data: Path, count: int, spp: int, size: tuple[int, int], first: int
) -> dict[str, AnyArray]:
    """Return the images of the first view of each home, one for each seed from `first` on."""
    params = GroundTruthParams(spp=spp, block_spp=spp // 2, denoise="none")
    found = {}
    for folder in scene_folders(data / "scenes"):
        scene = open_scene(load_scene(folder))
        view = resized(load_cameras(data / "cameras" / f"{folder.name}.json").views[0], size)
        truths = [
            render_both(scene, view, params, _ALBEDO, seed) for seed in range(first, first + count)
        ]
        for name in ("color", "shading"):
            images = [pixels(getattr(truth, name)) for truth in truths]
            found[f"{folder.name} {name}"] = np.stack(images).astype(np.float32)
    return found


def main(variant: str, data: str, out: str, count: str, spp: str, size: str, first: str) -> None:
    """Render and write the images."""
    set_variant(cast(Variant, variant))
    width, height = (int(number) for number in size.split("x"))
    images = replicates(Path(data), int(count), int(spp), (width, height), int(first))
    np.savez(out, **images)  # type: ignore[arg-type]


if __name__ == "__main__":
    main(*sys.argv[1:])
