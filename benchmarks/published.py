"""Rows beside published figures: core-hours of one 640x480 view.

The publications do not state the noise of their images, so that a comparison at equal error is
impossible: our figure is given at a stated noise.

* Hypersim (Roberts et al. 2021): 231 vCPU-years for 77,400 images of 1024x768, V-Ray; scaled by
  pixels to 640x480. A vCPU is a hardware thread.
* PBRS (Zhang et al. 2017), as reported by PBR-Net (Dai et al. 2020): a month on hundreds of
  machines with 56 cores, for about 500,000 images of 640x480, Mitsuba 0.5; counted as 200 machines,
  the least that "hundreds" can mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from benchmarks.bench import Bench, resized
from benchmarks.rows import Row
from benchmarks.timing import spend, spread
from pbrnet.pipeline.passes.groundtruth import Truths, render_both

SIZE = (640, 480)
HYPERSIM = 231 * 365.25 * 24 / 77_400 * (640 * 480) / (1024 * 768)  # core-hours
PBRS = 200 * 56 * 30 * 24 / 500_000
NOISE = 0.05  # relative standard error, root mean square over the pixels


def published_rows(bench: Bench) -> Iterator[Row]:
    """Yield the core-hours of both images of a view, at a stated noise, home by home."""
    hours = [_core_hours(bench, name) for name in sorted(bench.views) if bench.views[name]]
    yield Row(
        "core-hours per view",
        f"colour and shading of one 640x480 view at {NOISE:.0%} relative noise, from "
        f"{_samples(bench)} spp by noise² x time; one value per home",
        spread(hours),
        "h",
        "cpu",
    )
    for name, figure, told in (
        ("Hypersim", HYPERSIM, "26 vCPU-hours per image of 1024x768, by pixels"),
        ("PBRS", PBRS, "a month on 200 machines of 56 cores for 500,000 images"),
    ):
        yield Row(
            f"{name} / ours",
            f"{figure:.1f} core-hours per view ({told}; noise unknown) over ours",
            spread([figure / each for each in hours]),
        )


def _core_hours(bench: Bench, name: str) -> float:
    """Return the core-hours of the first view of a home."""
    size = SIZE if bench.sizes.large[0] > SIZE[0] // 2 else bench.sizes.large
    scene, view = bench.open(name), resized(bench.views[name][0], size)
    truth = replace(bench.params.groundtruth, spp=_samples(bench))
    grey = bench.params.shading.albedo
    render_both(scene, view, truth, grey, 0)  # compiles
    found: list[Truths] = []
    spent = spend(lambda: found.append(render_both(scene, view, truth, grey, 1)))
    noise = max(found[0].color[1]["noise"], found[0].shading[1]["noise"])
    share = SIZE[0] * SIZE[1] / (size[0] * size[1])
    return spent.cpu / 3600 * share * (noise / NOISE) ** 2


def _samples(bench: Bench) -> int:
    """Return samples per pixel: two blocks, the least that give a noise estimate."""
    truth = bench.params.groundtruth
    return min(truth.spp, 2 * truth.block_spp)
