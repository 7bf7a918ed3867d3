"""Models of parts (`pbrnet.scenes.formats.model_parts`) as a `Model`: shared by COLLADA and 3DS.

Colours are sRGB. The image of a colour replaces it, and the image's alpha cuts the surface out, as
Sweet Home 3D shows such models.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color, decode_srgb_value
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats import model_parts
from pbrnet.scenes.formats.model_parts import ModelMaterial
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.image_files import open_image
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface, clear_glass, cut_out, invisible
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import MAX_SHAPES, Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.models.model import Emission, Model

MAX_FILE = 512 * 2**20  # bytes of a file that is read as a whole
_MAX_GLASS_OPACITY = 0.6  # up to which a material without an image is read as clear glass


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; raises `InputError` above `MAX_FILE`."""
    size = path.stat().st_size
    if size > MAX_FILE:
        raise InputError(
            f"{path}: {size:,} bytes; at most {MAX_FILE:,} of this format, save it as .glb"
        )
    return path.read_bytes()


@dataclass
class PartImages:
    """Finds the images that the materials of the file at `path` name."""

    path: Path
    sandbox: Sandbox
    changes: Changes

    def find(self, name: str) -> str | None:
        """Return the path of an image; None, with a note, if it is missing."""
        found = self.sandbox.find(name, str(self.path), is_image=True) if name else None
        if found is None:
            self.changes.note("missing texture, replaced by the plain colour: {}", repr(name)[:120])
        return None if found is None else str(found)


def model_of_parts(
    found: model_parts.Model, path: Path, kind: str, textures: TextureStore, changes: Changes
) -> Model:
    """Return a `Model` of the format `kind` in the axes and the unit of `found`."""
    if len(found.parts) > MAX_SHAPES:
        raise InputError(f"{path}: the file has more than the limit of {MAX_SHAPES:,} parts")
    model = Model(kind=kind, up=found.up, unit=found.unit)
    materials, names = _Surfaces(textures, changes), Names()
    for part in found.parts:
        label = part.group or part.material_name or path.stem
        shape = Shape(
            names.unique(label),
            label,
            _with_v_down(part.mesh),
            materials.surface(part.material_name, part.material),
        )
        model.shapes.append(shape)
        model.node_paths[shape.id] = part.path or (f"0:{path.stem}", f"1:{part.group}")
        if max(part.material.emission) > 0:
            model.emissions[shape.id] = Emission(_linear(part.material.emission))
    return model


def _with_v_down(mesh: Mesh) -> Mesh:
    """Return the mesh with v = 0 at the top of images; parts have it at the bottom."""
    if mesh.uvs is None:
        return mesh
    uvs: Float64Array = mesh.uvs * [1.0, -1.0] + [0.0, 1.0]
    return Mesh(mesh.vertices, mesh.faces, mesh.normals, uvs)


@dataclass
class _Surfaces:
    """Translates materials to Mitsuba's, each once."""

    textures: TextureStore
    changes: Changes
    _made: dict[tuple[str, ModelMaterial], Surface] = field(default_factory=dict)

    def surface(self, name: str, material: ModelMaterial) -> Surface:
        key = (name, material)
        if key not in self._made:
            self._made[key] = self._translate(name, material)
            self._made[key].name = name
        return self._made[key]

    def _translate(self, name: str, material: ModelMaterial) -> Surface:
        color: Color | Element = _linear(material.color)
        opacity: float | Element = material.opacity
        if material.image is not None:
            try:
                color, alpha = self._bitmaps(Path(material.image))
                opacity = alpha if alpha is not None else opacity
            except UnreadableImage as error:
                self.changes.note(
                    "damaged texture, replaced by the plain colour: {}",
                    f"{Path(material.image).name} ({error})",
                )
        elif material.opacity <= 0:
            return invisible()
        elif material.opacity <= _MAX_GLASS_OPACITY:
            self.changes.note("a transparent material became clear glass: {}", name)
            return clear_glass()
        rough = _roughness(material)
        made = plugin("bsdf", "principled", base_color=color, roughness=rough, specular=0.5)
        return cut_out(made, opacity)

    def _bitmaps(self, path: Path) -> tuple[Element, Element | None]:
        """The colour of an image, and its alpha unless that is one everywhere."""
        color = plugin("texture", "bitmap", filename=self.textures.color(path))
        image = open_image(path)
        if "A" not in image.getbands() and "transparency" not in image.info:
            return color, None
        if image.convert("RGBA").getchannel(3).getextrema()[0] == 255:
            return color, None
        stored = self.textures.alpha(path)
        return color, plugin("texture", "bitmap", filename=stored, raw=True)


def _roughness(material: ModelMaterial) -> float:
    """Roughness equivalent to a Phong exponent n: (2 / (n + 2))^(1/4); 1 without a highlight."""
    if material.highlight < 0.01:
        return 1.0
    return float(np.clip((2 / (material.exponent + 2)) ** 0.25, 0.1, 1))


def _linear(display: tuple[float, float, float]) -> Color:
    red, green, blue = (decode_srgb_value(min(max(value, 0.0), 1.0)) for value in display)
    return (red, green, blue)
