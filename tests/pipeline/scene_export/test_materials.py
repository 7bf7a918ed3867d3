"""Materials of exported scenes: they reflect as before after a way through a file and back."""

import io
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from pbrnet.pipeline.render.scene import set_variant
from pbrnet.pipeline.scene_export.content import Content, Piece
from pbrnet.pipeline.scene_export.glb import glb_bytes
from pbrnet.pipeline.scene_export.looks import LookReader, Picture
from pbrnet.pipeline.scene_export.pictures import color_bytes, grey, stored_bytes
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Credit, Scene
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.gltf import reader as gltf
from pbrnet.scenes.models.stated import Statement
from pbrnet.scenes.opened_files import OpenedFiles

_GREEN = "<rgb name='{}' value='.2 .6 .3'/>"
_BSDFS = {
    "diffuse": f"<bsdf type='diffuse'>{_GREEN.format('reflectance')}</bsdf>",
    "plastic": f"<bsdf type='plastic'>{_GREEN.format('diffuse_reflectance')}"
    "<string name='int_ior' value='acrylic glass'/></bsdf>",
    "rough_plastic": f"<bsdf type='roughplastic'>{_GREEN.format('diffuse_reflectance')}"
    "<float name='alpha' value='.2'/><boolean name='nonlinear' value='true'/></bsdf>",
    "mirror": "<bsdf type='conductor'><string name='material' value='none'/></bsdf>",
    "gold": "<bsdf type='conductor'><string name='material' value='Au'/></bsdf>",
    "steel": "<bsdf type='roughconductor'><rgb name='eta' value='1.66 .88 .52'/>"
    "<rgb name='k' value='9.2 6.3 4.8'/><float name='alpha' value='.1'/>"
    "<string name='distribution' value='ggx'/>"
    "<rgb name='specular_reflectance' value='.6'/></bsdf>",
    "glass": "<bsdf type='dielectric'><string name='int_ior' value='bk7'/></bsdf>",
    "frosted": "<bsdf type='roughdielectric'><float name='alpha' value='.2'/></bsdf>",
    "pane": "<bsdf type='thindielectric'><float name='int_ior' value='1.4'/></bsdf>",
    "cloth": "<bsdf type='principled'><float name='sheen' value='.5'/>"
    "<float name='clearcoat' value='.4'/></bsdf>",
    "sheet": "<bsdf type='principledthin'><float name='diff_trans' value='.8'/>"
    "<float name='roughness' value='1'/><float name='eta' value='1.001'/></bsdf>",
    "net": "<bsdf type='mask'><float name='opacity' value='.4'/><bsdf type='diffuse'/></bsdf>",
}


def _albedo(element: ElementTree.Element) -> Float64Array:
    """Reflected and transmitted share (4, 3) of light at four angles from the front."""
    set_variant("auto")
    bsdf = mi.load_string(
        "<scene version='3.0.0'><shape type='rectangle'>"
        + ElementTree.tostring(element, "unicode") + "</shape></scene>"
    ).shapes()[0].bsdf()  # fmt: skip
    count = 4096
    draws = np.random.default_rng(1).random((3, count)).astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.sh_frame, si.uv = mi.Frame3f(mi.Normal3f(0, 0, 1)), mi.Point2f(0.5)
    made = []
    for cosine in (0.9, 0.7, 0.5, 0.3):
        si.wi = mi.Vector3f(math.sqrt(1 - cosine**2), 0.0, cosine)
        _, weight = bsdf.sample(
            mi.BSDFContext(), si, mi.Float(draws[0]), mi.Point2f(draws[1], draws[2])
        )
        made.append(np.nan_to_num(np.array(weight, np.float64)).mean(axis=-1))
    return np.array(made)


def _content() -> Content:
    """A triangle of each of `_BSDFS`."""
    credit = Credit("everything", "test", "test", "CC0-1.0")
    content = Content(Scene("materials", {}, (), (), (), (), (credit,)))
    looks = LookReader({}, content.lost)
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), np.array([[0, 1, 2]]))
    for number, (name, text) in enumerate(_BSDFS.items()):
        content.materials.append((name, looks.look(ElementTree.fromstring(text)), None))
        content.pieces[name] = Piece(name, mesh, number)
    return content


def _read(reader: Any, path: Path) -> dict[str, ElementTree.Element]:
    """The BSDFs of a file by the name of their material."""
    changes = Changes()
    for name in ("textures", "unpacked"):
        (path.parent / name).mkdir()
    store = TextureStore(path.parent / "textures", changes)
    sandbox = Sandbox(OpenedFiles(path.parent))
    model = reader.read_model(path, sandbox, store, path.parent / "unpacked", changes)
    return {shape.surface.name: shape.surface.element for shape in model.shapes}


def _assert_reflect_as_before(found: dict[str, ElementTree.Element]) -> None:
    for name, text in _BSDFS.items():
        before = _albedo(ElementTree.fromstring(text))
        assert np.abs(_albedo(found[name]) - before).max() < 1e-3, name


def test_materials_reflect_as_before_through_glb(tmp_path: Path) -> None:
    path = tmp_path / "materials.glb"
    path.write_bytes(glb_bytes(_content(), None))
    _assert_reflect_as_before(_read(gltf, path))


def test_materials_reflect_as_before_through_usd(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pbrnet.pipeline.scene_export.usd import write_usdz
    from pbrnet.scenes.models.usd import reader

    path = tmp_path / "materials.usdz"
    (tmp_path / "work").mkdir()
    write_usdz((_content(), None), path, tmp_path / "work")
    _assert_reflect_as_before(_read(reader, path))


def test_a_blend_of_plain_materials_becomes_their_mean() -> None:
    text = (
        "<bsdf type='blendbsdf'><float name='weight' value='.25'/>"
        "<bsdf type='diffuse'><rgb name='reflectance' value='.2 .4 .6'/></bsdf>"
        "<bsdf type='diffuse'><rgb name='reflectance' value='1 .8 .2'/></bsdf></bsdf>"
    )
    look = LookReader({}, Changes()).look(ElementTree.fromstring(text))
    assert look.base == pytest.approx((0.4, 0.5, 0.5))
    assert look.stated == Statement("diffuse") and look.roughness == 1


def test_images_of_linear_values_become_srgb(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (55, 128, 255)).save(tmp_path / "a.png")
    for raw, expected in ((False, (55, 128, 255)), (True, (128, 188, 255))):
        picture = Picture("a.png", raw=raw)
        pixels = np.asarray(Image.open(io.BytesIO(color_bytes(tmp_path, picture))))
        assert tuple(pixels[0, 0]) == expected
        stored = np.asarray(Image.open(io.BytesIO(stored_bytes(tmp_path, picture))))
        assert tuple(stored[0, 0]) == (55, 128, 255)
    Image.new("L", (2, 2), 128).save(tmp_path / "b.png")
    assert grey(tmp_path, Picture("b.png", raw=True))[0, 0] == 128
    assert grey(tmp_path, Picture("b.png"))[0, 0] == 55
