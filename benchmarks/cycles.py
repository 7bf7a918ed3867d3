"""Rows of the comparison with Blender Cycles: error at equal core-seconds.

Both renderers get the same clay scene, camera, sky and path depth. Cycles is the package `bpy`, in
an environment of its own that is made on demand; the rows say so if that fails. First the long
renders of both are compared: their mean is the common reference only if they show the same scene.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR

from benchmarks.bench import ROOT, Bench, Reference, pixels, resized
from benchmarks.clay import SKY, camera_for_blender, write_clay
from benchmarks.rendering import plain_render
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.timing import Spent, spread, timed
from pbrnet.pipeline.passes.groundtruth import render_both, render_truth
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View

PROGRAM = ROOT / "benchmarks" / "blender_program.py"
NAME = "ours / Blender Cycles"
MEANING = "efficiency at equal core-seconds, clay under a constant sky"
_PATIENCE = 1800  # seconds to install, or for one render
AGREE = 0.01

Denoise = Literal["", "QUICK", "FAST", "ACCURATE"]  # "": no denoiser
Tried = tuple[np.ndarray, float]  # an image, and core-seconds


class BlenderMissing(Exception):
    """Blender is not available; the message is the reason."""


@dataclass
class Blender:
    """A process that renders one scene with Cycles."""

    process: subprocess.Popen[str]
    folder: Path
    found: dict[str, Any] = field(default_factory=dict)  # version, objects, lamps, images, missing

    @property
    def version(self) -> str:
        """Blender's version."""
        return str(self.found["version"])

    def answer(self) -> dict[str, Any]:
        """Return the next answer; skips Blender's own output."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("@"):
                return dict(json.loads(line[1:]))
        raise BlenderMissing(f"the renderer ended with status {self.process.wait()}")

    def render(self, portals: bool, spp: int, seed: int) -> Tried:
        """Return an image and its core-seconds, by the renderer's processor clock."""
        image, spent = self.picture(spp, seed, portals)
        return image, spent.cpu

    def picture(
        self,
        spp: int,
        seed: int,
        portals: bool = False,
        view: View | None = None,
        denoise: Denoise = "",
        **options: bool | float,
    ) -> tuple[np.ndarray, Spent]:
        """Return an image (H, W, 3) and the renderer's own seconds.

        Of `view`, or of the last one. `denoise`: as Cycles prefilters the guides of its denoiser;
        QUICK is FAST with the denoiser's quality fast, too. `options`: `guiding`, `light_tree` and
        `noise` of `benchmarks/blender_program.py`.
        """
        out = self.folder / "cycles.exr"
        job: dict[str, Any] = {"spp": spp, "seed": seed, "portals": portals, "denoise": denoise}
        job |= {"out": str(out), **options}
        if view is not None:
            job["camera"] = camera_for_blender(view)
        assert self.process.stdin is not None
        print(json.dumps(job), file=self.process.stdin, flush=True)
        spent = self.answer()
        with OpenEXR.File(str(out)) as file:
            return np.array(file.channels()["RGB"].pixels), Spent(spent["cpu"], spent["wall"])


def blender_python(tools: Path, given: Path | None) -> Path:
    """Return an interpreter that has `bpy`: the given one, or of an environment in `tools`.

    Raises `BlenderMissing` if there is none and none can be made.
    """
    if given is not None:
        return given
    folder = tools / "bpy"
    interpreter = folder / "bin" / "python"
    install = [str(interpreter), "-m", "pip", "install", "--quiet", "--only-binary=:all:", "bpy"]
    steps = [[sys.executable, "-m", "venv", str(folder)], install]
    if not has_bpy(interpreter):
        for step in steps:
            run_step(step)
    if not has_bpy(interpreter):
        raise BlenderMissing("bpy was installed but cannot be imported")
    return interpreter


def has_bpy(interpreter: Path) -> bool:
    """Return whether an interpreter exists and can import `bpy`."""
    if not interpreter.is_file():
        return False
    return subprocess.run([interpreter, "-c", "import bpy"], capture_output=True).returncode == 0


def run_step(command: list[str]) -> None:
    """Run a command of the installation; raises `BlenderMissing` if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BlenderMissing(str(error)) from None
    if done.returncode != 0:
        lines = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()
        raise BlenderMissing(f"bpy cannot be installed: {lines[-1]}")


@contextmanager
def blender(interpreter: Path, scene: Path) -> Iterator[Blender]:
    """Open the scene of the folder's `cycles.json` in a Blender process."""
    command = [str(interpreter), "-P", str(PROGRAM), str(scene / "cycles.json")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        found = Blender(process, scene)
        found.found = found.answer()
        yield found
    finally:
        assert process.stdin is not None
        process.stdin.close()
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()


def cycles_rows(bench: Bench) -> Iterator[Row]:
    """Yield rows against Cycles with default settings and with light portals."""
    try:
        yield from _compare(bench, blender_python(bench.tools, bench.bpy))
    except BlenderMissing as error:
        yield missing(NAME, MEANING, str(error), at_least(2.5))


def _compare(bench: Bench, interpreter: Path) -> Iterator[Row]:
    sizes, depth = bench.sizes, bench.params.groundtruth.max_depth
    folder = bench.folder / "clay"
    home, views = bench.open(bench.home), bench.views[bench.home]
    brightest, *_ = views_by_light(home, views, bench.folder / "probe", bench.params.groundtruth)
    view = resized(brightest, sizes.middle)
    clay = open_scene(write_clay(home, view, depth, folder))
    with blender(interpreter, folder) as other:
        ways = _ways(bench, clay, view, other)
        for way in ways.values():
            way(sizes.spp, 99)  # builds, compiles
        long = {name: ways[name](sizes.clay, 0)[0] for name in ("planned", "portals")}
        reference = Reference(long["planned"], long["portals"])
        difference = apart(reference, long["portals"], long["planned"])
        size = f"{view.width}x{view.height}, {sizes.clay} spp each, Blender {other.version}"
        yield Row(
            "mean of Cycles' long render / ours",
            f"deviation from 1 in the worst of three bands; {size}",
            spread([difference]),
            goal=at_most(AGREE),
        )
        own = {"planned": reference, "path": reference, "cycles": reference, "portals": reference}
        if difference > AGREE:  # each is held against its own kind
            own = _own_references(ways, long, sizes.clay)
        costs: dict[str, list[float]] = {name: [] for name in ways}
        for turn in range(sizes.repeats):
            for name, way in ways.items():
                image, cpu = way(sizes.spp, 2 + turn)
                costs[name].append(cpu * own[name].error(image))
    yield from _rows(costs, sizes.spp, difference <= AGREE)


def _rows(costs: dict[str, list[float]], spp: int, common: bool) -> Iterator[Row]:
    against = "a common reference" if common else "each renderer's own reference"
    for mine, what, goal in (
        ("planned", "the ground truth's joint trace, for its colour alone", at_least(2.5)),
        ("path", "Mitsuba's `path` with `multijitter`", None),
    ):
        for theirs, how in (("cycles", "by default"), ("portals", "with portals in the windows")):
            pairs = zip(costs[theirs], costs[mine], strict=True)
            yield Row(
                f"{NAME if mine == 'planned' else 'plain path / Blender Cycles'}, {how}",
                f"efficiency of {what} over that of Cycles {how}: error against {against} at "
                f"equal core-seconds, {spp} spp each",
                spread([cycles / ours for cycles, ours in pairs]),
                clock="cpu",
                goal=goal,
            )


def _ways(
    bench: Bench, clay: RenderScene, view: View, other: Blender
) -> dict[str, Callable[[int, int], Tried]]:
    truth, grey = bench.params.groundtruth, bench.params.shading.albedo

    def planned(spp: int, seed: int) -> Tried:
        settings = replace(truth, spp=spp, block_spp=min(truth.block_spp, spp))
        image, spent = timed(lambda: pixels(render_both(clay, view, settings, grey, seed).color))
        return image, spent.cpu

    def path(spp: int, seed: int) -> Tried:
        image, spent = timed(lambda: plain_render(clay, view, spp, seed, truth.max_depth))
        return image, spent.cpu

    return {
        "planned": planned,
        "path": path,
        "cycles": partial(other.render, False),
        "portals": partial(other.render, True),
    }


def _own_references(
    ways: dict[str, Callable[[int, int], Tried]], long: dict[str, np.ndarray], spp: int
) -> dict[str, Reference]:
    ours = Reference(long["planned"], ways["planned"](spp, 1)[0])
    theirs = Reference(long["portals"], ways["portals"](spp, 1)[0])
    return {"planned": ours, "path": ours, "cycles": theirs, "portals": theirs}


def apart(reference: Reference, first: np.ndarray, second: np.ndarray) -> float:
    """Return the largest relative difference of two long renders' means, over bands."""
    means = [np.minimum(image, reference.limit).mean(axis=(0, 1)) for image in (first, second)]
    return float(np.abs(means[0] / means[1] - 1).max())


def views_by_light(
    home: RenderScene, views: Sequence[View], folder: Path, truth: GroundTruthParams
) -> list[View]:
    """Return the views of a home by the light that they receive from the sky, the brightest first.

    `folder` is for the clay scene that is looked at.
    """
    clay = open_scene(write_clay(home, views[0], 3, folder))
    quick = replace(truth, spp=4, block_spp=4)
    images = [pixels(render_truth(clay, resized(view, (48, 36)), quick, 0)) for view in views]
    light = [np.minimum(image, 0.9 * SKY).mean() for image in images]  # not the sky itself
    return [views[index] for index in np.argsort(light)[::-1]]
