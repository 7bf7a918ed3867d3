"""Scenes, views and amounts of work of the benchmarks."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.frames import stacked
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.passes.groundtruth import Truth
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.views import ImageParams, View, as_matrix, intrinsics_of, load_cameras
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.contract import load_scene, scene_folders
from pbrnet.scenes.files import write_text

ROOT = Path(__file__).resolve().parent.parent
# Parameters of the homes by name, which depend on `Sizes`.
_HOMES = {
    # In `data`; the denoiser is left out: it is work that a plain loop does not do.
    "views": """
scenes: {{homes: {sizes.homes}}}
cameras: {{views_per_scene: {sizes.views}}}
groundtruth: {{spp: {sizes.spp}, block_spp: 16, denoise: none}}
dataset: {{splits: {{test: 0, validation: 0}}, row_group: 16, checks: {{max_noise: 1000000}}}}
""",
    # Of different light, with many lamps.
    "lit": """
scenes: {{homes: {sizes.lit}, rooms_min: 3}}
cameras: {{views_per_scene: 1}}
""",
    # Of a root seed of its own: homes that the committed weights have not seen. One view is scored.
    "unseen": """
seed: 37
scenes: {{homes: {sizes.budget_homes}}}
cameras: {{views_per_scene: 4}}
""",
}


@dataclass(frozen=True)
class Sizes:
    """Amounts of work; `FULL` takes an hour on two idle cores, and hours for `budgets`."""

    homes: int = 6  # more than workers, as in any dataset
    lit: int = 6  # more homes, for equal-time error
    trials: int = 2  # of each way of sampling in each of them
    views: int = 4  # a home, in the stages
    spp: int = 64
    repeats: int = 3
    processes: int = 2  # repeats of what starts processes
    large: tuple[int, int] = (480, 360)  # of single renders
    middle: tuple[int, int] = (192, 144)  # of what needs a reference
    reference: int = 128  # samples a pixel of each half of a reference
    clay: int = 512  # those of the clay's
    rows: int = 16  # views in the shards that are read
    rows_spp: int = 8
    budget_homes: int = 12  # of the time budgets, furnished
    budget_clay: int = 6  # of these, also as clay
    budget_trials: int = 4  # furnished scenes that choose the rivals' settings, beside one of clay
    budget_tried: tuple[float, ...] = (0.5, 2)  # seconds, there
    # Sizes of their pictures; samples a pixel that each renderer gives the reference.
    budget_sizes: tuple[tuple[int, int], ...] = ((160, 120), (480, 360), (960, 720))
    budget_spp: tuple[int, ...] = (1024, 128, 48)
    budgets: tuple[float, ...] = (0.1, 0.2, 0.5, 1, 2, 5)  # seconds

    @property
    def label(self) -> str:
        """Word for these amounts in files of results."""
        return "small" if self == SMALL else "full"


FULL = Sizes()
SMALL = Sizes(  # for trying the program: its figures mean nothing
    homes=2, lit=1, trials=1, views=1, spp=4, repeats=1, processes=1,
    large=(64, 48), middle=(48, 36), reference=32, clay=32, rows=2, rows_spp=1,
    budget_homes=1, budget_clay=1, budget_trials=1, budget_tried=(0.2,),
    budget_sizes=((48, 36), (64, 48)), budget_spp=(64, 64), budgets=(0.1, 0.5),
)  # fmt: skip


class Bench:
    """Homes and views in a folder, made on first use.

    `tools`: folder of what stays from run to run, as another renderer's environment; `bpy`: an
    interpreter with Blender; `docs`: folder of the documents' figures.
    """

    def __init__(
        self,
        folder: Path,
        sizes: Sizes,
        tools: Path,
        bpy: Path | None = None,
        docs: Path = ROOT / "docs",
    ) -> None:
        self.folder, self.sizes, self.tools, self.bpy, self.docs = folder, sizes, tools, bpy, docs
        self.data = self.folder_of("views")

    @cached_property
    def params(self) -> Params:
        """Parameters of the stages."""
        return self.params_of("views")

    @cached_property
    def views(self) -> dict[str, list[View]]:
        """Views of each home, at the size of the stages."""
        return self._made("views")

    @cached_property
    def lit(self) -> dict[str, list[View]]:
        """One view of each home with lamps in at least three rooms, by day, evening and night."""
        return self._made("lit")

    @cached_property
    def unseen(self) -> dict[str, list[View]]:
        """Views of homes that have been in no training."""
        return self._made("unseen")

    @property
    def home(self) -> str:
        """Name of the home with the most views."""
        return max(self.views, key=lambda name: len(self.views[name]))

    @property
    def parameters(self) -> Path:
        """Parameter file of the stages."""
        return self.folder / "views.yaml"

    def folder_of(self, homes: str) -> Path:
        """Return the data folder of `views`, `lit` or `unseen`."""
        return self.folder / f"data-{homes}"

    def params_of(self, homes: str) -> Params:
        """Write and read the parameters of `views`, `lit` or `unseen`."""
        file = self.folder / f"{homes}.yaml"
        write_text(file, _HOMES[homes].format(sizes=self.sizes))
        return load_params(file)

    def open(self, name: str, homes: str = "views") -> RenderScene:
        """Open a home of `views`, `lit` or `unseen` for rendering."""
        assert name in getattr(self, homes)
        return open_scene(load_scene(self.folder_of(homes) / "scenes" / name))

    def _made(self, homes: str) -> dict[str, list[View]]:
        """Make homes and cameras; return the views by home."""
        data, params = self.folder_of(homes), self.params_of(homes)
        run_scenes(data, params)
        run_cameras(data, params)
        names = [path.name for path in scene_folders(data / "scenes")]
        return {name: list(load_cameras(data / "cameras" / f"{name}.json").views) for name in names}


def resized(view: View, size: tuple[int, int]) -> View:
    """Return the same camera with another image size (width, height)."""
    width, height = size
    matrix = as_matrix(intrinsics_of(ImageParams(width=width, height=height)))
    return replace(view, width=width, height=height, K=matrix)


def python(*arguments: str, seconds: float | None = None) -> str:
    """Run this interpreter in the project folder for at most so long; return what it prints.

    Raises `RuntimeError` with its last words if it fails, and `subprocess.TimeoutExpired`.
    """
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(arguments)} failed:\n{done.stderr[-2000:]}")
    return done.stdout


@contextmanager
def kernels_below(folder: str) -> Iterator[None]:
    """Let processes that are started inside keep Dr.Jit's kernels below a folder."""
    before = os.environ.get("HOME", "")
    os.environ["HOME"] = folder  # kernels are in ~/.drjit
    try:
        yield
    finally:
        os.environ["HOME"] = before


def pixels(truth: Truth) -> Float64Array:
    """Return the image of a render, (H, W, 3)."""
    return stacked(truth[0]).astype(np.float64)


class Reference:
    """A long render in two independent halves, whose difference gives its own error.

    Errors are mean squared errors over the squared mean. Both images are clamped at the 99 %
    quantile of the reference: lamps and sky above it would outweigh the room.
    """

    def __init__(self, first: npt.ArrayLike, second: npt.ArrayLike) -> None:
        halves = [np.asarray(half, dtype=np.float64) for half in (first, second)]
        self.image = (halves[0] + halves[1]) / 2
        self.limit = float(np.quantile(self.image, 0.99))
        self.scale = float(np.minimum(self.image, self.limit).mean()) ** 2
        self.own = self._squares(halves[0], halves[1]) / 4

    def error(self, image: npt.ArrayLike) -> float:
        """Return the relative squared error of an image, minus the reference's own error."""
        return max(self._squares(np.asarray(image, np.float64), self.image) - self.own, 1e-12)

    def _squares(self, first: AnyArray, second: AnyArray) -> float:
        apart = np.minimum(first, self.limit) - np.minimum(second, self.limit)
        return float(np.mean(apart**2)) / self.scale
