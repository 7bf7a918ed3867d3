"""Memory of a worker process over hundreds of scenes: `python -m benchmarks.memory`.

A few procedural homes, each copied many times under other names, are opened and rendered by one
worker that is never replaced; the ledger records its resident memory after each scene. The first
use of each home is the warm-up: kernels are compiled, and memory rises to the need of the largest
home. After that it should stay constant. Cameras are sampled once per home and copied.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from matplotlib.figure import Figure

from pbrnet.pipeline.cameras.settings import CameraParams
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.farm.settings import FarmParams, Variant
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import GroundTruthParams, IlluminationParams
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.views import ImageParams, load_cameras, save_cameras
from pbrnet.scenes.contract import load_scene, save_scene, scene_folders
from pbrnet.scenes.files import atomic_file
from pbrnet.scenes.params import SceneParams

STAGES = {"inputs": "inputs", "illumination": "illumination", "truth": "groundtruth"}
_COLORS = ("#1f6fb2", "#c9541a", "#2c8a4b")


@dataclass(frozen=True)
class Course:
    """A worker's memory in one stage, in MB after each scene, in the order of work."""

    stage: str
    memory: tuple[float, ...]
    warm_up: int  # scenes until every home was met

    @property
    def growth(self) -> float:
        """Relative growth of the peak memory after the first part that follows the warm-up.

        A part has as many scenes as there are homes, so that every home is in each part.
        """
        peaks = self.peaks
        return max(peaks[1:]) / peaks[0] - 1 if len(peaks) > 1 else 0.0

    @property
    def peaks(self) -> tuple[float, ...]:
        """Peak memory of each part after the warm-up."""
        size = self.warm_up
        starts = range(size, len(self.memory) - size + 1, size)
        return tuple(max(self.memory[start : start + size]) for start in starts)


def parameters(homes: int, recycle: int = 0, variant: Variant = "auto") -> Params:
    """Return parameters for small views, one per scene, and one worker."""
    return Params(
        image=ImageParams(width=32, height=24),
        farm=FarmParams(workers=1, batch=1, recycle=recycle, variant=variant),
        scenes=SceneParams(homes=homes, rooms_min=1, rooms_max=3, texture_size=64),
        cameras=CameraParams(views_per_room=1, views_per_scene=1, candidates=4),
        illumination=IlluminationParams(width=32, supersampling=1, light_samples=4),
        groundtruth=GroundTruthParams(spp=4, block_spp=4, max_depth=5, denoise="none"),
    )


def measure(
    folder: Path,
    homes: int,
    scenes: int,
    recycle: int = 0,
    stages: Sequence[str] = ("truth",),
    variant: Variant = "auto",
) -> list[Course]:
    """Make homes below `folder`, copy them to this number of scenes, and run the stages."""
    params = parameters(homes, recycle, variant)
    run_scenes(folder, params)
    run_cameras(folder, params)
    multiply(folder, scenes)
    for stage in stages:
        run_frames(STAGES[stage], folder, params)
    return courses(folder, homes, stages)


def multiply(data: Path, count: int) -> None:
    """Copy the scenes that have views under other names until there are `count`.

    Meshes and textures are links to the same files; for the pipeline they are separate scenes.
    """
    root = data / "scenes"
    cameras = {path.stem: load_cameras(path) for path in (data / "cameras").glob("*.json")}
    originals = [folder for folder in scene_folders(root) if cameras[folder.name].views]
    for number in range(len(originals), count):
        original = originals[number % len(originals)]
        copy = root / f"{number:05}-{original.name}"  # work goes by name: one home after the other
        for file in sorted(path for path in original.rglob("*") if path.is_file()):
            target = copy / file.relative_to(original)
            target.parent.mkdir(parents=True, exist_ok=True)
            if file.name != "scene.json":
                os.link(file, target)
        scene = load_scene(original)
        save_scene(copy, replace(scene, scene_id=copy.name, source=scene.origin))
        file = cameras[original.name]
        views = tuple(replace(view, scene_id=copy.name) for view in file.views)
        save_cameras(
            data / "cameras" / f"{copy.name}.json", replace(file, scene_id=copy.name, views=views)
        )


def courses(folder: Path, homes: int, stages: Sequence[str]) -> list[Course]:
    """Return the memory of each stage from the ledger."""
    rows = [row for row in read_ledger(folder).to_pylist() if row["ended"] is not None]
    found = []
    for stage in stages:
        wanted = ("color",) if stage == "truth" else (stage,)
        done = sorted((row for row in rows if row["stage"] in wanted), key=lambda r: r["ended"])
        found.append(Course(stage, tuple(row["memory_mb"] for row in done), homes))
    return found


def draw(found: Sequence[Course]) -> Figure:
    """Draw memory over scenes, one line per stage; the warm-up is grey."""
    page = Figure(figsize=(9, 4), dpi=100, layout="constrained")
    axes = page.subplots()
    axes.axvspan(0, max(course.warm_up for course in found), color="#dddddd", linewidth=0)
    for course, color in zip(found, _COLORS, strict=False):
        label = f"{course.stage}: {course.growth:+.1%} after the warm-up"
        axes.plot(np.arange(1, len(course.memory) + 1), course.memory, color=color, label=label)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_xlabel("scenes that the worker has opened (grey: each home for the first time)")
    axes.set_ylabel("resident memory, MB")
    axes.legend(loc="lower right", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return page


@click.command()
@click.option("--homes", default=20, show_default=True, help="Different homes.")
@click.option("--scenes", default=500, show_default=True, help="Scenes made of them.")
@click.option(
    "--stage", "stages", type=click.Choice(list(STAGES)), multiple=True, default=("truth",)
)
@click.option("--recycle", default=0, show_default=True, help="As farm.recycle.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("memory.png"),
    show_default=True,
)
def main(homes: int, scenes: int, stages: tuple[str, ...], recycle: int, out: Path) -> None:
    """Measure memory and draw it."""
    with tempfile.TemporaryDirectory(prefix="pbrnet-memory-") as folder:
        found = measure(Path(folder), homes, scenes, recycle, stages)
    with atomic_file(out) as partial:
        draw(found).savefig(partial)
    for course in found:
        peaks = ", ".join(f"{peak:.0f}" for peak in course.peaks)
        click.echo(f"{course.stage:14}{course.growth:+.2%}   peaks, MB: {peaks}")


if __name__ == "__main__":
    main()
