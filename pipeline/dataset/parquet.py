"""Reading of Parquet files from outside: damage and columns of another kind become `InputError`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.dataset.columns import dataset_columns
from scenes.errors import InputError
from scenes.files import parse_json, regular_file

MAX_BYTES = 2**34  # of a file; row groups are read one at a time
MAX_PIXELS = 2**28  # values of an image
_COLUMNS = dataset_columns((8, 8), (16, 8), channels=("all",), links=True)
_TYPES = {one.name: one.type for one in _COLUMNS if not one.is_image}
_REMEDY = "pack it again with: pbrnet dataset"


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors of Arrow and of the system while `path` is read to `InputError`."""
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        raise InputError(
            f"{path}: damaged, truncated or not Parquet ({reason}); {_REMEDY}"
        ) from None


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a file for reading; raises `InputError`."""
    regular_file(path, MAX_BYTES)
    with reading(path):
        return pq.ParquetFile(path)


def check_types(path: Path, schema: pa.Schema, names: Iterable[str]) -> None:
    """Raise `InputError` for a column of a dataset whose values are of another kind than ours.

    Widths of numbers and of offsets do not matter. Columns that are absent or that no dataset has
    are passed over.
    """
    for name in names:
        wanted = _TYPES.get(name)
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


def image_shape(path: Path, field: pa.Field) -> tuple[int, ...]:
    """Return the shape that an image column states: (H, W) or (H, W, C).

    Raises `InputError` if there is none, or if the column does not hold so many numbers a row.
    """
    text = (field.metadata or {}).get(b"shape")
    stated = [] if text is None else parse_json(text, f"{path}: shape of {field.name!r}")
    whole = isinstance(stated, list) and all(type(one) is int and one > 0 for one in stated)
    if not whole or len(stated) not in (2, 3):
        raise InputError(f"{path}: the column {field.name!r} has no readable shape metadata")
    count = int(np.prod(stated, dtype=object))
    kind = field.type
    if not pa.types.is_fixed_size_list(kind) or kind.list_size != count or count > MAX_PIXELS:
        raise InputError(f"{path}: the column {field.name!r} does not hold {stated} values a row")
    if not _is_number(kind.value_type):
        raise InputError(f"{path}: the column {field.name!r} holds {kind.value_type}, not numbers")
    return tuple(stated)


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_floating(kind) or pa.types.is_integer(kind)


def _alike(found: pa.DataType, wanted: pa.DataType) -> bool:
    if pa.types.is_fixed_size_list(wanted):
        fixed = pa.types.is_fixed_size_list(found) and found.list_size == wanted.list_size
        return fixed and _alike(found.value_type, wanted.value_type)
    if pa.types.is_list(wanted):
        listed = pa.types.is_list(found) or pa.types.is_large_list(found)
        return listed and _alike(found.value_type, wanted.value_type)
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
