"""Parquet files from outside, and the images in their cells.

Damage and columns of another kind become `InputError`. The cell of an image is the content of a
`.npy` file (NumPy's own format, version 1.0) of its byte planes: bytes (B, ...) for values of B
bytes, first the lowest bytes of all values, last their highest, in a field with the name of the
values' type. Planes compress as well as Parquet's own byte stream split, which exists for numbers
only, and lists of numbers are slow to read. With NumPy alone:

    planes = np.load(io.BytesIO(cell))
    image = np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]
"""

from __future__ import annotations

import io
import math
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet import reader
from pbrnet.pipeline.dataset.columns import FORMAT, TYPES
from pbrnet.pipeline.lenses.model import COEFFICIENTS, Lens
from pbrnet.pipeline.splits import SPLITS
from pbrnet.pipeline.views import check_intrinsics, check_pose
from pbrnet.scenes.arrays import AnyArray, UInt8Array
from pbrnet.scenes.checked import check_name, shown
from pbrnet.scenes.errors import InputError, in_one_line
from pbrnet.scenes.files import parse_json, regular_file

MAX_BYTES = 2**34  # of a file; row groups are read one at a time
MAX_PIXELS = 2**28  # values of an image
_LONGEST_HEADER = 4096  # bytes
_DTYPES = ("float16", "float32", "float64", "uint8", "int32")
_NAMES = {"scene_id": "a scene's id", "view_id": "a view's id", "trajectory": "a trajectory's name"}
_LENS = ("K", "projection", "distortion")
_EXPOSURES = ("exposure_shading", "white_shading", "exposure_color", "white_color")
_REMEDY = "pack it again with: pbrnet dataset"


def shards_of(folder: Path, split: str = "") -> list[Path]:
    """Return the shards of a split, or of all, in the order of the splits.

    Raises `InputError` if there are none, or if some are missing.
    """
    found = [
        (match, path)
        for path in sorted(folder.glob("*"))
        if (match := reader.SHARD.fullmatch(path.name))
    ]
    if not found:
        raise InputError(f"{folder}: no dataset shards here; make them with: pbrnet dataset")
    shards = []
    for name in (split,) if split else SPLITS:
        own = [(match, path) for match, path in found if match[1] == name]
        if split and not own:
            raise InputError(
                f"{folder}: the {name} split is empty; render more homes, or change dataset.splits"
            )
        count = int(own[0][0][3]) if own else 0
        if [(int(one[2]), int(one[3])) for one, _ in own] != [(i, count) for i in range(count)]:
            raise InputError(f"{folder}: {len(own)} of {count} {name} shards; {_REMEDY}")
        shards += [path for _, path in own]
    return shards


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors of Arrow and of the system while `path` is read to `InputError`."""
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        reason = in_one_line(error, 300)
        raise InputError(
            f"{path}: damaged, truncated or not Parquet ({reason}); {_REMEDY}"
        ) from None


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a file for reading; raises `InputError`, also for a column that is there twice."""
    regular_file(path, MAX_BYTES)
    with reading(path):
        file = pq.ParquetFile(path)
    ((name, count),) = Counter(file.schema_arrow.names).most_common(1) or [("", 0)]
    if count > 1:
        raise InputError(f"{path}: {count} columns are called {shown(name)}; {_REMEDY}")
    return file


def check_rows(path: Path, file: pq.ParquetFile) -> None:
    """Raise `InputError` for a shard without rows, or with a row that no view has; see `check_row`.

    Of the columns that `check_row` looks at, those that are absent are passed over.
    """
    if not file.metadata.num_rows:
        raise InputError(f"{path}: no rows; {_REMEDY}")
    columns = (*_NAMES, *_LENS, "camera_to_world", *_EXPOSURES)
    names = [name for name in columns if name in file.schema_arrow.names]
    check_types(path, file.schema_arrow, names)
    with reading(path):
        table = file.read(columns=names)
    optional = {"trajectory", "K"} if "projection" in names else {"trajectory"}
    check_filled(path, table, {*names} - optional)
    for row in table.to_pylist():
        check_row(path, row)


def check_row(path: Path, row: Mapping[str, Any]) -> None:
    """Raise `InputError` for a row whose scalars no view has.

    Ids that cannot be part of a path, `K` and `camera_to_world` that are no camera, exposures and
    white points that are not above 0. Absent and null cells are passed over.
    """
    for name, what in _NAMES.items():
        if name in row and (row[name] or name != "trajectory"):
            check_name(row[name] or "", what, str(path), InputError)
    try:
        _check_lens(row)
        if row.get("camera_to_world") is not None:
            check_pose(row["camera_to_world"], "camera_to_world")
        for name in _EXPOSURES:
            value = row.get(name)
            # The white point may be infinite: then nothing is clipped.
            if value is not None and not (value > 0 and (value < math.inf or "white" in name)):
                raise ValueError(f"{name}: {value:g} is not above 0 and finite")
    except (TypeError, ValueError) as error:
        name = f"{row.get('scene_id')}/{row.get('view_id')}"
        raise InputError(f"{path}: the row {name}: {error}; {_REMEDY}") from None


def _check_lens(row: Mapping[str, Any]) -> None:
    """Raise ValueError for a projection, `K` or coefficients that no view has."""
    projection = row.get("projection") or "perspective"
    if projection not in COEFFICIENTS:
        raise ValueError(f"projection: {shown(projection)} is not one of {', '.join(COEFFICIENTS)}")
    if row.get("K") is not None:
        check_intrinsics(row["K"], "K")
    elif "K" in row and projection != "equirectangular":
        raise ValueError("K: null, and the view is not equirectangular")
    Lens(projection, 1, 1, (), tuple(row.get("distortion") or ())).verify("distortion")


def check_types(path: Path, schema: pa.Schema, names: Iterable[str]) -> None:
    """Raise `InputError` for shards of another format, or a column of another kind than ours.

    Widths of numbers and of offsets do not matter. Columns that are absent or that no dataset has
    are passed over.
    """
    version = (schema.metadata or {}).get(b"pbrnet", FORMAT.encode()).decode("utf-8", "replace")
    if version != FORMAT:
        raise InputError(
            f"{path}: a shard of format {version[:20]}, this release reads format {FORMAT}; the "
            f"frames are still good, {_REMEDY}"
        )
    for name in names:
        wanted = TYPES.get(name)
        if wanted is None or name not in schema.names:
            continue
        found = schema.field(name).type
        if not _alike(found, wanted):
            raise InputError(
                f"{path}: the column {name!r} holds {str(found)[:80]}, expected {wanted}; {_REMEDY}"
            )


def check_filled(path: Path, table: pa.Table, names: Iterable[str]) -> None:
    """Raise `InputError` for a missing value in one of these columns."""
    for name in names:
        if table.column(name).null_count:
            raise InputError(f"{path}: a row without {name!r}; {_REMEDY}")


def image_cell(image: AnyArray) -> bytes:
    """Return the cell of an image: a `.npy` file of its byte planes."""
    image = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("<"))
    planes = np.moveaxis(image.view(np.uint8).reshape(*image.shape, image.itemsize), -1, 0)
    return _header(image.dtype, planes.shape) + planes.tobytes()


def decode_image(cell: bytes) -> AnyArray:
    """Return the image in a cell, (H, W), (H, W, C) or (n, H, W, C), of its own type.

    Raises `InputError` for bytes that are no such cell.
    """
    try:
        return reader.image(cell)
    except (EOFError, TypeError, ValueError) as error:
        raise InputError(f"a cell without an image: {error}") from None


def image_type(path: Path, field: pa.Field) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Return NumPy type and shape, (H, W), (H, W, C) or (n, H, W, C), that an image column states.

    Raises `InputError` if there is none, or if the column does not hold bytes.
    """
    metadata = field.metadata or {}
    where = f"{path}: the column {field.name!r}"
    text = metadata.get(b"shape")
    stated = [] if text is None else parse_json(text, f"{path}: shape of {field.name!r}")
    whole = isinstance(stated, list) and all(type(one) is int and one > 0 for one in stated)
    if not whole or len(stated) not in (2, 3, 4):
        raise InputError(f"{where} has no readable shape metadata")
    name = metadata.get(b"dtype", b"").decode("utf-8", "replace")
    if name not in _DTYPES:
        raise InputError(f"{where} has no readable type of its images; {_REMEDY}")
    if not (pa.types.is_binary(field.type) or pa.types.is_large_binary(field.type)):
        raise InputError(f"{where} holds {str(field.type)[:80]}, expected images; {_REMEDY}")
    if int(np.prod(stated, dtype=object)) > MAX_PIXELS:
        raise InputError(f"{where} states impossibly large images, {stated}")
    return np.dtype(name), tuple(stated)


def images_of(path: Path, table: pa.Table, name: str) -> AnyArray:
    """Return the images of a column, (N, H, W) and so on, of the type it states.

    Raises `InputError` for a missing or damaged image and for one of another type or shape.
    """
    dtype, shape = image_type(path, table.schema.field(name))
    column = table.column(name)
    # One allocation for all: the system gives large ones in large pages, and the time of small
    # pages would be half of all.
    whole = np.empty((len(column), *shape), dtype)
    for image, cell in zip(whole, column, strict=True):
        fill_image(path, name, cell, image)
    return whole


def fill_image(path: Path, name: str, cell: pa.Scalar, out: AnyArray) -> None:
    """Write the image in a cell of the column `name` to `out`, of its type and shape.

    Raises `InputError` as `images_of` does. Threads may fill several at once.
    """
    if not cell.is_valid:
        raise InputError(f"{path}: a row without {name!r}; {_REMEDY}")
    try:
        planes = _planes(cell.as_buffer(), out.dtype, out.shape)
    except ValueError as error:
        raise InputError(f"{path}: an image of {name!r}: {error}; {_REMEDY}") from None
    reader.join_planes(planes, out)


def _planes(content: pa.Buffer, dtype: np.dtype[Any], shape: tuple[int, ...]) -> UInt8Array:
    """Return the byte planes in a cell; raises ValueError for damage, another type or shape."""
    stored = (dtype.itemsize, *shape)
    header = _header(dtype, stored)
    start = len(header)
    if content[:start].to_pybytes() != header:  # written by another program, or another image
        start = _other_header(content, header)
    size = int(np.prod(stored))
    if len(content) != start + size:
        raise ValueError(f"{len(content) - start} bytes of pixels, expected {size}")
    return np.frombuffer(content, np.uint8, offset=start).reshape(stored)


def _other_header(content: pa.Buffer, header: bytes) -> int:
    """Return the length of a header that says the same as ours with other blanks.

    NumPy's own reader evaluates the text as Python, and its errors are of many kinds.
    """
    first = content[:_LONGEST_HEADER].to_pybytes()
    fields = {1: "<H", 2: "<I"}  # the length of the text, by version
    if first[:6] != b"\x93NUMPY" or len(first) < 12 or first[6] not in fields:
        raise ValueError("not a .npy file of version 1 or 2")
    field = fields[first[6]]
    start = 8 + struct.calcsize(field)
    end = start + struct.unpack_from(field, first, 8)[0]
    text = b"".join(first[start:end].split())
    if text != b"".join(header[10:].split()):
        raise ValueError(f"a header {shown(text[:80])}, expected {shown(header[10:].strip())}")
    return int(end)


@lru_cache(maxsize=256)
def _header(dtype: np.dtype[Any], stored: tuple[int, ...]) -> bytes:
    """Return the header of a `.npy` file of byte planes, a multiple of 64 bytes."""
    about = {"descr": [(dtype.name, "|u1")], "fortran_order": False, "shape": stored}
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, about)
    return stream.getvalue()


def _alike(found: pa.DataType, wanted: pa.DataType) -> bool:
    if pa.types.is_fixed_size_list(wanted):
        fixed = pa.types.is_fixed_size_list(found) and found.list_size == wanted.list_size
        return fixed and _alike(found.value_type, wanted.value_type)
    if pa.types.is_list(wanted):
        lists = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
        return any(test(found) for test in lists) and _alike(found.value_type, wanted.value_type)
    if pa.types.is_struct(wanted):
        names = [found.field(n).name for n in range(found.num_fields)]
        return (
            pa.types.is_struct(found)
            and "bytes" in names
            and pa.types.is_binary(found.field("bytes").type)
        )
    same = (
        (pa.types.is_string, pa.types.is_large_string),
        (pa.types.is_floating,),
        (pa.types.is_integer,),
    )
    return any(
        any(test(found) for test in tests) and any(test(wanted) for test in tests) for tests in same
    )
