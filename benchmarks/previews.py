"""Rows about pictures without a long trace: light transport, and one denoised sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from benchmarks.bench import Bench, resized
from benchmarks.rows import Row, at_most
from benchmarks.timing import Spent, by_turns, ratio, spread
from pbrnet.pipeline.passes.denoise import guides
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.passes.transport import transport_of
from pbrnet.pipeline.passes.truth import noisy_settings, noisy_trace, render_noisy, render_samples
from pbrnet.pipeline.transport.guides import fast_guides


def preview_rows(bench: Bench) -> Iterator[Row]:
    """Yield what light transport costs, and the path to a picture of one sample."""
    scene = bench.open(bench.home)
    view = resized(bench.views[bench.home][0], bench.sizes.large)
    small = resized(view, (160, 120))
    single = replace(bench.params, noisy=NoisyParams(1))
    trace = noisy_trace(single.groundtruth, 1)
    ways: dict[str, Callable[[], object]] = {
        "small": lambda: transport_of(scene, small, bench.params.transport, 0),
        "large": lambda: transport_of(scene, view, bench.params.transport, 0),
        "guides": lambda: guides(scene, view),
        "fast": lambda: fast_guides(scene, view),
        "sample": lambda: render_samples(scene, view, trace, 0),
        "frame": lambda: render_noisy(
            scene, view, noisy_settings(single.groundtruth, single.shading, single.noisy), 0
        ),
    }
    for work in ways.values():  # compiles; the round that is not counted records once more
        work()
    spent = by_turns(ways, bench.sizes.repeats)
    size = f"{view.width}x{view.height}"

    def seconds(name: str, key: str, meaning: str) -> Row:
        return Row(name, meaning, spread([each.cpu for each in spent[key]]), "s", "cpu")

    light = "direct and indirect light and the image of `radiosity`, {}, kernels compiled"
    yield seconds("transport, 160x120", "small", light.format("160x120"))
    yield seconds("transport", "large", light.format(size))
    yield Row(
        "guides of few samples / guides of the ground truth",
        f"albedo and normal of nine rays per pixel, {size}",
        ratio(spent["fast"], spent["guides"], "cpu"),
        clock="cpu",
        goal=at_most(0.5),
    )
    sample = f"colour of one sample per pixel for an image, guided and denoised, {size}"
    yield seconds("one denoised sample", "sample", sample)
    both = f"colour and shading of one joint sample per pixel, both guided and denoised, {size}"
    yield seconds("a noisy frame of one sample", "frame", both)
    # What a picture of one sample took when it was a frame with the guides of the truth.
    former = [
        Spent(frame.cpu - fast.cpu + slow.cpu, frame.wall - fast.wall + slow.wall)
        for frame, fast, slow in zip(spent["frame"], spent["fast"], spent["guides"], strict=True)
    ]
    yield Row(
        "one denoised sample / with shading and the guides of the ground truth",
        f"the image, against a noisy frame with the other guides, {size}",
        ratio(spent["sample"], former, "cpu"),
        clock="cpu",
        goal=at_most(0.5),
    )
