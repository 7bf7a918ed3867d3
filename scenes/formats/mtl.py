"""Parser of MTL material libraries of OBJ files: numbers and images by keyword.

Keywords of Wavefront's *Object Files* appendix and the later physically based ones (Pr, Pm, Ke);
case is ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.obj import decode_text, is_number

MAX_MTL = 16 * 2**20  # bytes
_MAX_MATERIALS = 20_000
_COUNTS = {"Kd": 3, "Ks": 3, "Ke": 3, "d": 1, "Tr": 1, "Ns": 1, "Ni": 1, "Pr": 1, "Pm": 1,
           "illum": 1}  # fmt: skip
_MAPS = ("map_Kd", "map_d", "map_Ke")
_UNUSED_MAPS = ("map_Bump", "bump", "norm", "disp", "map_Ns", "map_Ks", "map_Pr", "map_Pm", "refl",
                "decal")  # fmt: skip
_KEYWORDS = {key.lower(): key for key in (*_COUNTS, *_MAPS, *_UNUSED_MAPS, "newmtl")}
_OPTION_VALUES = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-bm": 1, "-blendu": 1, "-blendv": 1,
                  "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1,
                  "-type": 1}  # fmt: skip


@dataclass(frozen=True)
class MtlMap:
    """An image of a material; `to_uv` (4, 4) for coordinates with v down, None if identity."""

    name: str
    to_uv: Float64Array | None = None
    clamp: bool = False


@dataclass
class Mtl:
    """One material: numbers and images by keyword, and the keywords of unused images."""

    name: str
    numbers: dict[str, tuple[float, ...]] = field(default_factory=dict)
    maps: dict[str, MtlMap] = field(default_factory=dict)
    unused: list[str] = field(default_factory=list)

    @property
    def opacity(self) -> float:
        """Opacity in [0, 1]: `d`, else 1 - `Tr`, else 1."""
        clear = 1 - self.numbers.get("Tr", (0.0,))[0]
        return float(np.clip(self.numbers.get("d", (clear,))[0], 0.0, 1.0))


def read_mtl(
    data: bytes, place: str, on_damage: Callable[[InputError], None] | None = None
) -> dict[str, Mtl]:
    """Parse an MTL file; returns materials by name.

    A damaged line raises `InputError` with its number. If `on_damage` is given, it is called with
    the error instead, and the line is skipped.
    """
    if len(data) > MAX_MTL:
        raise InputError(f"{place}: more than {MAX_MTL >> 20} MiB of materials; refused")
    found: dict[str, Mtl] = {}
    current = Mtl("")
    for number, line in enumerate(decode_text(data).replace("\\\n", " ").splitlines(), 1):
        words = line.split()
        key = _KEYWORDS.get(words[0].lower(), "") if words else ""
        rest = words[1:]
        if key == "newmtl":
            current = Mtl(line.split(None, 1)[1].strip() if rest else "")
            found[current.name] = current
            if len(found) > _MAX_MATERIALS:
                raise InputError(f"{place}: more than {_MAX_MATERIALS:,} materials; refused")
        elif key in _COUNTS:
            try:
                current.numbers[key] = _values(rest, _COUNTS[key], f"{place}:{number}: {key}")
            except InputError as error:
                if on_damage is None:
                    raise
                on_damage(error)
        elif key in _MAPS:
            current.maps[key] = _map(line)
        elif key:
            current.unused.append(key)
    return found


def _values(words: list[str], count: int, place: str) -> tuple[float, ...]:
    if count == 1 and words[:1] == ["-halo"]:  # of `d`
        words = words[1:]
    try:
        values = tuple(float(word) for word in words[:count])
    except ValueError:
        raise InputError(f"{place}: {' '.join(words)[:60]!r} are not numbers") from None
    if len(values) == 1 and count == 3:
        values = values * 3
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(f"{place}: {count} finite numbers are needed")
    return values


def _map(line: str) -> MtlMap:
    """Parse a map line: the file name, which may hold blanks, and the options -s, -o and -clamp.

    `-s` scales and `-o` shifts the coordinates. OBJ files have v up, the result has v down.
    """
    rest = line.split(None, 1)[1].strip() if len(line.split(None, 1)) > 1 else ""
    words = rest.split()
    given: dict[str, list[str]] = {}
    while words and words[0] in _OPTION_VALUES:
        skip = 1
        while skip <= _OPTION_VALUES[words[0]] and skip < len(words) - 1 and (
            skip == 1 or is_number(words[skip])
        ):  # fmt: skip
            skip += 1
        given[words[0]] = words[1:skip]
        for _ in range(skip):  # word by word, to keep blanks inside the name
            rest = rest.split(None, 1)[1] if len(rest.split(None, 1)) > 1 else ""
        words = words[skip:]
    to_uv = np.eye(4)
    for axis in (0, 1):
        scale, offset = (
            float(given[key][axis])
            if len(given.get(key, [])) > axis and is_number(given[key][axis])
            else usual
            for key, usual in (("-s", 1.0), ("-o", 0.0))
        )
        to_uv[axis, axis] = scale
        to_uv[axis, 3] = offset if axis == 0 else 1 - scale - offset
    plain = np.array_equal(to_uv, np.eye(4)) or not np.isfinite(to_uv).all()
    return MtlMap(rest, None if plain else to_uv, given.get("-clamp") == ["on"])
