"""Rows about single renders: joint and plain traces, LLVM and scalar, and the other passes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import mitsuba as mi
import numpy as np

from benchmarks.bench import Bench, python, resized
from benchmarks.plain_loop import plain_sensor
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.timing import Spent, beyond, by_turns, ratio, spread, sums
from pbrnet.pipeline.cameras import view_sampling
from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.channels import TRACED, TRUTHS
from pbrnet.pipeline.passes.environment import render_environment, settings
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.registry import render, settings_of
from pbrnet.pipeline.passes.settings import EnvironmentParams, IlluminationParams, LightParams
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import CameraFile, View, as_matrix

_LAMPS = 8  # with a light group of their own
PANORAMA = IlluminationParams(width=360)
ENVIRONMENT = EnvironmentParams(width=256)
# Candidates that were refused before anything was looked at.
_UNSEEN = (
    view_sampling.NO_LIGHT,
    view_sampling.OUTSIDE,
    view_sampling.ABOVE,
    view_sampling.TOO_CLOSE,
    view_sampling.INSIDE,
    view_sampling.NOT_TRIED,
)


def plain_render(
    scene: RenderScene, view: View, spp: int, seed: int, depth: int, sampler: str = "multijitter"
) -> np.ndarray:
    """Render with Mitsuba's `path` and film by `mi.render`; return (H, W, 3)."""
    integrator = mi.load_dict({"type": "path", "max_depth": depth})
    sensor = plain_sensor(view, sampler)
    image = mi.render(scene.mitsuba, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
    return np.array(image)[..., :3]


def render_rows(bench: Bench) -> Iterator[Row]:
    """Yield the costs of a view's passes relative to each other, and of camera sampling."""
    sizes, params = bench.sizes, bench.params
    scene = bench.open(bench.home)
    view = resized(bench.views[bench.home][0], sizes.large)
    step = view.pose.copy()
    step[:3, 3] += 0.06 * step[:3, 2]  # metres ahead
    moved = replace(view, pose_before=view.camera_to_world, pose_after=as_matrix(step))
    truth, depth = params.groundtruth, params.groundtruth.max_depth
    grey = scene.neutral(params.shading.albedo)

    def both(spp: int, seed: int) -> object:
        settings = replace(truth, spp=spp)
        return render_both(scene, view, settings, params.shading.albedo, seed)

    ways: dict[str, Callable[[int], object]] = {
        "color": lambda spp: plain_render(scene, view, spp, 0, depth),
        "shading": lambda spp: plain_render(grey, view, spp, 0, depth),
        "joint": lambda spp: both(spp, 0),
        "panorama": lambda spp: render_illumination(scene, view, PANORAMA),
        "environment": lambda spp: render_environment(
            scene, view, settings(replace(truth, denoise="none"), replace(ENVIRONMENT, spp=spp)), 0
        ),
        "inputs": lambda spp: render_inputs(scene, view),
        "labels": lambda spp: render_surfaces(scene, view, ("inputs", "materials", "labels")),
        "video": lambda spp: render_surfaces(scene, moved, ("inputs", "video")),
        "cameras": lambda spp: _sampled(bench, scene),
    }
    for work in ways.values():
        work(min(truth.spp, 2 * truth.block_spp))  # compiles, with launches as large as those timed
    spent = by_turns(
        {name: partial(work, truth.spp) for name, work in ways.items()}, sizes.repeats, warm=False
    )
    yield from _joint_rows(spent, f"{view.width}x{view.height}, {truth.spp} spp")
    yield from _cheap_rows(spent, len(bench.views[bench.home]))
    yield from _light_rows(bench, scene, view)
    yield _panorama_row(bench, scene)
    yield _camera_row(bench, scene)


def _joint_rows(spent: dict[str, list[Spent]], size: str) -> Iterator[Row]:
    yield Row(
        "joint trace / one plain render",
        f"colour and shading in one trace against colour by `path`, {size}",
        ratio(spent["joint"], spent["color"], "cpu"),
        clock="cpu",
        goal=at_most(1.25),
    )
    yield Row(
        "joint trace / two plain renders",
        f"the same against colour and shading by `path` one after the other, {size}",
        ratio(spent["joint"], sums(spent["color"], spent["shading"]), "cpu"),
        clock="cpu",
    )


def _cheap_rows(spent: dict[str, list[Spent]], views: int) -> Iterator[Row]:
    per_view = [Spent(s.cpu / views, s.wall / views) for s in spent["cameras"]]
    cheap = sums(sums(spent["panorama"], spent["inputs"]), per_view)
    yield Row(
        "inputs, panorama and cameras / ground truth",
        "depth, normal and reflectance of a view, its panorama 360 pixels wide and its share of "
        f"sampling {views} views, against the joint trace above",
        ratio(cheap, spent["joint"], "cpu"),
        clock="cpu",
        goal=at_most(0.05),
    )
    for name, meaning in (("labels", "materials and labels"), ("video", "flow and occlusion")):
        more = beyond(spent[name], spent["inputs"])
        yield Row(
            f"{meaning} / ground truth",
            "what they add to one view's inputs, from the same rays, against the joint trace above",
            ratio(more, spent["joint"], "cpu"),
            clock="cpu",
            goal=at_most(0.05),
        )
    around = ENVIRONMENT.width
    yield Row(
        "environment / ground truth",
        f"a path-traced panorama {around} x {around // 2} with distance and normal, of as many "
        "samples per pixel, against the joint trace above",
        ratio(spent["environment"], spent["joint"], "cpu"),
        clock="cpu",
    )
    for name in ("inputs", "panorama"):
        meaning = f"the part of it that is the {name}"
        share = ratio(spent[name], spent["joint"], "cpu")
        yield Row(f"{name} / ground truth", meaning, share, clock="cpu")


def _light_rows(bench: Bench, scene: RenderScene, view: View) -> Iterator[Row]:
    truth = replace(bench.params.groundtruth, denoise="oidn")
    params = replace(bench.params, groundtruth=truth)
    grouped = replace(params, light=LightParams(_LAMPS))
    ways: dict[str, Callable[[], object]] = {
        "groups": lambda: render(scene, view, settings_of(grouped, TRACED), 0),
        "light": lambda: render(scene, view, settings_of(params, TRACED), 0),
        "truth": lambda: render(scene, view, settings_of(params, TRUTHS), 0),
    }
    for work in ways.values():  # twice with the round below: launches of kinds in turn are
        work()  # recorded a second time
    spent = by_turns(ways, bench.sizes.repeats)
    size = f"{view.width}x{view.height}, {truth.spp} spp, the denoiser included"
    yield Row(
        "ground truth with the parts of the light / ground truth",
        f"shading, colour, direct and diffuse light and irradiance against the first two, {size}",
        ratio(spent["light"], spent["truth"], "cpu"),
        clock="cpu",
        goal=at_most(1.15),
    )
    yield Row(
        "the same with light groups / ground truth",
        f"an image of each of {_LAMPS} lamps, sky, sun and the rest as well",
        ratio(spent["groups"], spent["truth"], "cpu"),
        clock="cpu",
    )


def _panorama_row(bench: Bench, scene: RenderScene) -> Row:
    views = [resized(view, bench.sizes.large) for view in bench.views[bench.home]]
    ways = {str(i): partial(render_illumination, scene, v, PANORAMA) for i, v in enumerate(views)}
    spent = by_turns(ways, bench.sizes.repeats)
    return Row(
        "panorama",
        f"360 x 180, those of {len(views)} views one after the other, after the first",
        spread([1000 * each.wall for way in spent.values() for each in way]),
        "ms",
        "wall",
        at_most(50),
    )


def _camera_row(bench: Bench, scene: RenderScene) -> Row:
    first = _sampled(bench, scene)
    looked_at = first.candidates - sum(first.rejected.get(reason, 0) for reason in _UNSEEN)
    spent = by_turns({"cameras": lambda: _sampled(bench, scene)}, bench.sizes.repeats)["cameras"]
    return Row(
        "camera candidates",
        f"candidates per second, rendered as ids and scored ({looked_at} of one home), "
        "including clearance and selection",
        spread([looked_at / s.wall for s in spent]),
        "/s",
        "wall",
        at_least(2000),
    )


def _sampled(bench: Bench, scene: RenderScene) -> CameraFile:
    return view_sampling.sample_cameras(
        scene, ViewParams(bench.params.cameras, bench.params.image), 0
    )


_VARIANT = """
import json, sys
from pathlib import Path
from benchmarks.rendering import plain_render
from benchmarks.timing import spend
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.contract import load_scene
set_variant(sys.argv[1])
data, name, spp = Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
scene = open_scene(load_scene(data / "scenes" / name))
view = load_cameras(data / "cameras" / f"{name}.json").views[0]
plain_render(scene, view, 1, 0, 11)
spent = spend(lambda: plain_render(scene, view, spp, 1, 11))
print(json.dumps([spent.cpu, spent.wall]))
"""


def variant_rows(bench: Bench) -> Iterator[Row]:
    """Yield the scalar variant against the active one, each in processes of its own."""
    current = str(mi.variant())
    name = f"scalar_rgb / {current}"
    meaning = "a plain render by `path` with a compiled kernel"
    if current == "scalar_rgb":
        yield missing(name, meaning, "scalar_rgb is the only variant that runs here")
        return
    home, spp = bench.home, bench.sizes.spp
    spent: dict[str, list[Spent]] = {"scalar_rgb": [], current: []}
    for _ in range(bench.sizes.repeats):
        for variant, kept in spent.items():
            said = python("-c", _VARIANT, variant, str(bench.data), home, str(spp))
            kept.append(Spent(*json.loads(said.splitlines()[-1])))
    yield Row(name, meaning, ratio(spent["scalar_rgb"], spent[current], "cpu"), clock="cpu")
