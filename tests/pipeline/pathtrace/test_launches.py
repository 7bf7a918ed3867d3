"""Frozen launches: a replayed launch equals a new one, whatever happened in between."""

import gc
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

from pbrnet.pipeline.passes.groundtruth import render_both, render_truth
from pbrnet.pipeline.pathtrace import launches
from pbrnet.pipeline.pathtrace.launches import PathTracer, Recordings
from pbrnet.pipeline.render.scene import RenderScene, free_memory, open_scene
from pbrnet.pipeline.views import View
from tests.fixtures.joint import LAMP, sunsky
from tests.fixtures.params import plain_truth
from tests.fixtures.render import (
    WINDOW,
    ball,
    diffuse,
    make_view,
    quad,
    room_walls,
    write_scene,
)

pytestmark = pytest.mark.usefixtures("wavefront")

PARAMS = plain_truth(spp=8, block_spp=4)
SIZE = (24, 18)
VIEWS = [
    make_view((0, -1.8, 1.5), (0.2, 1, -0.1), size=SIZE),
    make_view((0.5, 1.2, 1.2), (-0.3, -1, -0.2), size=SIZE),
    make_view((-1.0, 0.0, 1.8), (1, 0.3, -0.4), size=SIZE),
]
SKY = sunsky()

# Another kind of emitter, with a kernel that compiles fast.
MIRROR = (
    '<bsdf type="twosided"><bsdf type="conductor"><string name="material" value="none"/>'
    '<rgb name="specular_reflectance" value="0.92,0.92,0.92"/></bsdf></bsdf>'
)
GLASS = '<bsdf type="dielectric"/>'
PLASTIC = '<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.1,0.02,0.05"/></bsdf>'
WHITE_SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


def room(folder: Path, *things: str, wall: str = "0.6,0.5,0.4") -> RenderScene:
    walls, _ = room_walls(diffuse(wall), window=True)
    scene = folder / f"room{len(list(folder.iterdir()))}"
    return open_scene(write_scene(scene, walls + LAMP + "".join(things), portals=[WINDOW]))


def both(scene: RenderScene, view: View, albedo: float = 0.5, seed: int = 1, **params: Any) -> Any:
    """Colour and shading, (2, H, W, 3)."""
    truths = render_both(scene, view, replace(PARAMS, **params), albedo, seed)
    return np.stack(
        [[channels[band] for band in "RGB"] for channels, _ in (truths.color, truths.shading)]
    )


_FRESH: dict[Any, Any] = {}


def fresh(scene: RenderScene, view: View, **options: Any) -> Any:
    """The images of a view from the same scene opened anew; computed once per scene and view."""
    key = (scene.scene.xml.read_text(), repr(view), tuple(sorted(options.items())))
    if key not in _FRESH:
        _FRESH[key] = both(open_scene(scene.scene), view, **options)
    return _FRESH[key]


@pytest.mark.slow
def test_images_do_not_depend_on_the_number_of_lanes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A path is the same whatever its lane traced before: with all that a path can remember."""
    things = [
        ball(f"ball{number}", (number - 1, 1.0, 1.2), 0.4, material)
        for number, material in enumerate((GLASS, PLASTIC))
    ]
    walls, _ = room_walls(diffuse("0.6,0.5,0.4"), window=True)
    glazed = [replace(WINDOW, panes=2)]
    body = walls + LAMP + SKY + "".join(things)
    scene = open_scene(write_scene(tmp_path / "glazed", body, portals=glazed))
    found = []
    for lanes in (1 << 20, 100):  # one sample a lane; 35, fewer in the last one, or none
        monkeypatch.setattr(launches, "_LANES", lanes)
        monkeypatch.setattr(launches, "_PER_LANE", 1 << 20)
        scene.materials.kept(PathTracer).recordings = Recordings()
        truths = render_both(scene, VIEWS[0], PARAMS, 0.5, 1, light=True)
        images = [truths.color, truths.shading, *truths.parts.values()]
        found.append(np.array([[channels[band] for band in "RGB"] for channels, _ in images]))
    np.testing.assert_array_equal(*found)


def test_pixels_without_a_ray_are_black(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the corners of a fisheye, in a furnace; lanes go on after such a sample."""
    monkeypatch.setattr(launches, "_LANES", 1)
    fisheye = replace(VIEWS[0], K=((6.0, 0, 12), (0, 6.0, 9), (0, 0, 1)), projection="fisheye")
    valid = fisheye.lens.rays().valid
    assert 0.1 < valid.mean() < 0.9
    body = ball("ball", (0, 2, 1.5), 1.0, diffuse(1)) + WHITE_SKY
    for image in both(open_scene(write_scene(tmp_path / "furnace", body)), fisheye, albedo=1.0):
        assert (image[:, ~valid] == 0).all()
        np.testing.assert_allclose(image[:, valid], 1, rtol=0.2)


def recordings(scene: RenderScene) -> int:
    return len(scene.materials.kept(PathTracer).recordings)


@pytest.mark.slow
def test_views_of_a_scene_share_a_recording(tmp_path: Path) -> None:
    scene = room(tmp_path, ball("ball", (0.5, 1.0, 0.5), 0.5, diffuse("0.2,0.6,0.3")), SKY)
    seen = [both(scene, view, seed=seed) for seed, view in enumerate(VIEWS)]
    kinds = recordings(scene)
    again = [both(scene, view, seed=seed) for seed, view in enumerate(VIEWS)]
    assert recordings(scene) == kinds < len(VIEWS)
    for seed, view in enumerate(VIEWS):
        np.testing.assert_array_equal(seen[seed], again[seed])
        np.testing.assert_array_equal(seen[seed], fresh(scene, view, seed=seed))
    assert abs(both(scene, VIEWS[0], seed=5) - seen[0]).max() > 0


def test_rooms_with_and_without_a_mirror_share_a_kernel(tmp_path: Path) -> None:
    mirror = quad("mirror", (1.9, 0, 1.5), (-1, 0, 0), (0.5, 0.5), MIRROR)
    brighter = WHITE_SKY.replace('"1"', '"2"')
    used = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for things, wall in (((WHITE_SKY,), "0.6,0.5,0.4"), ((mirror, brighter), "0.2,0.7,0.7")):
            scene = room(tmp_path, *things, wall=wall)
            dr.kernel_history_clear()
            both(scene, VIEWS[0])
            kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
            used.append(max(kernels, key=lambda one: one["operation_count"])["hash"])
            del scene  # whose BSDFs would be compiled into the next one's kernels
    assert used[0] == used[1]


def test_the_second_launch_is_a_repeated_one(tmp_path: Path) -> None:
    # Dr.Jit records again now and then though nothing has changed: seldom, not five times of five.
    counts = []
    for _ in range(5):
        scene = room(tmp_path)
        both(scene, VIEWS[0])
        both(scene, VIEWS[0], seed=2)
        counts.append(recordings(scene))
    assert min(counts) == 1


@pytest.mark.slow
def test_what_happens_to_the_scene_in_between_is_noticed(tmp_path: Path) -> None:
    scene = room(tmp_path)
    wide = replace(VIEWS[1], K=make_view(size=SIZE, focal=9.0).K)
    large = make_view((0, -1.8, 1.5), (0.2, 1, -0.1), size=(30, 20))
    both(scene, VIEWS[0])
    cases: list[tuple[View, dict[str, Any]]] = [
        (wide, {}),  # another lens, the same size
        (large, {}),
        (VIEWS[1], {"spp": 16}),  # more blocks at once
        (VIEWS[1], {"spp": 4, "block_spp": 4, "max_depth": 3}),
        (VIEWS[1], {"lights": "uniform"}),
        (VIEWS[1], {"albedo": 0.2}),  # grey twins made anew
        (VIEWS[1], {}),  # and once more
        (large, {}),
        (VIEWS[0], {}),
    ]
    for view, options in cases:
        np.testing.assert_array_equal(both(scene, view, **options), fresh(scene, view, **options))


def test_a_change_of_materials_in_between_is_harmless(tmp_path: Path) -> None:
    scene = room(tmp_path)
    before = both(scene, VIEWS[0])
    for grey in (None, 0.5, 0.8):  # the last is still applied when 0.5 is needed
        render_truth(scene.neutral(grey), VIEWS[0], PARAMS, 1)
    np.testing.assert_array_equal(both(scene, VIEWS[0]), before)


@pytest.mark.slow
def test_scenes_that_come_and_go_in_between_are_harmless(tmp_path: Path) -> None:
    shiny = '<bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf>'
    first, second = room(tmp_path, wall="0.2,0.3,0.8"), room(tmp_path, WHITE_SKY)
    both(first, VIEWS[0])
    seen = [both(second, view) for view in VIEWS]
    del first
    gc.collect()
    np.testing.assert_array_equal(both(second, VIEWS[0]), seen[0])
    third = room(tmp_path, ball("metal", (0.5, 1.0, 0.5), 0.5, shiny), wall="0.1,0.9,0.1")
    np.testing.assert_array_equal(both(second, VIEWS[1]), seen[1])
    other = both(third, VIEWS[1])
    np.testing.assert_array_equal(both(second, VIEWS[2]), seen[2])
    np.testing.assert_array_equal(both(third, VIEWS[1]), other)
    np.testing.assert_array_equal(other, fresh(third, VIEWS[1]))


@pytest.mark.slow
def test_kernels_that_go_with_a_closed_scene_come_back(tmp_path: Path) -> None:
    first, second = room(tmp_path, wall="0.2,0.3,0.8"), room(tmp_path, WHITE_SKY)
    seen = [both(scene, view) for scene in (first, second) for view in VIEWS]
    del first
    free_memory()
    for view, image in zip(VIEWS, seen[len(VIEWS) :], strict=True):
        np.testing.assert_array_equal(both(second, view), image)
        free_memory()  # between views as well
    np.testing.assert_array_equal(fresh(second, VIEWS[0]), seen[len(VIEWS)])
