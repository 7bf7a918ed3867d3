"""Recorded launches that find surfaces and textures: the same bits as launches traced anew."""

import gc
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.raycast import wavefront
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from tests.fixtures.encoded import picture
from tests.fixtures.render import ball, diffuse, make_view, quad, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

NOISE = np.random.default_rng(0).integers(0, 256, (8, 8, 3), np.uint8)


def texture(name: str, raw: bool = True) -> str:
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="textures/t.png"/>'
        f'<boolean name="raw" value="{str(raw).lower()}"/></texture>'
    )


CHECKERS = '<texture type="checkerboard" name="roughness"/>'
COATED = f'<bsdf type="principled">{texture("base_color", False)}{texture("roughness")}</bsdf>'
TILED = f'<bsdf type="principled"><rgb name="base_color" value="0.6"/>{CHECKERS}</bsdf>'
RELIEF = f'<bsdf type="bumpmap">{texture("arbitrary")}{diffuse(0.4)}</bsdf>'
GLASS = '<bsdf type="thindielectric"/>'
LEAF = f'<bsdf type="mask">{texture("opacity")}{diffuse(0.8)}</bsdf>'


def room(folder: Path, *more: str) -> RenderScene:
    walls = (
        quad("back", (0, 3, 1.5), (0, -1, 0), (3, 3), COATED),
        quad("floor", (0, 0, 0), (0, -0.1, 1), (3, 3), TILED),
        quad("side", (2, 0, 1.5), (-1, 0, 0), (3, 3), RELIEF),
        quad("pane", (0, 1.5, 1.5), (0, -1, 0), (1, 1), GLASS),
        ball("ball", (-0.5, 2, 0.5), 0.4, diffuse(0.2)),
    )
    files = {"textures/t.png": picture(NOISE)}
    return open_scene(write_scene(folder, "".join((*walls, *more)), files=files))


VIEWS = [
    make_view((0, -1, 1.4), (0.3, 1, -0.2)),
    make_view((0.5, -0.5, 1.0), (0.6, 1, 0.1)),
    make_view((0, -1, 1.4), (-0.2, 1, -0.3), size=(31, 17)),
]


def images(scene: RenderScene, view: View) -> Channels:
    made = render_surfaces(scene, view, ("inputs", "materials"))
    return made["inputs"][0] | made["materials"][0]


def traced_anew(
    monkeypatch: pytest.MonkeyPatch, scene: RenderScene, views: list[View]
) -> list[Channels]:
    def direct(self: Any, *arguments: Any) -> list[Any]:
        return list(self._function(self._geometry(), *arguments))

    with monkeypatch.context() as patch:
        patch.setattr(wavefront._Recorded, "__call__", direct)
        return [images(scene, view) for view in views]


def same(one: Channels, other: Channels) -> bool:
    return (
        all(np.array_equal(one[name], other[name]) for name in one) and one.keys() == other.keys()
    )


@pytest.mark.parametrize("mask", [False, True])
def test_replayed_for_other_views_they_see_what_new_ones_see(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mask: bool
) -> None:
    leaf = quad("leaf", (0, 2.5, 1.5), (0, -1, 0), (1, 1), LEAF)
    scene = room(tmp_path / "a", *([leaf] if mask else []))
    known = traced_anew(monkeypatch, scene, VIEWS)
    for _ in range(2):  # recorded, then replayed
        found = [images(scene, view) for view in VIEWS]
        assert all(map(same, found, known))
    assert len(np.unique(known[0]["roughness"])) > 20, "textures are seen"
    assert not same(known[0], known[1])
    on_leaf = np.isclose(known[0]["albedo.G"], 0.8, atol=1e-3)
    assert on_leaf.any() == mask, "its texture cuts out the rest"


def test_neither_another_scene_nor_new_materials_disturb_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = room(tmp_path / "a")
    known = traced_anew(monkeypatch, scene, VIEWS[:1])
    for _ in range(2):
        assert same(images(scene, VIEWS[0]), known[0])
    other = room(tmp_path / "b", quad("door", (1, 2.9, 1), (0, -1, 0), (0.5, 1), diffuse(0.9)))
    assert not same(images(other, VIEWS[0]), known[0])
    scene.neutral(0.5)  # materials of its own, beside the scene's
    assert same(images(scene, VIEWS[0]), known[0])
    assert same(images(scene, VIEWS[0]), known[0])


def test_one_trace_of_surfaces_and_textures_has_the_bits_of_two(tmp_path: Path) -> None:
    scene = room(tmp_path / "a", quad("leaf", (0, 2.5, 1.5), (0, -1, 0), (1, 1), LEAF))
    for view in VIEWS:
        apart = (
            render_inputs(scene, view) | render_surfaces(scene, view, ["materials"])["materials"][0]
        )
        assert same(images(scene, view), apart)


def test_they_go_with_their_scene(tmp_path: Path) -> None:
    scene = room(tmp_path / "a")
    for _ in range(2):
        images(scene, VIEWS[0])
    geometry = weakref.ref(scene.geometry)
    del scene
    gc.collect()
    assert geometry() is None
