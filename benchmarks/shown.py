"""Scenes of the time budgets, which this project and Blender Cycles show alike."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchmarks.bench import Bench
from benchmarks.clay import write_clay
from benchmarks.cycles import views_by_light
from benchmarks.furnished import blender_folder, write_furnished
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.photometry import LUMEN

Kind = Literal["clay", "furnished"]
HOMES = "unseen"  # of `Bench`


@dataclass(frozen=True)
class Shown:
    """An open scene and its description for Blender.

    The first view is scored, the others serve for probes. Blender's radiance times `unit` is this
    project's.
    """

    name: str
    kind: Kind
    lighting: str
    scene: RenderScene
    views: tuple[View, ...]
    folder: Path  # with `cycles.json`
    unit: float


def show(bench: Bench, kind: Kind, name: str) -> Shown:
    """Open a home for both renderers: as clay under a white sky, or furnished in its own light."""
    folder = bench.folder / f"{kind}-{name}"
    depth = bench.params_of(HOMES).groundtruth.max_depth
    home, views = bench.open(name, HOMES), bench.unseen[name]
    if kind == "furnished":
        scene = write_furnished(home.scene, views[0], depth, folder)
        lighting, files, unit = scene.lighting, blender_folder(folder), LUMEN
    else:
        truth = bench.params_of(HOMES).groundtruth
        views = views_by_light(home, views, bench.folder / f"probe-{name}", truth)
        scene = write_clay(home, views[0], depth, folder)
        lighting, files, unit = "white sky", folder, 1.0
    return Shown(name, kind, lighting, open_scene(scene), tuple(views), files, unit)
