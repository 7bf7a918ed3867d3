"""BSDFs of one form are one object, with the values of the BSDFs that Mitsuba makes of each."""

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.render.bsdfs import BsdfMaker, describe
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.render.scenegraph import Graph, parse
from pbrnet.scenes.errors import InputError
from tests.fixtures.encoded import picture
from tests.fixtures.render import quad, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

POINTS = 2000


def image(name: str, file: str, inside: str = "") -> str:
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>'
        f"{inside}</texture>"
    )


RAW = '<boolean name="raw" value="true"/>'
NEAREST = '<string name="filter_type" value="nearest"/>'
CLAMPED = '<string name="wrap_mode" value="clamp"/>'
SHIFTED = '<transform name="to_uv"><scale x="3" y="-0.7"/><translate x="0.4" y="0.1"/></transform>'


def rgb(name: str, *values: float) -> str:
    return f'<rgb name="{name}" value="{",".join(map(str, values))}"/>'


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


def painted(normal: str, base: str, *others: str) -> str:
    return (
        f'<bsdf type="twosided"><bsdf type="normalmap">{normal}<bsdf type="principled">{base}'
        f"{''.join(others)}</bsdf></bsdf></bsdf>"
    )


def plain(plugin: str, *inside: str) -> str:
    return f'<bsdf type="{plugin}">{"".join(inside)}</bsdf>'


def bumps(which: int) -> str:
    return image("normalmap", f"normal{which}.png", RAW)


# Materials of each form; the names of textures count from 0 to 2.
FORMS = {
    "maps": [
        painted(
            bumps(which),
            image("base_color", f"colour{which}.png"),
            image("roughness", f"grey{which}.png", RAW + NEAREST),
        )
        for which in range(3)
    ],
    "metals": [
        painted(
            bumps(which),
            image("base_color", f"colour{which}.png"),
            number("metallic", 1 - which / 4),
        )
        for which in range(2)
    ],
    "placed": [
        plain("diffuse", image("reflectance", f"colour{which}.png", SHIFTED)) for which in range(2)
    ],
    "grey": [plain("diffuse", image("reflectance", "grey0.png"))],
    "constants": [
        plain("twosided", plain("diffuse", rgb("reflectance", 0.1 * which, 0.5, 0.2)))
        for which in range(1, 4)
    ],
    "cloth": [
        plain(
            "principledthin",
            image("base_color", "colour1.png"),
            number("diff_trans", 0.5 + which),
        )
        for which in range(2)
    ],
}
# Each for a reason of its own: a clamped image, 16 bits, sampling that follows from a mean.
OTHERS = [
    plain("diffuse", image("reflectance", "colour0.png", CLAMPED)),
    plain("diffuse", image("reflectance", "deep.png")),
    plain("roughplastic", rgb("diffuse_reflectance", 0.1, 0.2, 0.3)),
    plain("roughplastic", rgb("diffuse_reflectance", 0.3, 0.2, 0.3)),
]


@pytest.fixture(scope="module")
def materials() -> list[str]:
    return [bsdf for form in FORMS.values() for bsdf in form] + OTHERS


@pytest.fixture(scope="module")
def opened(
    tmp_path_factory: pytest.TempPathFactory, materials: list[str], wavefront: None
) -> RenderScene:
    """A rectangle of each material."""
    random = np.random.default_rng(3)
    files = {"deep.png": picture(random.integers(0, 65536, (4, 4)).astype(np.uint16))}
    for which, size in enumerate([(5, 7), (2, 2), (16, 4)]):
        files[f"colour{which}.png"] = picture(random.integers(0, 256, (*size, 3)).astype(np.uint8))
        files[f"grey{which}.png"] = picture(random.integers(60, 256, size[::-1]).astype(np.uint8))
        bumps = random.integers(96, 160, (*size, 3)).astype(np.uint8)
        bumps[..., 2] = 240
        files[f"normal{which}.png"] = picture(bumps)
    walls = "".join(
        quad(f"shape-{place:02}", (3 * place, 0, 0), (0, 0, 1), (1, 1), bsdf, up=(0, 1, 0))
        for place, bsdf in enumerate(materials)
    )
    return open_scene(write_scene(tmp_path_factory.mktemp("forms") / "room", walls, files=files))


def interactions(shape: Any, seed: int) -> Any:
    """Return interactions all over a shape, from either side, with texture coordinates around."""
    random = np.random.default_rng(seed)
    si = dr.zeros(mi.SurfaceInteraction3f, POINTS)
    si.t = mi.Float(1)
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    si.uv = mi.Point2f(random.uniform(-2, 3, (2, POINTS)).astype(np.float32))
    si.wi = dr.normalize(mi.Vector3f(random.normal(size=(3, POINTS)).astype(np.float32)))
    si.shape = mi.ShapePtr(shape)
    return si


def answers(bsdf: Any, si: Any) -> list[np.ndarray]:
    """Evaluate and sample a BSDF; return the values."""
    random = np.random.default_rng(7)
    wo = dr.normalize(mi.Vector3f(random.normal(size=(3, POINTS)).astype(np.float32)))
    first, second = random.random(POINTS), random.random((2, POINTS))
    value, pdf, sample, weight = bsdf.eval_pdf_sample(
        mi.BSDFContext(), si, wo, mi.Float(first.astype(np.float32)), mi.Point2f(second)
    )
    reflectance = bsdf.eval_diffuse_reflectance(si)
    return [np.array(each) for each in (value, pdf, sample.wo, sample.pdf, weight, reflectance)]


def alone(graph: Graph, node: int) -> Any:
    """Return the BSDF that Mitsuba makes of one node, with the sampling that ours has."""
    maker = BsdfMaker(graph)
    maker._merges = False
    return maker.make({node: describe(graph, node)}).made[node]


def test_bsdfs_of_one_form_are_one_with_the_values_of_each(
    opened: RenderScene, materials: list[str]
) -> None:
    graph = parse(opened.scene.xml)
    for place, node in enumerate(sorted(graph.shaders)):
        shape = opened.geometry.shapes[place]
        si = interactions(shape, place)
        for one, other in zip(
            answers(shape.bsdf(), si), answers(alone(graph, node), si), strict=True
        ):
            scale = 1 + np.abs(other)
            far = np.abs(one - other) > 2e-4 * scale  # a few choices of lobes fall the other way
            assert far.mean() < 2e-3, materials[place]


def test_materials_of_one_form_share_a_bsdf_and_others_do_not(opened: RenderScene) -> None:
    own = [bsdf.ptr for bsdf in opened.materials.own]
    assert len(set(own)) == len(FORMS) + len(OTHERS)
    assert len(set(own[:3])) == 1


def test_a_colour_that_creates_energy_is_refused(tmp_path: Path) -> None:
    bright = plain("diffuse", rgb("reflectance", 5, 1, 1))
    wall = quad("wall", (0, 0, 0), (0, 1, 0), (1, 1), bright)
    with pytest.raises(InputError, match="reflectance value"):
        open_scene(write_scene(tmp_path / "room", wall))


def test_no_texture_coordinates_are_out_of_reach(opened: RenderScene) -> None:
    si = interactions(opened.geometry.shapes[0], 1)
    si.uv = mi.Point2f(dr.tile(mi.Float([np.nan, np.inf, -np.inf, 1e30, -1e-9]), 400), 0.5)
    found = opened.materials.reflectances[min(opened.materials.reflectances.keys() - {-1})]
    assert np.array(found.eval_diffuse_reflectance(si)).shape == (3, POINTS)
