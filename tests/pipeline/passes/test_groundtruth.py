"""Ground truth: shading and colour against analytic radiometry."""

import os
import subprocess
import sys
from pathlib import Path

import mitsuba
import numpy as np
import pytest

from pbrnet.pipeline.passes import groundtruth
from pbrnet.pipeline.passes.groundtruth import block_sizes, blocks_per_launch, render_truth
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.render.variants import Cards
from pbrnet.pipeline.views import View
from pbrnet.scenes.errors import InputError
from tests.fixtures.encoded import exr, picture
from tests.fixtures.params import plain_truth
from tests.fixtures.paths import ROOT
from tests.fixtures.render import ball, diffuse, glow, make_view, quad, room_walls, write_scene
from tests.fixtures.xml import bitmap, emitter

pytestmark = pytest.mark.usefixtures("variant")


def truth(
    folder: Path,
    body: str,
    view: View,
    neutral: float | None = None,
    seed: int = 0,
    files: dict[str, bytes] | None = None,
    **params: int,
) -> np.ndarray:
    """The image, float64 (H, W, 3)."""
    scene = write_scene(folder / f"scene{len(list(folder.iterdir()))}", body, files=files)
    settings = plain_truth(**{"spp": 64, **params})
    channels, _ = render_truth(open_scene(scene, neutral), view, settings, seed)
    return np.stack([channels[band] for band in "RGB"], -1).astype(np.float64)


SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


def test_a_white_furnace_is_white(tmp_path: Path) -> None:
    view = make_view((0, -3, 1.5), size=(16, 16), focal=16)
    white = ball("s", (0, 0, 1.5), 1.0, diffuse(1.0)) + SKY
    got = truth(tmp_path, white, view, max_depth=100, rr_depth=100)
    np.testing.assert_allclose(got, 1, rtol=0.08)
    assert got.mean() == pytest.approx(1, rel=5e-3)
    # The neutral twin of a coloured, textured ball is as white if its grey is 1.
    red = white.replace(diffuse(1.0), diffuse("0.9,0.1,0.05"))
    assert truth(tmp_path, red, view)[8, 8, 2] < 0.2
    np.testing.assert_array_equal(
        truth(tmp_path, red, view, neutral=1.0, max_depth=100, rr_depth=100), got
    )


def test_light_in_a_closed_room_bounces_as_the_geometric_series(tmp_path: Path) -> None:
    # Walls that emit 0.5 and reflect half: 0.5 (1 + 1/2 + 1/4 + ...), cut at the path depth.
    emit = diffuse(0.5) + emitter("area", radiance=(0.5,))
    walls, _ = room_walls(emit)
    view = make_view(size=(16, 16))
    for depth in (1, 2, 4):
        got = truth(tmp_path, walls, view, max_depth=depth, rr_depth=100)
        assert got.mean() == pytest.approx(1 - 0.5**depth, rel=0.02)


def png(shade: int) -> bytes:
    pixels = (np.indices((8, 8)).sum(0)[..., None] % 2 * np.array([shade, 90, 20])).astype(np.uint8)
    return picture(pixels)


COLOURED = """
<bsdf type="twosided" id="wall"><bsdf type="diffuse">{wall}</bsdf></bsdf>
<bsdf type="principled" id="table"><rgb name="base_color" value="{table}"/>
  <float name="roughness" value="0.3"/><float name="metallic" value="0.4"/></bsdf>
<bsdf type="roughconductor" id="metal"><string name="material" value="{metal}"/>
  <float name="alpha" value="0.2"/></bsdf>
<bsdf type="dielectric" id="glass"><rgb name="specular_transmittance" value="{glass}"/></bsdf>
"""


def coloured_room(wall: str, table: str, metal: str, glass: str, window: bool = False) -> str:
    walls, _ = room_walls('<ref id="wall"/>', window)
    return (
        COLOURED.format(wall=wall, table=table, metal=metal, glass=glass)
        + walls
        + ball("a", (-0.6, 1, 1), 0.4, '<ref id="table"/>')
        + ball("b", (0.3, 1, 1), 0.4, '<ref id="metal"/>')
        + ball("c", (1.1, 1, 1.3), 0.3, '<ref id="glass"/>')
        + quad("lamp", (0, 0, 2.95), (0, 0, -1), (0.5, 0.5), glow("3,2,1"), (0, 1, 0))
    )


def test_shading_does_not_depend_on_colour(tmp_path: Path) -> None:
    texture = bitmap("reflectance", "textures/t.png")
    plain = '<rgb name="reflectance" value="0.2,0.7,0.4"/>'
    one = coloured_room(texture, "0.9,0.1,0.1", "Au", "1,1,1")
    two = coloured_room(plain, "0.1,0.3,0.9", "Cu", "0.2,0.9,0.3")
    view = make_view((0, -1.5, 1.5), size=(48, 36))
    files = {"textures/t.png": png(200)}
    shading = truth(tmp_path, one, view, neutral=0.5, spp=16, files=files)
    np.testing.assert_array_equal(shading, truth(tmp_path, two, view, neutral=0.5, spp=16))
    colour = truth(tmp_path, one, view, spp=16, files=files)
    assert abs(colour - truth(tmp_path, two, view, spp=16)).mean() > 0.05 * colour.mean()
    assert abs(colour - shading).mean() > 0.05 * colour.mean()


def test_a_twin_that_shares_geometry_equals_one_loaded_alone(tmp_path: Path) -> None:
    """Colour, shading and colour again from one open scene, against three of their own."""
    scene = write_scene(
        tmp_path / "s",
        coloured_room('<rgb name="reflectance" value=".2,.7,.4"/>', "1,.1,.1", "Au", "1"),
    )
    view, params = make_view((0, -1.5, 1.5), size=(32, 24)), plain_truth(spp=16)
    opened = open_scene(scene)
    twin = opened.neutral(0.5)
    for shared, alone in (
        (opened, open_scene(scene)),
        (twin, open_scene(scene, 0.5)),
        (opened, open_scene(scene)),
        (twin.neutral(None), open_scene(scene)),
    ):
        together, _ = render_truth(shared, view, params, 5)
        apart, _ = render_truth(alone, view, params, 5)
        for band in "RGB":
            np.testing.assert_array_equal(together[band], apart[band])


def test_shading_keeps_gloss_and_glass(tmp_path: Path) -> None:
    view = make_view((0, -1.5, 1.2), size=(48, 36))
    args = ('<rgb name="reflectance" value="0.5"/>', "1,.1,.1", "Au", "1")
    glossy = truth(tmp_path, coloured_room(*args), view, neutral=0.5, spp=64)
    matt = truth(
        tmp_path, coloured_room(*args).replace('value="0.2"', 'value="0.9"'), view, neutral=0.5
    )
    assert abs(glossy - matt).max() > 5 * glossy.mean()  # the lamp's reflection in the metal


def test_unknown_materials_have_no_neutral_twin(tmp_path: Path) -> None:
    body = ball("s", (0, 2, 1.5), 0.5, '<bsdf type="hair"/>') + SKY
    truth(tmp_path, body, make_view(), spp=1)
    with pytest.raises(InputError, match="hair"):
        truth(tmp_path, body, make_view(), neutral=0.5, spp=1)


def lit_room(folder: Path, spp: int, seed: int) -> np.ndarray:
    walls, _ = room_walls(diffuse(0.5))
    body = walls + quad("lamp", (0, 0, 2.95), (0, 0, -1), (0.5, 0.5), glow(3), (0, 1, 0))
    return truth(folder, body, make_view(size=(48, 36)), seed=seed, spp=spp, block_spp=4)


def test_seeds_matter_and_repeat(tmp_path: Path) -> None:
    first = lit_room(tmp_path, 16, 3)
    np.testing.assert_array_equal(first, lit_room(tmp_path, 16, 3))
    assert (first != lit_room(tmp_path, 16, 4)).any()


def test_samples_are_split_into_blocks() -> None:
    def sizes(spp: int, block: int) -> tuple[int, int]:
        return block_sizes(plain_truth(spp=spp, block_spp=block), 1 << 20)

    assert sizes(64, 16) == (16, 4)
    assert sizes(16, 16) == (8, 2)
    assert sizes(4, 16) == (2, 2)
    assert sizes(3, 16) == (1, 3)
    # A power of two that the sampler takes, so that no pixel is split between threads.
    assert sizes(40, 20) == (8, 5)
    assert sizes(64, 32) == (16, 4)
    assert sizes(12, 12) == (4, 3)
    assert sizes(1, 16) == (1, 1)
    assert blocks_per_launch(12, 1 << 18) == 6
    assert blocks_per_launch(7, 1 << 20) == 1
    assert blocks_per_launch(4, 1 << 30) == 1


@pytest.mark.parametrize(("gib", "samples", "block"), [(8, 1 << 24, 16), (139, 1 << 28, 64)])
def test_launches_on_a_card_fit_into_its_memory(
    monkeypatch: pytest.MonkeyPatch, gib: int, samples: int, block: int
) -> None:
    monkeypatch.setattr(groundtruth, "on_card", lambda: True)
    monkeypatch.setattr(groundtruth, "cards", lambda: Cards((gib << 30, 200 << 30)))
    assert groundtruth.launch_samples() == samples
    assert block_sizes(plain_truth(spp=128, block_spp=64), 1024 * 768) == (block, 128 // block)
    assert block_sizes(plain_truth(spp=4, block_spp=4), 1 << 30)[0] == 1  # never none
    assert blocks_per_launch(64, samples >> 3) == 8


def test_broken_samples_are_counted_and_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Fake:
        @staticmethod
        def render(*_: object, **__: object) -> np.ndarray:
            blocks = np.full((24, 4, 32, 3), 2.0, dtype=np.float32)
            blocks[5, :, 6] = -1e-4
            blocks[0, :, 0] = np.nan
            blocks[3, 1, 4] = np.inf
            blocks[10, 1, 10] = 1e4
            return blocks.reshape(24, 4 * 32, 3)

        def __getattr__(self, name: str) -> object:
            return getattr(mitsuba, name)

    scene = open_scene(write_scene(tmp_path / "s", ball("s", (0, 2, 1), 0.5, diffuse())))
    monkeypatch.setattr(groundtruth, "mi", Fake())
    channels, stats = render_truth(scene, make_view(), plain_truth(spp=16, block_spp=4), 0)
    assert stats["nan_pixels"] == 2 and stats["lost_pixels"] == 1
    assert stats["negative_pixels"] == 1
    assert channels["R"][3, 4] == 2 and channels["R"][0, 0] == 0 and channels["R"][5, 6] == 0
    assert stats["fireflies"] == pytest.approx(1 / (24 * 32))
    bright = 2 + (1e4 - 2) / 4
    rest = 2 * (24 * 32 - 3)
    assert stats["firefly_light"] == pytest.approx(bright / (bright + rest), rel=1e-4)
    assert stats["black"] == pytest.approx(2 / (24 * 32))
    assert all(np.isfinite(values).all() for values in channels.values())


SCRIPT = """
import sys
import drjit as dr
import numpy as np
from pathlib import Path
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.scenes.contract import load_scene
from tests.fixtures.params import plain_truth
from tests.fixtures.render import make_view

folder, out, variant, threads, spp = sys.argv[1:]
if int(threads):
    dr.set_thread_count(int(threads))
set_variant(variant)
rs = open_scene(load_scene(Path(folder)))
view = make_view((0, -1.5, 1.5), size=(48, 36))
params = plain_truth(spp=int(spp))
frames = {
    "inputs": render_inputs(rs, view),
    "illumination": render_illumination(rs, view, IlluminationParams(width=80)),
    "color": render_truth(rs, view, params, 7)[0],
    "shading": render_truth(rs.neutral(0.5), view, params, 7)[0],
    "ids": {"ids": raycast.object_ids(rs.geometry, view.pose[None], view.rays())[0]},
}
np.savez(out, **{f"{kind} {name}": v for kind, c in frames.items() for name, v in c.items()})
"""


@pytest.fixture(scope="module")
def rich_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Textures, gloss, glass, a mask, a small and a large lamp, an EXR environment."""
    folder = tmp_path_factory.mktemp("rich")
    sky = np.full((16, 32, 3), (0.2, 0.3, 0.5), dtype=np.float32)
    sky[5, 9] = 40
    texture = bitmap("reflectance", "textures/t.png")
    leaf = f'<bsdf type="mask"><texture type="checkerboard" name="opacity"/>{diffuse(0.3)}</bsdf>'
    body = coloured_room(texture, "0.9,0.1,0.1", "Au", "1", window=True)
    _, shapes = room_walls("", window=True)
    body += quad("screen", (0, 1.5, 1.5), (0, -1, 0), (0.4, 0.4), leaf)
    body += ball("bulb", (1, 0, 2), 0.02, glow(30))
    body += '<emitter type="envmap"><string name="filename" value="textures/sky.exr"/></emitter>'
    files = {"textures/t.png": png(200), "textures/sky.exr": exr(sky)}
    objects = {"room": shapes, "a": ("a",), "b": ("b",), "screen": ("screen",)}
    write_scene(folder / "scene", body, objects, files=files)
    return folder / "scene"


def render_apart(
    scene: Path, variant: str, threads: int = 0, spp: int = 16, prefix: tuple[str, ...] = ()
) -> dict[str, np.ndarray]:
    """All frames of the scene from a process of its own."""
    out = scene.parent / f"{variant}-{threads}-{spp}-{len(prefix)}.npz"
    command = [*prefix, sys.executable, "-c", SCRIPT, str(scene), str(out), variant]
    subprocess.run(
        [*command, str(threads), str(spp)],
        check=True,
        timeout=180,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    with np.load(out) as stored:
        return dict(stored)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["this", "scalar_rgb"])
def test_the_number_of_threads_changes_no_bit(rich_scene: Path, variant: str, kind: str) -> None:
    name = variant if kind == "this" else kind
    spp = 16 if kind == "this" else 4
    one, two = (render_apart(rich_scene, name, threads, spp) for threads in (1, 2))
    for channel, values in one.items():
        np.testing.assert_array_equal(values, two[channel], err_msg=channel)


@pytest.mark.slow
def test_one_allowed_cpu_is_enough(rich_scene: Path, variant: str) -> None:
    """Mitsuba's own EXR code hangs with one CPU; ours gives the same bits as with two."""
    alone = render_apart(
        rich_scene, variant, prefix=("taskset", "-c", str(min(os.sched_getaffinity(0))))
    )
    for channel, values in render_apart(rich_scene, variant, 2).items():
        np.testing.assert_array_equal(values, alone[channel], err_msg=channel)


@pytest.mark.slow
def test_the_scalar_variant_agrees(rich_scene: Path, variant: str) -> None:
    if variant == "scalar_rgb":
        pytest.skip("there is no other variant on this machine")
    wave = render_apart(rich_scene, variant, spp=64)
    scalar = render_apart(rich_scene, "scalar_rgb", spp=64)
    for channel, values in wave.items():
        kind = channel.split()[0]
        if kind in ("color", "shading"):
            # Each has its own noise; their means and their blurred images agree.
            assert scalar[channel].mean() == pytest.approx(values.mean(), rel=0.03)
            continue
        # Rays along an edge may fall on either side of it.
        differ = abs(values.astype(float) - scalar[channel]) > 1e-3 * max(1, abs(values).max())
        assert differ.mean() < 2e-3, channel
