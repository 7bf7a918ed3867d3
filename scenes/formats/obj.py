"""Parser of Wavefront OBJ files: positions, faces, and object, group and material of each face.

Format: Wavefront's *Object Files* appendix, polygonal geometry. Keywords and values are separated
by blanks or tabs, lines may be continued, faces may precede their vertices, and negative indices
count back from the last element read.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import MAX_TRIANGLES, Mesh

MAX_BYTES = 512 * 2**20
_COLUMNS = {b"v": 3, b"vt": 1, b"vn": 3}  # fewest values of a line
_TABLES = {b"v": 0, b"vt": 1, b"vn": 2}
_CONTINUED = b"\v"  # a blank to `bytes.split`, so that lines can still be counted
_WITHOUT_FACES = (b"curv", b"curv2", b"surf", b"l", b"p")


@dataclass(frozen=True)
class ObjRun:
    """Attributes of consecutive faces; empty if the file gives none."""

    object: str = ""
    group: str = ""
    material: str = ""
    smooth: bool = False

    @property
    def owner(self) -> str:
        """Name of the object, else of the group."""
        return self.object or self.group


@dataclass(frozen=True)
class Obj:
    """An OBJ file as arrays.

    `corners` (C, 3) are one-based indices of position, texture coordinate and normal, 0 for none;
    `sizes` (F,) is the number of corners of each face; `run_of_face` (F,) indexes `runs`.
    """

    place: str  # for messages
    positions: Float64Array
    uvs: Float64Array
    normals: Float64Array
    corners: Int64Array
    sizes: Int64Array
    runs: list[ObjRun]
    run_of_face: Int64Array
    libraries: list[str]  # names in `mtllib` lines, without repetition
    without_faces: dict[str, int]  # keyword of curves and points -> number of lines
    header: str  # comments at the start of the file, which may name the licence
    line_of_face: Int64Array  # (F,), counted from 1

    def mesh(self, faces: Int64Array | None = None, flip_v: bool = True) -> Mesh:
        """Return the mesh of some faces (indices), of all by default; polygons become fans.

        It has normals if all corners have one, and likewise texture coordinates. `flip_v` maps v
        to 1 - v, like Mitsuba by default. Raises `InputError`.
        """
        sizes, corners, lines = self.sizes, self.corners, self.line_of_face
        if faces is not None:
            lines = lines[faces]
            ends = np.cumsum(self.sizes)
            sizes = self.sizes[faces]
            starts = ends[faces] - sizes
            rows = np.repeat(starts - np.cumsum(sizes) + sizes, sizes)
            corners = corners[rows + np.arange(len(rows))]
        if not len(sizes):
            raise InputError(f"{self.place}: an OBJ without faces")
        self._check(corners, np.repeat(lines, sizes))
        return self._mesh(corners.copy(), sizes, flip_v)

    def _check(self, corners: Int64Array, lines: Int64Array) -> None:
        """Raise `InputError` with the line if one of `corners` (C, 3) refers to nothing."""
        tables = ((self.positions, "vertex"), (self.uvs, "vt"), (self.normals, "vn"))
        for column, (table, kind) in enumerate(tables):
            values = corners[:, column]
            wrong = (values > len(table)) | (values < (column == 0))
            if wrong.any():
                first = int(np.argmax(wrong))
                raise InputError(
                    f"{self.place}:{lines[first]}: a face refers to a {kind} that does not exist: "
                    f"number {values[first]} of {len(table):,}"
                )

    def _mesh(self, corners: Int64Array, sizes: Int64Array, flip_v: bool) -> Mesh:
        has_uv, has_normals = bool((corners[:, 1] > 0).all()), bool((corners[:, 2] > 0).all())
        corners[:, 1] *= has_uv
        corners[:, 2] *= has_normals
        # One 64-bit key per corner sorts far faster than rows.
        key = (corners[:, 0] * (len(self.uvs) + 1) + corners[:, 1]) * (len(self.normals) + 1)
        _, first, inverse = np.unique(key + corners[:, 2], return_index=True, return_inverse=True)
        used = corners[first] - 1
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        fans = sizes - 2
        if (fans < 1).any():
            raise InputError(f"{self.place}: a face with fewer than three corners")
        base = np.repeat(starts, fans)
        step = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
        faces = inverse.reshape(-1)[np.stack([base, base + step + 1, base + step + 2], axis=1)]
        uvs = None
        if has_uv:
            uvs = self.uvs[used[:, 1]].copy()
            if flip_v:
                uvs[:, 1] = 1 - uvs[:, 1]
        normals = self.normals[used[:, 2]] if has_normals else None
        return Mesh(self.positions[used[:, 0]], faces, normals, uvs)


def read_obj(path: Path) -> Obj:
    """Read an OBJ file; `InputError` names the damage."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES >> 20} MiB")
    return parse_obj(path.read_bytes(), str(path))


@dataclass
class _Lines:
    """Lines of an OBJ file by keyword."""

    tables: tuple[list[bytes], list[bytes], list[bytes]] = ((), (), ())  # type: ignore[assignment]
    faces: list[bytes] = field(default_factory=list)
    counts: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    runs: dict[ObjRun, int] = field(default_factory=dict)
    run_of_face: list[int] = field(default_factory=list)
    line_of_face: list[int] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    without_faces: dict[str, int] = field(default_factory=dict)


def parse_obj(data: bytes, place: str) -> Obj:
    """Parse the bytes of an OBJ file; messages of `InputError` begin with `place`."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = text.replace(b"\\\n", _CONTINUED).split(b"\n")
    found = _sorted_lines(lines)
    positions, uvs, normals = (
        _table(rows, columns, least, f"{place}: {word.decode()}")
        for rows, columns, (word, least) in zip(
            found.tables, (3, 2, 3), _COLUMNS.items(), strict=True
        )
    )
    corners, sizes = _corners(found, place)
    comments = [line.lstrip(b"# ") for line in lines[:40] if line.startswith(b"#")]
    return Obj(
        place,
        positions,
        uvs,
        normals,
        corners,
        sizes,
        list(found.runs),
        np.array(found.run_of_face, dtype=np.int64),
        list(dict.fromkeys(found.libraries)),
        found.without_faces,
        decode_text(b"\n".join(comments))[:4000],
        np.array(found.line_of_face, dtype=np.int64),
    )


def decode_text(data: bytes) -> str:
    """Decode text of an OBJ or MTL file: as UTF-8 if that is valid, else as Latin-1."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _sorted_lines(lines: list[bytes]) -> _Lines:
    found = _Lines(tables=([], [], []))
    run, number, continued = ObjRun(), -1, 0
    for place, line in enumerate(lines, start=1):
        words = line.split(None, 1)
        if not words:
            continue
        word = words[0]
        rest = words[1] if len(words) > 1 else b""
        if word in _TABLES:
            found.tables[_TABLES[word]].append(rest)
        elif word == b"f":
            if number < 0:
                number = found.runs.setdefault(run, len(found.runs))
            if b"-" in rest:
                found.counts[len(found.faces)] = tuple(map(len, found.tables))  # type: ignore[assignment]
            found.faces.append(rest)
            found.run_of_face.append(number)
            found.line_of_face.append(place + continued)
        elif word == b"mtllib":
            name = decode_text(rest.strip())
            # A line may hold one name with blanks, or several names.
            found.libraries += [name] if name.lower().count(".mtl") < 2 else name.split()
        elif word in (b"o", b"g", b"usemtl", b"s"):
            run, number = _changed(run, word, decode_text(rest.strip())), -1
        elif word in _WITHOUT_FACES:
            kind = word.decode()
            found.without_faces[kind] = found.without_faces.get(kind, 0) + 1
        continued += line.count(_CONTINUED)
    return found


def _changed(run: ObjRun, word: bytes, name: str) -> ObjRun:
    if word == b"o":
        return ObjRun(name, "", run.material, run.smooth)
    if word == b"g":
        group = "" if name == "default" else name
        return ObjRun(run.object, group, run.material, run.smooth)
    if word == b"usemtl":
        return ObjRun(run.object, run.group, name, run.smooth)
    return ObjRun(run.object, run.group, run.material, name not in ("off", "0", ""))


def _table(rows: list[bytes], columns: int, least: int, place: str) -> Float64Array:
    """Parse lines of numbers to (N, columns); values after the first `least` default to 0."""
    if not rows:
        return np.zeros((0, columns))
    widths = np.array([len(row.split()) for row in rows])
    if widths.min() < least:
        raise InputError(f"{place}: a damaged line of numbers: {_shown(rows[widths.argmin()])}")
    if widths.min() == widths.max() >= columns:
        with suppress(ValueError):  # then one by one: what follows the numbers does not matter
            flat = np.array(b" ".join(rows).split(), dtype=np.float64)
            return flat.reshape(len(rows), -1)[:, :columns].copy()
    try:
        table = np.zeros((len(rows), columns))
        for number, row in enumerate(rows):
            values = [float(word) for word in row.split()[:columns]]
            table[number, : len(values)] = values
        return table
    except ValueError:
        word = next(word for row in rows for word in row.split()[:columns] if not is_number(word))
        raise InputError(
            f"{place}: a damaged line of numbers: {_shown(word)} is not a number"
        ) from None


def _corners(found: _Lines, place: str) -> tuple[Int64Array, Int64Array]:
    """Return all corners (C, 3) as one-based (v, vt, vn), 0 for none, and the sizes (F,)."""
    words = [face.split() for face in found.faces]
    sizes = np.array([len(word) for word in words], dtype=np.int64)
    if sizes.sum() > 4 * MAX_TRIANGLES:
        raise InputError(f"{place}: too many faces")
    flat = [token for word in words for token in word]
    try:
        corners = None if found.counts else _like_corners(b" ".join(flat), len(flat))
        if corners is None:
            total = tuple(map(len, found.tables))
            rows: list[list[int]] = []
            for number, tokens in enumerate(words):
                counts = found.counts.get(number, total)
                rows += [_corner(token, counts) for token in tokens]
            corners = np.array(rows, dtype=np.int64).reshape(-1, 3)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{place}: a damaged corner of a face ({error})") from None
    return corners, sizes


def _like_corners(text: bytes, count: int) -> Int64Array | None:
    """Parse `count` corners without negative indices if all have the same form, else None."""
    if not count:
        return None
    slash, space = b"/ "
    letters = np.frombuffer(text + b" ", np.uint8)
    marks = letters[(letters == slash) | (letters == space)]
    slashes = np.diff(np.cumsum(marks == slash)[marks == space], prepend=0)
    form = (int(slashes.min()), int(slashes.max()), text.count(b"//"))
    present = {(0, 0, 0): [0], (1, 1, 0): [0, 1], (2, 2, 0): [0, 1, 2], (2, 2, count): [0, 2]}
    if form not in present:
        return None
    columns = present[form]
    values = np.array(text.replace(b"/", b" ").split(), dtype=np.int64)
    if values.size != count * len(columns):
        return None
    corners = np.zeros((count, 3), dtype=np.int64)
    corners[:, columns] = values.reshape(count, -1)
    return corners


def _corner(token: bytes, counts: tuple[int, ...]) -> list[int]:
    """Parse one corner; negative indices count back from the `counts` read so far."""
    parts = [int(part) if part else 0 for part in token.split(b"/")[:3]]
    parts += [0] * (3 - len(parts))
    for column, count in enumerate(counts):
        if parts[column] < 0:
            parts[column] += 1 + count
            if parts[column] < 1:
                raise ValueError(f"{_shown(token)} counts back too far")
    return parts


def is_number(word: str | bytes) -> bool:
    """Test whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _shown(data: bytes) -> str:
    return repr(data[:60].decode("ascii", "replace"))


def distinct_rows(values: Int64Array) -> list[tuple[int, Int64Array]]:
    """Return each distinct value, ascending, with the indices at which it occurs."""
    order = np.argsort(values, kind="stable")
    numbers, first = np.unique(values[order], return_index=True)
    groups = np.split(order, first[1:]) if len(order) else []
    return list(zip(numbers.tolist(), groups, strict=True))
