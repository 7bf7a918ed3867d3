"""Seconds until the first picture of a furnished home, by renderer, in a process of its own."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.bench import Bench, kernels_below, python, resized
from benchmarks.cycles import blender
from benchmarks.renderers import CyclesOptions, cycles_way, mitsuba_way
from benchmarks.shown import HOMES, show
from benchmarks.timing import spend
from pbrnet.model.evaluation.predict import ViewRenderer
from pbrnet.model.evaluation.previews import RADIOSITY, Preview
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.contract import load_scene

_SPP = 16  # of the path tracers


@dataclass(frozen=True)
class FirstPicture:
    """Elapsed and processor seconds of a process that renders one view, 160x120."""

    renderer: str
    wall: float
    cpu: float


def first_pictures(bench: Bench, params: Params, interpreter: Path) -> list[FirstPicture]:
    """Measure this project and Mitsuba's `path`, with and without kernels on disk, and Cycles.

    Starting the process, opening the scene, compiling and rendering count.
    """
    name = next(iter(bench.unseen))
    shown = show(bench, "furnished", name)
    size = bench.sizes.budget_sizes[0]
    view = resized(shown.views[0], size)
    cameras = bench.folder_of(HOMES) / "cameras" / f"{name}.json"
    found: list[FirstPicture] = []
    for title, method in (("this project, `radiosity`", RADIOSITY), ("Mitsuba's `path`", "path")):
        command = (
            *("-m", "benchmarks.first_pictures", method, str(shown.scene.scene.folder)),
            *(str(cameras), view.view_id, f"{size[0]}x{size[1]}"),
        )
        with TemporaryDirectory(prefix="pbrnet-bench-home-") as home, kernels_below(home):
            for kernels in ("compiled", "on disk"):
                spent = spend(partial(python, *command))
                found.append(FirstPicture(f"{title}, kernels {kernels}", spent.wall, spent.cpu))

    def cycles() -> None:
        with blender(interpreter, shown.folder) as other:
            options = CyclesOptions(portals=True, light_tree=True)
            cycles_way(shown, other, options, "ACCURATE")(view, _SPP, 0)

    spent = spend(cycles)
    return [*found, FirstPicture("Blender Cycles", spent.wall, spent.cpu)]


def main() -> None:
    """Render one view: METHOD SCENE CAMERAS VIEW WIDTHxHEIGHT."""
    method, scene, cameras, view_id, size = sys.argv[1:]
    set_variant()
    params = Params()
    opened = open_scene(load_scene(Path(scene)))
    (view,) = [one for one in load_cameras(Path(cameras)).views if one.view_id == view_id]
    width, height = map(int, size.split("x"))
    view = resized(view, (width, height))
    if method == RADIOSITY:
        Preview(ViewRenderer(opened, params)).render(view)
    else:
        mitsuba_way(opened, params, "independent", "high")(view, _SPP, 0)


if __name__ == "__main__":
    main()
