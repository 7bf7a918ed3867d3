"""Material images: analytic roughness, metalness, F0 and bumped normals of every BSDF type."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.channels import channels_of
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.materials import RENDERERS
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.drjit_arrays import vector
from pbrnet.pipeline.render.materials import RULES
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.registry import import_scene
from tests.fixtures.encoded import picture
from tests.fixtures.gltf import square
from tests.fixtures.render import ball, glow, make_view, quad, write_scene
from tests.fixtures.xml import bitmap, bsdf

pytestmark = pytest.mark.usefixtures("variant")

GLASS = ((1.5 - 1) / (1.5 + 1)) ** 2  # F0 of an index of refraction of 1.5
IOR = {"int_ior": 1.5, "ext_ior": 1.0}
METAL = {"eta": (0.2, 0.9, 1.1), "k": (3.9, 2.5, 2.1)}
METAL_F0 = [((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
            for n, k in ((0.2, 3.9), (0.9, 2.5), (1.1, 2.1))]  # fmt: skip


def scene_of(folder: Path, body: str, **files: bytes) -> RenderScene:
    named = {f"textures/{name}.png": content for name, content in files.items()}
    return open_scene(write_scene(folder / "scene", body, files=named))


def materials(folder: Path, body: str, view: View | None = None, **files: bytes) -> Channels:
    return render_surfaces(scene_of(folder, body, **files), view or make_view(), ["materials"])[
        "materials"
    ][0]


def wall(material: str, towards: tuple[float, float, float] = (0, -1, 0)) -> str:
    """A wall that fills the view of `make_view()`."""
    return quad("wall", (0, 2, 1.5), towards, (4, 4), material)


def values_in(name: str) -> str:
    """A texture of raw values for a property."""
    return bitmap(name, "textures/t.png", raw=True, filter_type="nearest")


PLASTIC = bsdf("roughplastic", alpha=0.09, **IOR)
GOLD = bsdf("roughconductor", alpha=0.16, **METAL, specular_reflectance=(0.5,))
# material -> roughness, metalness, F0
KNOWN: dict[str, tuple[str, float, float, object]] = {
    "matt": (bsdf("diffuse"), 1, 0, 0),
    "default": ("", 1, 0, 0),
    "plastic": (bsdf("plastic", **IOR, specular_reflectance=(0.5, 1, 0)), 0, 0,
                [0.5 * GLASS, GLASS, 0]),
    "rough plastic": (PLASTIC, 0.3, 0, GLASS),
    "polarising": (bsdf("pplastic", alpha=0.09, **IOR), 0.3, 0, GLASS),
    "rough glass": (bsdf("roughdielectric", alpha=0.25, **IOR), 0.5, 0, GLASS),
    "mirror": (bsdf("conductor", material="none", specular_reflectance=(0.9, 0.8, 0.7)),
               0, 1, [0.9, 0.8, 0.7]),
    "gold": (GOLD, 0.4, 1, np.multiply(METAL_F0, 0.5)),
    "brushed": (bsdf("roughconductor", alpha_u=0.16, alpha_v=0.01, **METAL), 0.2, 1, METAL_F0),
    "principled": (bsdf("principled", roughness=0.35), 0.35, 0, 0.04),
    "half metal": (bsdf("principled", base_color=(0.8, 0.4, 0.2), roughness=0.6, metallic=0.5,
                        eta=1.5), 0.6, 0.5, [0.5 * (GLASS + c) for c in (0.8, 0.4, 0.2)]),
    "tinted": (bsdf("principled", base_color=(0.5, 0, 0), spec_tint=1.0, specular=1.0),
               0.5, 0, [0.08 / 0.2126, 0, 0]),
    "curtain": (bsdf("principledthin", roughness=0.9), 0.9, 0, 0),
    "two-sided": (bsdf("twosided", PLASTIC), 0.3, 0, GLASS),
    "masked": (bsdf("mask", PLASTIC, opacity=0.7), 0.3, 0, GLASS),
    "blend": (bsdf("blendbsdf", bsdf("diffuse"), GOLD, weight=0.25),
              0.85, 0.25, np.multiply(METAL_F0, 0.125)),
    "half nothing": (bsdf("blendbsdf", bsdf("null"), GOLD, weight=0.25),
                     0.4, 1, np.multiply(METAL_F0, 0.5)),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_values_follow_from_the_properties(name: str, tmp_path: Path) -> None:
    material, roughness, metalness, specular = KNOWN[name]
    got = materials(tmp_path, wall(material))
    assert (got["material_known"] == 1).all() and (got["material"] == 1).all()
    np.testing.assert_allclose(got["roughness"], roughness, atol=1e-6)
    np.testing.assert_allclose(got["metalness"], metalness, atol=1e-6)
    for band, value in zip("RGB", np.broadcast_to(np.array(specular), 3), strict=True):
        np.testing.assert_allclose(got[f"specular.{band}"], value, atol=2e-6)


def test_every_type_of_the_table_has_a_case() -> None:
    cases = " ".join(material for material, *_ in KNOWN.values())
    cases += bsdf("dielectric") + bsdf("thindielectric")  # the rays of a view pass them
    assert [plugin for plugin in RULES if f'type="{plugin}"' not in cases] == []


def test_a_ball_of_known_roughness_and_nothing_around_it(tmp_path: Path) -> None:
    got = materials(tmp_path, ball("b", (0, 2, 1.5), 0.5, PLASTIC))
    seen = got["material"] > 0
    assert 0.05 < seen.mean() < 0.5
    np.testing.assert_allclose(got["roughness"], np.where(seen, 0.3, 0), atol=1e-6)
    for channel in got.values():
        assert (np.asarray(channel)[~seen] == 0).all()


def test_textures_are_evaluated_where_the_ray_hits(tmp_path: Path) -> None:
    halves = np.zeros((4, 4, 3))
    halves[:, :2], halves[:, 2:] = 51, 204  # 0.2 and 0.8
    textures = values_in("roughness"), values_in("metallic")
    body = wall(bsdf("principled", *textures, base_color=(0.5,)))
    got = materials(tmp_path, body, t=picture(halves.astype(np.uint8)))
    share = got["roughness"]
    assert sorted(np.unique(share.round(6))) == [0.2, 0.8] and np.ptp(share[:, :16]) < 1e-6
    np.testing.assert_allclose(got["metalness"], share, atol=1e-6)
    np.testing.assert_allclose(got["specular.G"], 0.04 * (1 - share) + 0.5 * share, atol=1e-6)
    assert share[0, 0] != share[0, -1]


def test_a_blend_by_a_texture_mixes_by_it(tmp_path: Path) -> None:
    mask = np.zeros((4, 4, 3))
    mask[:2] = 255
    body = wall(bsdf("blendbsdf", values_in("weight"), bsdf("diffuse"), GOLD))
    got = materials(tmp_path, body, t=picture(mask.astype(np.uint8)))
    metal = got["metalness"]
    assert set(np.unique(metal)) == {0, 1} and 0.4 < metal.mean() < 0.6
    np.testing.assert_allclose(got["roughness"], np.where(metal == 1, 0.4, 1), atol=1e-6)


def test_the_two_sides_of_a_material_differ(tmp_path: Path) -> None:
    material = bsdf("twosided", PLASTIC, GOLD)
    for towards, metalness in (((0.0, -1.0, 0.0), 0), ((0.0, 1.0, 0.0), 1)):
        got = materials(tmp_path / str(metalness), wall(material, towards))
        assert (got["metalness"] == metalness).all()


def test_a_material_without_a_rule_is_unknown(tmp_path: Path) -> None:
    hair = bsdf("hair", id="fur")
    got = materials(tmp_path / "a", wall(hair))
    for name in ("material_known", "roughness", "metalness", "specular.R"):
        assert (got[name] == 0).all(), name
    assert (got["material"] == 1).all()
    blend = bsdf("blendbsdf", bsdf("diffuse"), hair, weight=0.5)
    assert (materials(tmp_path / "b", wall(blend))["material_known"] == 0).all()


def test_emission_is_marked_where_a_lamp_shines_and_not_behind_it(tmp_path: Path) -> None:
    lamp = quad("lamp", (-0.5, 2, 1.5), (0, -1, 0), (0.3, 0.3), glow())
    turned = quad("back", (0.5, 2, 1.5), (0, 1, 0), (0.3, 0.3), glow())
    off = quad("off", (0, 2, 1.9), (0, -1, 0), (0.1, 0.1), glow(0))
    scene = scene_of(tmp_path, lamp + turned + off)
    got, facts = render_surfaces(scene, make_view(), ["materials"])["materials"]
    names = np.array(["", *facts["material_names"]])[got["material"]]
    for shape, shines in (("lamp", 1), ("back", 0), ("off", 0)):
        pixels = got["emission"][names == f"{shape}: twosided"]
        assert pixels.size and (pixels == shines).all(), shape


def test_ids_are_in_the_order_of_the_file_and_names_are_distinct(tmp_path: Path) -> None:
    shared = bsdf("diffuse", id="paint") + bsdf("plastic", id="unused")
    body = (
        shared
        + quad("a", (-1, 2, 1.5), (0, -1, 0), (0.4, 0.4), bsdf("diffuse"))
        + quad("b", (0, 2, 1.5), (0, -1, 0), (0.4, 0.4), '<ref id="paint"/>')
        + quad("c", (1, 2, 1.5), (0, -1, 0), (0.4, 0.4), '<ref id="paint"/>')
    )
    got, facts = render_surfaces(scene_of(tmp_path, body), make_view(), ["materials"])["materials"]
    assert facts["material_names"] == ["paint", "a: diffuse"]
    middle = got["material"][12]
    assert list(dict.fromkeys(middle[middle > 0])) == [2, 1]


BUMPS = 60 + 40 * np.sin(np.arange(64) / 3)[:, None] + 30 * np.cos(np.arange(64) / 4)[None]


@pytest.mark.parametrize("kind", ["bumpmap", "normalmap"])
@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.usefixtures("wavefront")
def test_bumped_normals_are_those_that_shade(kind: str, outside: bool, tmp_path: Path) -> None:
    """The radiance of a matt wall under a distant light is the cosine of its shading normal."""
    slopes = np.stack([BUMPS, BUMPS.T, np.full_like(BUMPS, 230)], axis=-1)
    texture = bitmap("normalmap" if kind == "normalmap" else "t", "textures/t.png", raw=True)
    inner = bsdf("diffuse", reflectance=(1.0,))
    material = bsdf(
        kind,
        texture,
        inner if outside else bsdf("twosided", inner),
        use_shadowing_function=False,
    )
    if outside:
        material = bsdf("twosided", material)
    bumps = picture((slopes if kind == "normalmap" else BUMPS).astype(np.uint8))
    for name, towards in (("front", (0.2, -1.0, 0.1)), ("back", (-0.2, 1.0, -0.1))):
        scene = scene_of(tmp_path / name, wall(material, towards), t=bumps)
        view = make_view()
        got = render_surfaces(scene, view, ["materials"])["materials"][0]
        plain = render_inputs(scene, view)
        normal = np.stack([got[f"bumped.{axis}"] for axis in "XYZ"], -1) @ view.pose[:3, :3].T
        flat = np.stack([plain[f"N.{axis}"] for axis in "XYZ"], -1) @ view.pose[:3, :3].T
        assert np.abs(normal - flat).max() > 0.1, "the map does something"
        np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
        for light in ((0.1, -1.0, 0.2), (-0.5, -1.0, -0.3)):
            towards_light = np.array(light) / np.linalg.norm(light)
            shaded = shading_cosine(scene, view, towards_light)
            lit = (normal @ towards_light > 0.05) & (shaded > 0.05)
            assert lit.mean() > 0.5
            np.testing.assert_allclose((normal @ towards_light)[lit], shaded[lit], atol=2e-4)


def shading_cosine(scene: RenderScene, view: View, light: np.ndarray) -> np.ndarray:
    """Cosine at which the visible surface's white matt BSDF takes light from a direction."""
    rays = np.stack(np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5), -1)
    local = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], -1)
    local = local @ np.linalg.inv(view.intrinsics).T @ view.pose[:3, :3].T
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    flat = local.reshape(-1, 3)
    ray = mi.Ray3f(
        vector(mi.Point3f, np.broadcast_to(view.eye, flat.shape)), vector(mi.Vector3f, flat)
    )
    si = scene.mitsuba.ray_intersect(ray)
    wo = si.to_local(vector(mi.Vector3f, np.broadcast_to(light, flat.shape)))
    value = si.bsdf().eval(mi.BSDFContext(), si, wo)
    return np.pi * np.array(value)[0].reshape(local.shape[:2])


def test_the_maps_of_a_gltf_file_arrive(tmp_path: Path) -> None:
    """Green of the texture is roughness, blue is metalness; the normal leans towards +u, +X."""
    made = square(
        pbrMetallicRoughness={
            "metallicRoughnessTexture": {"index": 0},
            "roughnessFactor": 0.5,
            "baseColorFactor": [0.8, 0.4, 0.2, 1],
        },
        normalTexture={"index": 1},
    )
    made.texture(np.full((2, 2, 3), (10, 200, 60), dtype=np.uint8))
    made.texture(np.full((2, 2, 3), (204, 128, 230), dtype=np.uint8))
    scene = import_scene(made.save(tmp_path / "in" / "model.glb"), tmp_path / "out")
    view = make_view((4, -4, 1), (0, 0, -1), focal=200, up=(0, 1, 0))
    got, facts = render_surfaces(open_scene(scene), view, ["materials"])["materials"]
    assert facts["material_names"][got["material"].min() - 1] == "material_paint"
    metalness = 60 / 255
    np.testing.assert_allclose(got["roughness"], 100 / 255, atol=1e-5)
    np.testing.assert_allclose(got["metalness"], metalness, atol=1e-5)
    for band, base in zip("RGB", (0.8, 0.4, 0.2), strict=True):
        value = (1 - metalness) * 0.04 + metalness * base
        np.testing.assert_allclose(got[f"specular.{band}"], value, atol=1e-4)
    normal = np.stack([got[f"bumped.{axis}"] for axis in "XYZ"], -1) @ view.pose[:3, :3].T
    leaning = np.array([204, 128, 230]) / 127.5 - 1
    np.testing.assert_allclose(normal[..., 0], leaning[0] / np.linalg.norm(leaning), atol=1e-4)
    assert (normal[..., 2] > 0.7).all()


def test_every_channel_has_a_renderer() -> None:
    assert list(RENDERERS) == [channel.name for channel in channels_of("materials")]
