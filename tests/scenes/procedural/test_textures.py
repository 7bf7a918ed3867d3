"""Textures of procedural materials: true size, seams, colour, normals and energy."""

from pathlib import Path

import defusedxml.ElementTree
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.color import decode_srgb
from pbrnet.scenes.procedural.materials import MAX_REFLECTANCE, MaterialLibrary, colored
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.textures.families import (
    FAMILIES,
    WEARS,
    _family,
    family_of,
    normal_map,
    packed_surface,
    surface,
)
from pbrnet.scenes.procedural.textures.fields import Surface, axes, constant, wave

EVERY = [(kind, family) for kind, families in FAMILIES.items() for family in families]


def library(folder: Path, **options: float) -> MaterialLibrary:
    (folder / "textures").mkdir(parents=True)
    return MaterialLibrary(folder, 128, seed=int(options.get("seed", 1)))


def image(material: Material, size: int) -> np.ndarray:
    return colored(material, packed_surface(material.kind, family_of(material), 1, size, 0))


def test_there_are_more_than_sixty_families() -> None:
    assert len(EVERY) >= 60


def test_an_unknown_option_of_a_family_is_refused() -> None:
    with pytest.raises(TypeError, match="glitter"):
        _family({"make": "goods.plastic", "detail": 4, "glitter": 1.0}, {})


@pytest.mark.parametrize("wear", [0, WEARS - 1])
def test_every_family_tiles_and_is_plausible(wear: int) -> None:
    """Colour, roughness and height go on across the seam; all states of wear have a texture."""
    for kind, family in EVERY:
        made = surface(kind, family, 1, 64, wear)
        assert 0.2 <= made.metres <= 4.0, family
        assert made.mix.min() >= 0 and made.mix.max() <= 1, family
        assert np.abs(made.rough).max() < 1 and made.shade.min() > -0.3, family
        assert np.ptp(made.height) < 0.15, family
        for field in (made.mix, made.shade, made.height):
            assert field.dtype == np.float32 and np.isfinite(field).all(), family
            for axis in (0, 1):
                steps = np.abs(np.diff(field, axis=axis)).mean(axis=1 - axis)
                seam = np.abs(np.take(field, 0, axis) - np.take(field, -1, axis)).mean()
                assert seam <= steps.max() * (5 if made.modules else 2) + 1e-6, (kind, family, axis)


def test_families_and_seeds_differ_and_repeat() -> None:
    shown = {surface(kind, family, 1, 64).shade.tobytes() for kind, family in EVERY}
    shown |= {surface(kind, family, 1, 64).height.tobytes() for kind, family in EVERY}
    assert len(shown) > 1.5 * len(EVERY)
    assert (
        surface("wood", "oak", 0, 64).mix.tobytes() != surface("wood", "oak", 1, 64).mix.tobytes()
    )
    again = surface("wood", "oak", 0, 64)
    assert again.mix.tobytes() == surface("wood", "oak", 0, 64).mix.tobytes()


@pytest.mark.parametrize(
    "kind", ["wood", "planks", "fabric", "carpet", "leather", "plaster", "stone", "grass", "soil"]
)
def test_a_texture_reflects_its_material_on_average(kind: str) -> None:
    for variant in (1, 17, 900):
        material = Material(kind, (0.45, 0.3, 0.2), accent=(0.2, 0.12, 0.08), variant=variant)
        linear = decode_srgb(image(material, 128) / 255.0)
        assert linear.mean(axis=(0, 1)) == pytest.approx([0.45, 0.3, 0.2], rel=0.03)
        white = Material(kind, (1.0, 1.0, 1.0), variant=variant)
        assert decode_srgb(image(white, 64) / 255.0).mean() < MAX_REFLECTANCE + 0.02


def test_tiles_are_as_large_as_they_claim() -> None:
    """The pattern of 1.2 m has grout lines every 0.3 m, 4 mm wide."""
    drawn = surface("tiles", "square", 3, 1024)
    row = drawn.mix[1024 // 8]  # through the centres of tiles
    lines = np.flatnonzero(np.diff((row > 0.5).astype(int)) == 1)
    pitch = np.diff(lines) * drawn.metres / 1024
    assert pitch == pytest.approx(0.3, abs=0.003)
    assert (row > 0.5).mean() * 0.3 == pytest.approx(0.004, abs=0.002)


def test_normals_are_those_of_the_height() -> None:
    """A wave of height a and length L has the steepest slope 2 pi a / L."""
    u, v = axes(256)
    metres, high = 0.5, 0.004
    for turns, axis in ((u * 4, 0), (v * 4, 1)):
        height = (high * wave(turns)).astype(np.float32)
        flat = constant(256, 0.0)
        normals = normal_map(Surface(flat, flat, flat, height, metres)) / 127.5 - 1.0
        slopes = -normals[..., axis] / normals[..., 2]
        assert slopes.max() == pytest.approx(2 * np.pi * high / (metres / 4), rel=0.03)
        assert np.abs(normals[..., 1 - axis]).max() < 0.01
        rising = np.diff(height, axis=1 - axis, append=0) > high / 50
        assert (slopes[rising] > -0.02).all()
        assert np.linalg.norm(normals, axis=-1) == pytest.approx(1, abs=0.01)


def test_a_bump_stays_a_bump_where_uvs_are_mirrored(tmp_path: Path) -> None:
    """Of a square seen from above, u x v points up after placing, however its uvs were laid."""
    made = library(tmp_path / "scene")
    wood = Material("wood", (0.4, 0.3, 0.2), variant=3)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    for uvs in (square[:, :2], square[:, :2] * [-1, 1], square[:, 1::-1]):
        placed = made.placed(wood, square, faces, None, uvs)
        a, b = placed[1] - placed[0], placed[2] - placed[0]
        assert 0.5 * (a[0] * b[1] - a[1] * b[0]) * made.tile(wood) ** 2 == pytest.approx(0.5)


def test_materials_share_what_they_share_and_differ_in_the_rest(tmp_path: Path) -> None:
    made = library(tmp_path / "scene")
    oak = Material("wood", (0.4, 0.3, 0.2), 0.4, variant=3, family="oak")
    names = {made.bsdf(oak), made.bsdf(Material("wood", (0.2, 0.2, 0.2), 0.4, family="oak"))}
    assert len(names) == 2
    assert made.bsdf(oak) in names
    other = library(tmp_path / "other", seed=2)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0]])
    faces = np.array([[0, 1, 2]])
    places = [one.placed(oak, square, faces, None, square[:, :2]) for one in (made, other)]
    assert np.abs(places[0] - places[1]).max() > 0.01
    assert made.tile(oak) != other.tile(oak)


@pytest.mark.usefixtures("variant")
def test_materials_do_not_add_energy(tmp_path: Path) -> None:
    """In a white furnace the brightest materials reflect no more than arrives."""
    made = library(tmp_path / "scene")
    white = (1.0, 1.0, 1.0)
    brightest = (
        ("plaster", "coarse", 0.9),
        ("fabric", "velvet", 0.95),
        ("wood", "oak", 0.1),
        ("tiles", "handmade", 0.05),
        ("metal", "hammered", 0.3),
        ("paint", "powder", 0.5),
    )
    ids = [
        made.bsdf(Material(kind, white, rough, white, family=family))
        for kind, family, rough in brightest
    ]
    text = f'<scene version="3.0.0">{"".join(made.xml)}</scene>'
    file = tmp_path / "scene" / "scene.xml"
    file.write_text(text)
    root = defusedxml.ElementTree.parse(file).getroot()
    assert {bsdf.get("id") for bsdf in root.findall("bsdf")} == set(ids)
    for name in ids:
        shape = f'<shape type="rectangle"><ref id="{name}"/></shape>'
        file.write_text(text.replace("</scene>", f"{shape}</scene>"))
        bsdf = mi.load_file(str(file)).shapes()[0].bsdf()
        for cosine in (1.0, 0.6, 0.25):
            assert _albedo(bsdf, cosine) < 1.01, (name, cosine)


def _albedo(bsdf: object, cosine: float) -> float:
    """Directional albedo, mean over the surface."""
    count = 1 << 14
    rng = np.random.default_rng(0)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.uv = mi.Point2f(rng.random((2, count)).astype(np.float32))
    si.wi = mi.Vector3f(float(np.sqrt(1 - cosine**2)), 0, cosine)
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.n = mi.Normal3f(0, 0, 1)
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    one = mi.Float(rng.random(count).astype(np.float32))
    two = mi.Point2f(rng.random((2, count)).astype(np.float32))
    _, weight = bsdf.sample(mi.BSDFContext(), si, one, two)  # type: ignore[attr-defined]
    return float(np.array(weight).mean())


def test_textures_are_files_of_their_kind(tmp_path: Path) -> None:
    """Colours and normals have three bands, roughness has one, and sides are powers of two."""
    made = library(tmp_path / "scene")
    made.bsdf(Material("stone", (0.4, 0.4, 0.4), 0.3))
    files = sorted((tmp_path / "scene" / "textures").iterdir())
    assert [Image.open(file).mode for file in files] == ["RGB", "L", "RGB"]
    for file in files:
        with Image.open(file) as opened:
            assert opened.size[0] == opened.size[1] and opened.size[0] in (64, 128)
