"""`make bench`: ratios of costs, each measured in one run on one machine, interleaved.

Machines are shared and noisy, so no absolute time stands alone: every row compares two ways of
doing something, in turn, several times, and gives the median ratio with its spread. The table is
printed and written to benchmarks/results.json.
"""

from __future__ import annotations

import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import mitsuba as mi
import numpy as np
import pyarrow.dataset

from benchmarks.plain_loop import plain_sensor
from pipeline.cameras import sample_cameras
from pipeline.dataset import pack_dataset
from pipeline.frames import frame_path, read_frame
from pipeline.groundtruth import Truth, render_both, render_truth
from pipeline.illumination import render_illumination
from pipeline.inputs import render_inputs
from pipeline.params import Params, load_params
from pipeline.passes import render_truths
from pipeline.renderer import RenderScene, open_scene, renderer_version, set_variant
from pipeline.stages import run_cameras, run_groundtruth, run_illumination, run_inputs, run_scenes
from pipeline.views import View, load_cameras
from scenes.contract import load_scene, scene_folders
from scenes.files import write_json

REPEATS = 5
ROOT = Path(__file__).resolve().parent
# The denoiser is left out: it is work that a plain loop does not do.
PARAMETERS = """
scenes: {{homes: {homes}}}
cameras: {{views_per_scene: 4}}
groundtruth: {{spp: 32, block_spp: 8, denoise: none}}
dataset: {{splits: {{test: 0.34}}}}
"""


@dataclass(frozen=True)
class Row:
    """One comparison: the median of `a / b` over the repeats, and its range."""

    name: str
    ratio: float
    low: float
    high: float
    repeats: int
    meaning: str


def compare(
    name: str,
    meaning: str,
    a: Callable[[], object],
    b: Callable[[], object],
    repeats: int = REPEATS,
) -> Row:
    """Time `a` and `b` in turn; one warm-up of each is not counted."""
    seconds: tuple[list[float], list[float]] = ([], [])
    for attempt in range(repeats + 1):
        for way, kept in zip((a, b), seconds, strict=True):
            started = time.perf_counter()
            way()
            if attempt:
                kept.append(time.perf_counter() - started)
    return _row(name, meaning, [x / y for x, y in zip(*seconds, strict=True)])


def _row(name: str, meaning: str, ratios: list[float]) -> Row:
    return Row(name, statistics.median(ratios), min(ratios), max(ratios), len(ratios), meaning)


def error_ratio(scene: RenderScene, view: View, params: Params) -> Row:
    """Squared error of Mitsuba's default sampler over that of ours, at equal samples."""
    truth = replace(params.groundtruth, spp=4096, block_spp=256)
    reference = _pixels(render_truth(scene, view, truth, seed=1))
    ratios = []
    for seed in range(REPEATS):
        ours = render_truth(scene, view, replace(truth, spp=64, block_spp=16), seed=seed + 2)
        sensor = plain_sensor(view, "independent")
        integrator = mi.load_dict({"type": "path", "max_depth": params.groundtruth.max_depth})
        plain = np.array(
            mi.render(scene.mitsuba, sensor=sensor, integrator=integrator, spp=64, seed=seed)
        )
        ratios.append(
            _squared_error(_pixels(ours), reference) / _squared_error(plain[..., :3], reference)
        )
    return _row("error: ours / independent", "squared error of 64 spp, equal samples", ratios)


def joint_rows(scene: RenderScene, view: View, params: Params) -> list[Row]:
    """What the joint trace of colour and shading costs, and its errors, against plain renders."""
    truth, grey = params.groundtruth, params.shading.albedo
    rows = [
        compare(
            "joint trace / one plain render",
            f"seconds of colour and shading in one against `path`'s colour, {truth.spp} spp",
            lambda: render_both(scene, view, truth, grey, 0),
            lambda: render_truth(scene, view, truth, 0),
        )
    ]
    for name, form in (("color", scene), ("shading", scene.neutral(grey))):
        long = replace(truth, spp=4096, block_spp=256)
        reference = _pixels(render_truth(form, view, long, seed=1))
        ratios = []
        for seed in range(2, 2 + REPEATS):
            both = render_both(scene, view, truth, grey, seed)
            found, plain = getattr(both, name), render_truth(form, view, truth, seed + 100)
            ratios.append(
                _squared_error(_pixels(found), reference)
                / _squared_error(_pixels(plain), reference)
            )
        meaning = f"squared error of {truth.spp} spp, equal samples"
        rows.append(_row(f"error of {name}: joint / plain", meaning, ratios))
    return rows


def _pixels(truth: Truth) -> np.ndarray:
    return np.stack([truth[0][band] for band in "RGB"], axis=-1)


def _squared_error(image: np.ndarray, wanted: np.ndarray) -> float:
    limit = np.quantile(wanted, 0.99)  # the last per cent is lamps and their fireflies
    return float(np.mean((np.minimum(image, limit) - np.minimum(wanted, limit)) ** 2))


def scalar_ratio(data: Path, scene_id: str) -> Row:
    """Seconds of `scalar_rgb` over those of the variant in use, processes of their own."""
    code = (
        "import sys, time; from pathlib import Path\n"
        "from pipeline.params import Params, GroundTruthParams\n"
        "from pipeline.renderer import open_scene, set_variant\n"
        "from pipeline.groundtruth import render_truth\n"
        "from pipeline.views import load_cameras; from scenes.contract import load_scene\n"
        "set_variant(sys.argv[1]); data = Path(sys.argv[2])\n"
        "scene = open_scene(load_scene(data / 'scenes' / sys.argv[3]))\n"
        "view = load_cameras(data / 'cameras' / f'{sys.argv[3]}.json').views[0]\n"
        "truth = GroundTruthParams(spp=16, block_spp=16)\n"
        "render_truth(scene, view, truth, 0); start = time.perf_counter()\n"
        "render_truth(scene, view, truth, 1); print(time.perf_counter() - start)\n"
    )

    def seconds(variant: str) -> float:
        done = subprocess.run(
            [sys.executable, "-c", code, variant, str(data), scene_id],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return float(done.stdout.split()[-1])

    current = str(mi.variant())
    ratios = [seconds("scalar_rgb") / seconds(current) for _ in range(3)]
    return _row(f"scalar_rgb / {current}", "seconds of a ground truth render", ratios)


def reading_ratio(data: Path, views: list[View]) -> Row:
    """Seconds to read the EXR frames over seconds to read the same views from the shards."""

    def from_frames() -> None:
        for view in views:
            for kind in ("inputs", "illumination", "shading", "color"):
                read_frame(frame_path(data, kind, view), verify=False)

    def from_shards() -> None:
        pyarrow.dataset.dataset(sorted((data / "dataset").glob("*.parquet"))).to_table()

    return compare("EXR frames / shards", "seconds to read every view", from_frames, from_shards)


@click.command()
@click.option("--homes", default=3, show_default=True, help="Homes to measure on.")
@click.option("--out", type=click.Path(path_type=Path), default=ROOT / "results.json")
def main(homes: int, out: Path) -> None:
    """Measure, print the table and write it."""
    variant = set_variant()
    with tempfile.TemporaryDirectory() as folder:
        data, parameters = Path(folder) / "data", Path(folder) / "params.yaml"
        parameters.write_text(PARAMETERS.format(homes=homes))
        params = load_params(parameters)
        run_scenes(data, params)
        run_cameras(data, params)
        scene_ids = [path.name for path in scene_folders(data / "scenes")]
        views = {
            name: list(load_cameras(data / "cameras" / f"{name}.json").views) for name in scene_ids
        }
        name = max(views, key=lambda key: len(views[key]))
        scene = open_scene(load_scene(data / "scenes" / name))
        view, truth = views[name][0], params.groundtruth
        rows = [stage_ratio(data, parameters)]
        rows += [
            compare(
                "panorama / ground truth",
                f"{params.illumination.width} pixels wide against both images at {truth.spp} spp",
                lambda: render_illumination(scene, view, params.illumination),
                lambda: _both_truths(scene, view, params),
            ),
            compare(
                "inputs / ground truth",
                "one view's depth, normal, reflectance against colour and shading",
                lambda: render_inputs(scene, view),
                lambda: _both_truths(scene, view, params),
            ),
            compare(
                "cameras / ground truth",
                "sampling all views of a home against colour and shading of one of them",
                lambda: sample_cameras(scene, scene.scene, params, 0),
                lambda: _both_truths(scene, view, params),
            ),
            error_ratio(scene, view, params),
        ]
        if variant != "scalar_rgb":
            rows.append(scalar_ratio(data, name))
            rows += joint_rows(scene, view, params)
        run_inputs(data, params)
        run_illumination(data, params)
        run_groundtruth(data, params)
        pack_dataset(data, params)
        rows.append(reading_ratio(data, [one for each in views.values() for one in each]))
    _show(rows, out)


def _both_truths(scene: RenderScene, view: View, params: Params) -> None:
    render_truths(scene, view, params, 0)


def stage_ratio(data: Path, parameters: Path) -> Row:
    """The stage, workers and files included, over the plain loop; both in fresh processes."""

    def stage() -> None:
        for kind in ("shading", "color"):
            shutil.rmtree(data / kind, ignore_errors=True)
        options = ["--params", str(parameters), "--data", str(data)]
        _process("-m", "pipeline.cli", "groundtruth", *options)

    return compare(
        "groundtruth stage / mi.render loop",
        "wall time, equal views and spp; start, scene loading and files included",
        stage,
        lambda: _process("-m", "benchmarks.plain_loop", str(data), str(parameters)),
        repeats=2,
    )


def _process(*words: str) -> None:
    subprocess.run([sys.executable, *words], check=True, cwd=ROOT.parent, stdout=subprocess.DEVNULL)


def _show(rows: list[Row], out: Path) -> None:
    click.echo(f"{'comparison':36} {'ratio':>8} {'low':>8} {'high':>8}  meaning")
    for row in rows:
        click.echo(f"{row.name:36} {row.ratio:8.3f} {row.low:8.3f} {row.high:8.3f}  {row.meaning}")
    machine = {
        "cpus": len(os.sched_getaffinity(0)),
        "processor": platform.machine(),
        "python": platform.python_version(),
        "renderer": renderer_version(),
    }
    write_json(out, {"machine": machine, "rows": [asdict(row) for row in rows]})
    click.echo(f"written to {out}")


if __name__ == "__main__":
    main()
