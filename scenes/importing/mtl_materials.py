"""MTL material libraries, and which material each face of an OBJ takes.

Keywords after Wavefront's *Object Files* appendix, with the physically based ones (Pr, Pm, Ke)
that exporters write today.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from scenes.color import Color
from scenes.errors import InputError
from scenes.geometry.mesh import Floats, Ints
from scenes.importing.changes import Changes
from scenes.importing.sandbox import Sandbox
from scenes.importing.shape import Surface
from scenes.importing.textures import TextureStore, UnreadableImage
from scenes.importing.xml_elements import plugin

_MAX_MTL = 16 * 2**20
_MAX_MATERIALS = 20_000
_GLASS = 0.6  # opacity up to which a plain material is taken for glass
_GLASS_MODELS = (4, 6, 7, 9)  # `illum` values that refract
_COUNTS = {"Kd": 3, "Ks": 3, "Ke": 3, "d": 1, "Tr": 1, "Ns": 1, "Ni": 1, "Pr": 1, "Pm": 1,
           "illum": 1}  # fmt: skip
_MAPS = ("map_Kd", "map_d", "map_Ke")
_LOST_MAPS = ("map_Bump", "map_bump", "bump", "norm", "disp", "map_Ns", "map_Ks", "map_Pr",
              "map_Pm", "refl", "decal")  # fmt: skip
_OPTION_VALUES = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-bm": 1, "-blendu": 1, "-blendv": 1,
                  "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1}  # fmt: skip


@dataclass(frozen=True)
class MtlMap:
    """An image that a material names; `to_uv` for coordinates whose v points down, or None."""

    name: str
    to_uv: Floats | None = None
    clamp: bool = False


@dataclass(frozen=True)
class Finish:
    """A translated material: its surface and, where it shines, linear RGB and an image of it."""

    surface: Surface
    light: Color | None = None
    light_image: Path | None = None
    light_to_uv: Floats | None = None


@dataclass(frozen=True)
class ObjParts:
    """What an OBJ's lines say beside its numbers."""

    owners: list[tuple[str, str]]  # of each part: object or group, and material
    part_of_face: Ints  # (F,)
    libraries: list[str]
    lost: dict[str, int]  # kinds of lines without faces, and how many


@dataclass
class MtlLibrary:
    """The materials of an OBJ at `path`, translated when asked for."""

    path: Path
    sandbox: Sandbox
    textures: TextureStore
    changes: Changes
    materials: dict[str, Mtl] = field(default_factory=dict)
    _finishes: dict[str, Finish] = field(default_factory=dict)

    def load(self, names: list[str]) -> None:
        """Read the libraries that the OBJ names; missing ones are noted."""
        for name in names:
            found = self.sandbox.find(name, f"{self.path}: mtllib")
            if found is None:
                self.changes.note(
                    "missing material library, its materials became grey: {}", repr(name)
                )
            else:
                self.materials |= read_mtl(found, self.changes)

    def finish(self, name: str) -> Finish:
        """The material called `name`; grey, with a note, where no library holds it."""
        if name not in self._finishes:
            if name and name not in self.materials:
                self.changes.note("a material that no library holds became grey: {}", name)
            self._finishes[name] = self._finish(self.materials.get(name, Mtl(name)))
        return self._finishes[name]

    def _finish(self, mtl: Mtl) -> Finish:
        color: Color | Element = _rgb(mtl.numbers.get("Kd", (0.5, 0.5, 0.5)))
        picture = self._image(mtl, "map_Kd")
        if picture is not None:
            try:
                # Kd beside an image is black or grey in too many files to be meant as a factor.
                color = _bitmap(self.textures.color(picture), mtl.maps["map_Kd"])
            except UnreadableImage as error:
                self.changes.note(
                    "damaged texture, the plain colour stands for it: {}",
                    f"{picture.name} ({error})",
                )
        surface = self._surface(mtl, color)
        surface.name = mtl.name
        light = mtl.numbers.get("Ke", (0.0, 0.0, 0.0))
        if max(light) <= 0:
            return Finish(surface)
        image = self._image(mtl, "map_Ke")
        to_uv = mtl.maps["map_Ke"].to_uv if image is not None else None
        return Finish(surface, (light[0], light[1], light[2]), image, to_uv)

    def _image(self, mtl: Mtl, key: str) -> Path | None:
        written = mtl.maps.get(key)
        if written is None:
            return None
        place = f"{self.path}: material {mtl.name!r}"
        found = self.sandbox.find(written.name, place) if written.name else None
        if found is None:
            self.changes.note(
                "missing texture, the plain colour stands for it: {}", repr(written.name)[:120]
            )
        return found

    def _surface(self, mtl: Mtl, color: Color | Element) -> Surface:
        opacity = _opacity(mtl)
        cutout = self._image(mtl, "map_d")
        refracts = int(mtl.numbers.get("illum", (2,))[0]) in _GLASS_MODELS
        if cutout is None and (opacity <= _GLASS or (refracts and opacity < 0.95)):
            self.changes.note("a transparent material became clear glass: {}", mtl.name)
            made = plugin("bsdf", "thindielectric", int_ior=_ior(mtl))
            return Surface(made, transmissive=True, see_through=True)
        wrapped = plugin("bsdf", "twosided")
        wrapped.append(
            plugin(
                "bsdf",
                "principled",
                base_color=color,
                roughness=_roughness(mtl),
                metallic=float(np.clip(mtl.numbers.get("Pm", (0.0,))[0], 0, 1)),
                specular=0.5,
            )
        )
        alpha: float | Element = opacity
        if cutout is not None:
            try:
                stored = self.textures.alpha(cutout) or self.textures.channel(cutout, 0)
                alpha = _bitmap(stored, mtl.maps["map_d"], raw=True)
            except UnreadableImage as error:
                self.changes.note("damaged texture, left out: {}", f"{cutout.name} ({error})")
        if isinstance(alpha, float) and alpha >= 0.999:
            return Surface(wrapped, double=True)
        masked = plugin("bsdf", "mask", opacity=alpha)
        masked.append(wrapped)
        return Surface(masked, transmissive=True)


@dataclass
class Mtl:
    """One `newmtl`: numbers by keyword, maps by keyword."""

    name: str
    numbers: dict[str, tuple[float, ...]] = field(default_factory=dict)
    maps: dict[str, MtlMap] = field(default_factory=dict)


def read_mtl(path: Path, changes: Changes) -> dict[str, Mtl]:
    """The materials of an MTL file by name."""
    if path.stat().st_size > _MAX_MTL:
        raise InputError(f"{path}: more than {_MAX_MTL >> 20} MiB of materials; refused")
    found: dict[str, Mtl] = {}
    current = Mtl("")
    for number, line in enumerate(path.read_bytes().decode("utf-8", "replace").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        key, rest = words[0], words[1:]
        if key == "newmtl":
            current = Mtl(line.split(None, 1)[1].strip() if rest else "")
            found[current.name] = current
            if len(found) > _MAX_MATERIALS:
                raise InputError(f"{path}: more than {_MAX_MATERIALS:,} materials; refused")
        elif key in _COUNTS:
            current.numbers[key] = _values(rest, _COUNTS[key], f"{path}:{number}: {key}")
        elif key in _MAPS:
            current.maps[key] = map_of(line)
        elif key in _LOST_MAPS:
            changes.note(f"{key} of a material was left out: {{}}", current.name)
    return found


def obj_parts(lines: list[bytes]) -> ObjParts:
    """The parts that `o`, `g` and `usemtl` make of an OBJ's faces."""
    parts: dict[tuple[str, str], int] = {}
    faces: list[int] = []
    libraries: list[str] = []
    lost: dict[str, int] = {}
    owner = group = material = ""
    here = -1
    for line in lines:
        head = line[:2]
        if head in (b"f ", b"f\t"):
            if here < 0:
                here = parts.setdefault((owner or group, material), len(parts))
            faces.append(here)
        elif head in (b"o ", b"g ") or line.startswith((b"usemtl", b"mtllib")):
            key, _, rest = line.decode("utf-8", "replace").partition(" ")
            rest = rest.strip()
            if key == "mtllib":
                libraries += [rest] if rest.lower().endswith(".mtl") else rest.split()
            elif key == "usemtl":
                material = rest
            elif key == "o":
                owner, group = rest, ""
            else:
                group = "" if rest == "default" else rest
            here = -1
        elif line.startswith((b"curv", b"surf", b"l ", b"p ")):
            kind = line.split()[0].decode("ascii", "replace")
            lost[kind] = lost.get(kind, 0) + 1
    numbers = np.array(faces, dtype=np.int64)
    return ObjParts(list(parts), numbers, list(dict.fromkeys(libraries)), lost)


def _bitmap(stored: str, image: MtlMap, raw: bool | None = None) -> Element:
    wrap = "clamp" if image.clamp else None
    return plugin("texture", "bitmap", filename=stored, wrap_mode=wrap, raw=raw, to_uv=image.to_uv)


def _opacity(mtl: Mtl) -> float:
    """`d`, or one minus `Tr`."""
    clear = 1 - mtl.numbers.get("Tr", (0.0,))[0]
    return float(np.clip(mtl.numbers.get("d", (clear,))[0], 0.0, 1.0))


def _roughness(mtl: Mtl) -> float:
    """`Pr`, else from Phong's exponent: alpha = sqrt(2 / (n + 2)), roughness = sqrt(alpha)."""
    if "Pr" in mtl.numbers:
        return float(np.clip(mtl.numbers["Pr"][0], 0.02, 1))
    if max(mtl.numbers.get("Ks", (0.0,))) < 0.01:
        return 1.0
    exponent = max(mtl.numbers.get("Ns", (0.0,))[0], 0.0)
    return float(np.clip(math.sqrt(math.sqrt(2 / (exponent + 2))), 0.1, 1))


def _ior(mtl: Mtl) -> float:
    value = mtl.numbers.get("Ni", (1.5,))[0]
    return float(value) if 1.05 < value < 3 else 1.5


def _values(words: list[str], count: int, place: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in words[:count])
    except ValueError:
        raise InputError(f"{place}: {' '.join(words)[:60]!r} are not numbers") from None
    if len(values) == 1 and count == 3:
        values = values * 3
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(f"{place}: {count} finite numbers are needed")
    return values


def map_of(line: str) -> MtlMap:
    """A map line's file name, which may hold spaces, and those of its options that count.

    `-s` scales and `-o` shifts the coordinates; in an OBJ v points up, here it points down.
    """
    rest = line.split(None, 1)[1].strip() if len(line.split(None, 1)) > 1 else ""
    words = rest.split()
    given: dict[str, list[str]] = {}
    while words and words[0] in _OPTION_VALUES:
        skip = 1
        while skip <= _OPTION_VALUES[words[0]] and skip < len(words) - 1 and (
            skip == 1 or _is_number(words[skip])
        ):  # fmt: skip
            skip += 1
        given[words[0]] = words[1:skip]
        words = words[skip:]
        rest = " ".join(words)
    to_uv = np.eye(4)
    for axis in (0, 1):
        scale, offset = (
            float(given[key][axis])
            if len(given.get(key, [])) > axis and _is_number(given[key][axis])
            else usual
            for key, usual in (("-s", 1.0), ("-o", 0.0))
        )
        to_uv[axis, axis] = scale
        to_uv[axis, 3] = offset if axis == 0 else 1 - scale - offset
    plain = np.array_equal(to_uv, np.eye(4)) or not np.isfinite(to_uv).all()
    return MtlMap(rest, None if plain else to_uv, given.get("-clamp") == ["on"])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _rgb(values: tuple[float, ...]) -> Color:
    clipped = np.clip(values, 0.0, 1.0)
    return (float(clipped[0]), float(clipped[1]), float(clipped[2]))
