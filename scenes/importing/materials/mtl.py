"""Materials of MTL libraries as Mitsuba 3 BSDFs: `principled`, clear glass, and masks.

Input: the MTL files that an OBJ names. Output: for each material a `Surface` and its emission.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.mtl import MAX_MTL, Mtl, MtlMap, read_mtl
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface, clear_glass, clipped, cut_out
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.xml_elements import plugin

_MAX_GLASS_OPACITY = 0.6  # up to which a material without opacity map is read as glass
_REFRACTIVE_MODELS = (4, 6, 7, 9)  # `illum` values that refract


@dataclass(frozen=True)
class MtlMaterial:
    """A translated material."""

    surface: Surface
    emission: Color | None = None  # `Ke`, linear RGB; None without emission
    emission_image: Path | None = None  # `map_Ke`
    emission_to_uv: Float64Array | None = None  # (4, 4) transform of its texture coordinates


@dataclass
class MtlLibrary:
    """The materials of the OBJ file at `path`, each translated on first use."""

    path: Path
    sandbox: Sandbox
    textures: TextureStore
    changes: Changes
    materials: dict[str, Mtl] = field(default_factory=dict)
    _translated: dict[str, MtlMaterial] = field(default_factory=dict)

    def load(self, names: list[str]) -> None:
        """Read the MTL files with these names; missing ones are noted."""
        for name in names:
            found = self.sandbox.find(name, f"{self.path}: mtllib")
            if found is None:
                self.changes.note(
                    "missing material library, grey replaces its materials: {}", repr(name)
                )
            else:
                self._read(found)

    def _read(self, path: Path) -> None:
        if path.stat().st_size > MAX_MTL:
            raise InputError(f"{path}: the file is larger than the limit of {MAX_MTL >> 20} MiB")
        read = read_mtl(path.read_bytes(), str(path))
        for mtl in read.values():
            for key in mtl.unused:
                self.changes.note(f"{key} of a material was left out: {{}}", mtl.name)
        self.materials |= read

    def material(self, name: str) -> MtlMaterial:
        """Return the material called `name`; grey, with a note, if no library defines it."""
        if name not in self._translated:
            if name and name not in self.materials:
                self.changes.note("a material that no library defines became grey: {}", name)
            made = self._translate(self.materials.get(name, Mtl(name)))
            made.surface.unstated = name not in self.materials
            self._translated[name] = made
        return self._translated[name]

    def _translate(self, mtl: Mtl) -> MtlMaterial:
        color: Color | Element = clipped(mtl.numbers.get("Kd", (0.5, 0.5, 0.5)))
        image_path = self._image(mtl, "map_Kd")
        if image_path is not None:
            try:
                # Too many files have a black or grey Kd beside an image to multiply by it.
                color = _bitmap(self.textures.color(image_path), mtl.maps["map_Kd"])
            except UnreadableImage as error:
                self.changes.note(
                    "damaged texture, replaced by the plain colour: {}",
                    f"{image_path.name} ({error})",
                )
        surface = self._surface(mtl, color)
        surface.name = mtl.name
        emission = mtl.numbers.get("Ke", (0.0, 0.0, 0.0))
        if max(emission) <= 0:
            return MtlMaterial(surface)
        image = self._image(mtl, "map_Ke")
        to_uv = mtl.maps["map_Ke"].to_uv if image is not None else None
        return MtlMaterial(surface, (emission[0], emission[1], emission[2]), image, to_uv)

    def _image(self, mtl: Mtl, key: str) -> Path | None:
        written = mtl.maps.get(key)
        if written is None:
            return None
        place = f"{self.path}: material {mtl.name!r}"
        found = self.sandbox.find(written.name, place, True) if written.name else None
        if found is None:
            self.changes.note(
                "missing texture, replaced by the plain colour: {}", repr(written.name)[:120]
            )
        return found

    def _surface(self, mtl: Mtl, color: Color | Element) -> Surface:
        opacity = mtl.opacity
        cutout = self._image(mtl, "map_d")
        refracts = int(mtl.numbers.get("illum", (2,))[0]) in _REFRACTIVE_MODELS
        if cutout is None and (opacity <= _MAX_GLASS_OPACITY or (refracts and opacity < 0.95)):
            self.changes.note("a transparent material became clear glass: {}", mtl.name)
            return clear_glass(_ior(mtl))
        made = plugin(
            "bsdf",
            "principled",
            base_color=color,
            roughness=_roughness(mtl),
            metallic=float(np.clip(mtl.numbers.get("Pm", (0.0,))[0], 0, 1)),
            specular=0.5,
        )
        alpha: float | Element = opacity
        if cutout is not None:
            try:
                stored = self.textures.alpha(cutout) or self.textures.channel(cutout, 0)
                alpha = _bitmap(stored, mtl.maps["map_d"], raw=True)
            except UnreadableImage as error:
                self.changes.note(
                    "damaged opacity texture was left out: {}", f"{cutout.name} ({error})"
                )
        return cut_out(made, alpha)


def _bitmap(stored: str, image: MtlMap, raw: bool | None = None) -> Element:
    wrap = "clamp" if image.clamp else None
    return plugin("texture", "bitmap", filename=stored, wrap_mode=wrap, raw=raw, to_uv=image.to_uv)


def _roughness(mtl: Mtl) -> float:
    """`Pr`, or from Phong's exponent: alpha = sqrt(2 / (n + 2)), roughness = sqrt(alpha)."""
    if "Pr" in mtl.numbers:
        return float(np.clip(mtl.numbers["Pr"][0], 0.02, 1))
    if max(mtl.numbers.get("Ks", (0.0,))) < 0.01:
        return 1.0
    exponent = max(mtl.numbers.get("Ns", (0.0,))[0], 0.0)
    return float(np.clip(math.sqrt(math.sqrt(2 / (exponent + 2))), 0.1, 1))


def _ior(mtl: Mtl) -> float:
    value = mtl.numbers.get("Ni", (1.5,))[0]
    return float(value) if 1.05 < value < 3 else 1.5
