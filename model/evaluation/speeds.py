"""Seconds of a view's picture by method and samples: expected, and as measured on this machine.

What was measured is kept in a file of the user's cache, by machine, size of the image and kind of
scene, so that the same question is answered without a measurement.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any

from pbrnet.pipeline.farm.versions import processor
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.render.scene import RenderScene, renderer_version
from pbrnet.pipeline.views import View
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json, write_json

# Seconds of a view, per view, pixel, sample, and sample of a pixel: docs/results.md, Equal time.
_COSTS = {
    "radiosity": (0.26, 3.8e-6, 0.0003, 1.9e-6),
    "denoised": (0.12, 3.7e-6, 0.0028, 2.0e-6),
    "hybrid": (0.86, 1.3e-5, 0.0030, 2.1e-6),
}
_DENOISER = 2.4e-6  # of a pixel, by which the quality `fast` is quicker than `high`
_PLACES = 200  # machines, sizes and kinds that the file holds


def expected_seconds(method: str, spp: int, quality: Quality, pixels: int) -> float:
    """Return the seconds of a picture on the machine of the reference run, two cores."""
    fixed, of_pixel, of_sample, of_both = _COSTS[method]
    seconds = fixed + of_pixel * pixels + spp * (of_sample + of_both * pixels)
    return seconds - (_DENOISER * pixels if quality == "fast" else 0)


def speeds_file() -> Path:
    """Return the file of what was measured."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(cache) / "pbrnet" / "seconds.json"


def place_of(scene: RenderScene, view: View) -> str:
    """Return machine, size of the image and kind of scene: shapes to a power of two."""
    shapes = 1 << len(scene.geometry.shapes).bit_length()
    cores = len(os.sched_getaffinity(0))
    machine = f"{processor()}, {cores} cores, {renderer_version()}"
    return f"{machine}, {view.width}x{view.height}, below {shapes} shapes"


def known_seconds(file: Path, place: str) -> dict[str, float]:
    """Return what was measured at a place, by effort; nothing of a file that is damaged."""
    found = _read(file).get(place)
    if not isinstance(found, dict):
        return {}
    return {
        name: float(seconds)
        for name, seconds in found.items()
        if isinstance(seconds, int | float) and 0 < seconds < float("inf")
    }


def keep_seconds(file: Path, place: str, measured: dict[str, float]) -> None:
    """Keep what was measured at a place, with the latest places; does nothing on a full disk."""
    places = {name: found for name, found in _read(file).items() if name != place}
    kept = dict(list(places.items())[-_PLACES + 1 :])
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, {**kept, place: measured})


def scaled(expected: dict[str, float], measured: dict[str, float]) -> dict[str, float]:
    """Return seconds by effort: as measured, else as expected times the median of their ratio."""
    ratios = [measured[name] / expected[name] for name in measured if name in expected]
    scale = median(ratios) if ratios else 1.0
    return {name: measured.get(name, scale * seconds) for name, seconds in expected.items()}


def _read(file: Path) -> dict[str, Any]:
    try:
        found = read_json(file)
    except (InputError, OSError):
        return {}
    return found if isinstance(found, dict) else {}
