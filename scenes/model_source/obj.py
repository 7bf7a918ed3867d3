"""Wavefront OBJ files with their MTL materials: one shape for every object and material.

Lengths have no unit in an OBJ and +Y is up by custom. MTL keywords after Wavefront's *Object
Files* appendix, with the physically based ones (Pr, Pm, Ke) that exporters write today.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.mitsuba_source.changes import Changes
from scenes.mitsuba_source.elements import plugin
from scenes.mitsuba_source.materials import Surface
from scenes.mitsuba_source.meshes import cleaned, creased, obj_lines, read_obj_parts
from scenes.mitsuba_source.names import Names
from scenes.mitsuba_source.sandbox import Sandbox
from scenes.mitsuba_source.shapes import MAX_SHAPES, Shape
from scenes.mitsuba_source.textures import TextureStore, UnreadableImage
from scenes.mitsuba_source.values import Color
from scenes.model_source.model import Glow, Model

_MAX_MTL = 16 * 2**20
_MAX_MATERIALS = 20_000
_CREASE = 44.0  # degrees: smooth up to this where a file brings no normals
_GLASS = 0.6  # opacity up to which a plain material is taken for glass
_GLASS_MODELS = (4, 6, 7, 9)  # `illum` values that refract
_COUNTS = {"Kd": 3, "Ks": 3, "Ke": 3, "d": 1, "Tr": 1, "Ns": 1, "Ni": 1, "Pr": 1, "Pm": 1,
           "illum": 1}  # fmt: skip
_MAPS = ("map_Kd", "map_d", "map_Ke")
_LOST_MAPS = ("map_Bump", "map_bump", "bump", "norm", "disp", "map_Ns", "map_Ks", "map_Pr",
              "map_Pm", "refl", "decal")  # fmt: skip
_OPTION_VALUES = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-bm": 1, "-blendu": 1, "-blendv": 1,
                  "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1}  # fmt: skip


@dataclass
class Mtl:
    """One `newmtl`: numbers by keyword, maps by keyword."""

    name: str
    numbers: dict[str, tuple[float, ...]] = field(default_factory=dict)
    maps: dict[str, str] = field(default_factory=dict)


def read_model(path: Path, sandbox: Sandbox, textures: TextureStore, changes: Changes) -> Model:
    """All shapes of an OBJ file; `InputError` names what is damaged."""
    lines = obj_lines(path)
    owners, part_of_face, libraries, lost = _scan(lines)
    for kind, count in lost.items():
        changes.note(f"{count} lines of kind {kind!r} (curves, points) were left out")
    if not len(part_of_face):
        raise InputError(f"{path}: an OBJ without faces")
    if len(owners) > MAX_SHAPES:
        raise InputError(f"{path}: more than {MAX_SHAPES:,} parts; refused")
    materials: dict[str, Mtl] = {}
    for name in libraries:
        found = sandbox.find(name, f"{path}: mtllib")
        if found is None:
            changes.note("missing material library, its materials became grey: {}", repr(name))
        else:
            materials |= read_mtl(found, changes)
    finishes: dict[str, tuple[Surface, Glow | None]] = {}
    model, names = Model(kind="obj"), Names()
    for part, mesh in read_obj_parts(path, lines, part_of_face).items():
        owner, material = owners[part]
        if material not in finishes:
            if material and material not in materials:
                changes.note("a material that no library holds became grey: {}", material)
            mtl = materials.get(material, Mtl(material))
            finishes[material] = _finish(mtl, path, sandbox, textures, changes)
        surface, glow = finishes[material]
        mesh, dropped = cleaned(mesh, f"{path}: {owner or material}")
        if dropped:
            changes.note(
                "triangles without area were dropped from {}", owner or material or path.stem
            )
        if not len(mesh.faces):
            changes.note("a part without area was left out: {}", owner or material)
            continue
        if mesh.normals is None:
            mesh = creased(mesh, _CREASE)
        shape = Shape(
            names.unique(owner or material or path.stem), owner or path.stem, mesh, surface
        )
        model.shapes.append(shape)
        model.owners[shape.id] = (f"0:{path.stem}", f"1:{owner}") if owner else (f"0:{path.stem}",)
        if glow is not None:
            model.glows[shape.id] = glow
    return model


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
            current.maps[key] = _map_name(line)
        elif key in _LOST_MAPS:
            changes.note(f"{key} of a material was left out: {{}}", current.name)
    return found


def _scan(
    lines: list[bytes],
) -> tuple[list[tuple[str, str]], np.ndarray, list[str], dict[str, int]]:
    """The parts (object or group, material), each face's part, libraries, and what is lost."""
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
    return list(parts), np.array(faces, dtype=np.int64), list(dict.fromkeys(libraries)), lost


def _finish(
    mtl: Mtl, path: Path, sandbox: Sandbox, textures: TextureStore, changes: Changes
) -> tuple[Surface, Glow | None]:
    def image(key: str) -> Path | None:
        name = mtl.maps.get(key)
        if name is None:
            return None
        found = sandbox.find(name, f"{path}: material {mtl.name!r}") if name else None
        if found is None:
            changes.note("missing texture, the plain colour stands for it: {}", repr(name)[:120])
        return found

    color: Color | Any = _rgb(mtl.numbers.get("Kd", (0.5, 0.5, 0.5)))
    picture = image("map_Kd")
    if picture is not None:
        try:
            color = plugin("texture", "bitmap", filename=textures.color(picture))
        except UnreadableImage as error:
            changes.note(
                "damaged texture, the plain colour stands for it: {}", f"{picture.name} ({error})"
            )
    glow = None
    light = mtl.numbers.get("Ke", (0.0, 0.0, 0.0))
    if max(light) > 0:
        glow = Glow((light[0], light[1], light[2]), image("map_Ke"))
    surface = _surface(mtl, color, image("map_d"), textures, changes)
    surface.name = mtl.name
    return surface, glow


def _surface(
    mtl: Mtl, color: Any, cutout: Path | None, textures: TextureStore, changes: Changes
) -> Surface:
    opacity = _opacity(mtl)
    refracts = int(mtl.numbers.get("illum", (2,))[0]) in _GLASS_MODELS
    if cutout is None and (opacity <= _GLASS or (refracts and opacity < 0.95)):
        changes.note("a transparent material became clear glass: {}", mtl.name)
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
    alpha: Any = opacity
    if cutout is not None:
        try:
            stored = textures.alpha(cutout) or textures.channel(cutout, 0)
            alpha = plugin("texture", "bitmap", filename=stored, raw=True)
        except UnreadableImage as error:
            changes.note("damaged texture, left out: {}", f"{cutout.name} ({error})")
    if isinstance(alpha, float) and alpha >= 0.999:
        return Surface(wrapped, double=True)
    masked = plugin("bsdf", "mask", opacity=alpha)
    masked.append(wrapped)
    return Surface(masked, transmissive=True)


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


def _map_name(line: str) -> str:
    """The file name at the end of a map line, behind its options; it may hold spaces."""
    rest = line.split(None, 1)[1].strip() if len(line.split(None, 1)) > 1 else ""
    words = rest.split()
    while words and words[0] in _OPTION_VALUES:
        skip = 1
        while skip <= _OPTION_VALUES[words[0]] and skip < len(words) - 1 and (
            skip == 1 or _is_number(words[skip])
        ):  # fmt: skip
            skip += 1
        words = words[skip:]
        rest = " ".join(words)
    return rest


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _rgb(values: tuple[float, ...]) -> Color:
    clipped = np.clip(values, 0.0, 1.0)
    return (float(clipped[0]), float(clipped[1]), float(clipped[2]))
