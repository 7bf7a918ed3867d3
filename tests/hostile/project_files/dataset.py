"""Hostile shards of datasets, and ledgers."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.hostile.family import Family, Victim
from tests.hostile.made import case
from tests.hostile.mutations import LONG, damaged_bytes, deep
from tests.hostile.project_files.base import small_params, write_ledger

EXPORTS = ("colmap", "nerfstudio", "webdataset", "tum", "hypersim")
CHECKED = (
    "inspect data/dataset --out p.png",
    "inspect data/dataset --diversity --out p.png",
    "train unet --data data --models made",
    "evaluate --data data --models models",
    *(f"export-data --data data --out made --to {name}" for name in EXPORTS),
    "score pictures --dataset data/dataset",
)
LOOKS = (0, 1, 4, 5, 6)  # commands that read every shard


def write_dataset(folder: Path) -> None:
    from pbrnet.pipeline.dataset.pack import pack_dataset
    from pbrnet.pipeline.params import load_params
    from tests.fixtures.dataset import make_data
    from tests.fixtures.predictor import untrained_models

    small_params(folder)
    params = load_params(folder / "params.yaml")
    make_data(folder / "data", params, scenes=3, views=1)
    pack_dataset(folder / "data", params)
    untrained_models(folder / "models", width=2, levels=2)


SHARD = "data/dataset/train-00000-of-00001.parquet"


@case
def _column(folder: Path, name: str, make: Callable[[int], Any] | None, command: int = 0) -> str:
    """Shards in which one column is another, or absent."""
    _rewrite(folder, lambda table: _with_column(table, name, make))
    return CHECKED[command]


def _with_column(table: Any, name: str, make: Callable[[int], Any] | None) -> Any:
    import pyarrow as pa

    place, field = table.column_names.index(name), table.schema.field(name)
    table = table.remove_column(place)
    if not make:
        return table
    values = pa.array(make(table.num_rows))
    return table.add_column(place, pa.field(name, values.type, metadata=field.metadata), values)


@case
def _values(folder: Path, name: str, value: Any, command: int) -> str:
    """Shards in which every row has this value in a column, of the type that it has."""
    import pyarrow as pa

    def changed(table: Any) -> Any:
        place, field = table.column_names.index(name), table.schema.field(name)
        values = pa.array([value] * table.num_rows, field.type)
        return table.set_column(place, field, values)

    _rewrite(folder, changed)
    return CHECKED[command]


@case
def _twice(folder: Path, name: str, command: int) -> str:
    _rewrite(folder, lambda table: table.append_column(table.field(name), table.column(name)))
    return CHECKED[command]


@case
def _without_rows(folder: Path, command: int) -> str:
    _rewrite(folder, lambda table: table.slice(0, 0))
    return CHECKED[command]


def _rewrite(
    folder: Path, change: Callable[[Any], Any], files: str = "data/dataset/*.parquet"
) -> None:
    import pyarrow.parquet as pq

    for shard in sorted(folder.glob(files)):
        pq.write_table(change(pq.read_table(shard)), shard)


@case
def _beside(folder: Path, name: str, put: Callable[[Path], object], command: str) -> str:
    """Something that is no regular file beside the shards."""
    path = folder / "data" / "dataset" / name
    path.unlink(missing_ok=True)
    put(path)
    return command


def _diagonal(*values: float) -> list[list[float]]:
    return [[value if row == column else 0.0 for column in range(len(values))]
            for row, value in enumerate(values)]  # fmt: skip


_NAN, _INFINITY = float("nan"), float("inf")
_IMPOSSIBLE: tuple[tuple[str, Any], ...] = (
    ("K", _diagonal(0, 0, 0)),
    ("K", _diagonal(_NAN, _NAN, _NAN)),
    ("K", _diagonal(1e308, 1e308, 1)),
    ("K", _diagonal(-20, 20, 1)),
    ("K", _diagonal(20, 20, 0)),
    ("camera_to_world", _diagonal(0, 0, 0, 0)),
    ("camera_to_world", _diagonal(2, 1, 1, 1)),
    ("camera_to_world", _diagonal(-1, 1, 1, 1)),
    ("camera_to_world", _diagonal(_INFINITY, 1, 1, 1)),
    ("exposure_color", 0.0),
    ("exposure_color", _NAN),
    ("exposure_color", -1.0),
    ("white_color", 0.0),
    ("scene_id", "a\nError: forged"),
    ("scene_id", "../../outside"),
    ("view_id", "\x1b[2J\x07"),
    ("view_id", ""),
)


@case
def _shape(folder: Path, text: str, command: int = 0) -> str:
    """A shard whose images have another shape in their metadata."""
    import pyarrow as pa

    def changed(table: Any) -> Any:
        fields = [
            one.with_metadata({**one.metadata, b"shape": text.encode()})
            if one.metadata and b"shape" in one.metadata
            else one
            for one in table.schema
        ]
        return pa.Table.from_arrays(table.columns, schema=pa.schema(fields))

    _rewrite(folder, changed)
    return CHECKED[command]


SHARDS_MADE = (
    *(
        _column(name, make, command)
        for command in (0, 1, 2)
        for name, make in (
            ("scene_id", None),
            ("depth", None),
            ("preview", None),
            ("depth", lambda n: ["x"] * n),
            ("depth", lambda n: [[1.0]] * n),
            ("preview", lambda n: [3] * n),
            ("preview", lambda n: [b"no picture"] * n),
            ("scene_id", lambda n: [1] * n),
            ("scene_id", lambda n: [None] * n),
            ("split", lambda n: [None] * n),
            ("K", lambda n: ["x"] * n),
            ("K", lambda n: [[1.0]] * n),
            ("exposure_color", lambda n: ["x"] * n),
            ("exposure_color", lambda n: [None] * n),
            ("color", lambda n: [None] * n),
        )
    ),
    *(
        _shape(text, command)
        for command in (0, 1, 2)
        for text in ("x", "[]", "[1e9, 2]", '["a"]', deep(), f"[{LONG}]", "{}", "[-1, 4]")
    ),
)

IMPOSSIBLE_MADE = (
    *(
        _values(name, value, command)
        for number, (name, value) in enumerate(_IMPOSSIBLE)
        for command in (LOOKS if number in (0, 7, 9, 13) else (LOOKS[number % len(LOOKS)], 1))
    ),
    *(_twice(name, command) for name in ("scene_id", "K", "depth") for command in LOOKS),
    *(_without_rows(command) for command in LOOKS),
    *(
        _beside(name, put, "inspect data/dataset --verify --text-only")
        for name in ("SHA256SUMS", "README.md", "rejected.csv", "scenes.csv", "test-x.parquet")
        for put in (os.mkfifo, lambda path: path.symlink_to("/dev/zero"), Path.mkdir)
    ),
    *(
        _beside("scenes.csv", put, CHECKED[3])
        for put in (
            os.mkfifo,
            lambda path: path.symlink_to("/dev/zero"),
            lambda path: path.write_text("scene_id,plan\n" + "x" * 200_000 + ",1\n"),
            lambda path: path.write_bytes(b"scene_id,plan\n\xff,1\n"),
        )
    ),
)

LEDGER = "data/ledger.parquet"

COSTS = (f"inspect {LEDGER} --out p.png", "cost --data data", "cost --data data --check --json")


@case
def _ledger_made(folder: Path, name: str, make: Callable[[int], Any] | None, command: int) -> str:
    _rewrite(folder, lambda table: _with_column(table, name, make), LEDGER)
    return COSTS[command]


LEDGERS_MADE = tuple(
    _ledger_made(name, make, command)
    for command in (0, 1, 2)
    for name, make in (
        ("seconds", lambda n: ["x"] * n),
        ("seconds", lambda n: [float("nan")] * n),
        ("seconds", lambda n: [1e308] * n),
        ("seconds", lambda n: [-1.0] * n),
        ("seconds", lambda n: [None] * n),
        ("stage", lambda n: [None] * n),
        ("stage", lambda n: [1] * n),
        ("stage", lambda n: ["\U0001f600" * 99] * n),
        ("seconds", None),
        ("scene_id", None),
        ("width", lambda n: [0] * n),
        ("width", lambda n: [2**31 - 1] * n),
        ("spp", lambda n: [None] * n),
        ("peak_mb", lambda n: [float("inf")] * n),
    )
)


FAMILIES = (
    Family(
        "shards",
        140,
        write_dataset,
        (Victim(SHARD, damaged_bytes, CHECKED),),
        SHARDS_MADE,
        ends_early=(*CHECKED[2:4], *CHECKED[7:]),
        seconds=1.5,
    ),
    Family(
        "impossible rows",
        len(IMPOSSIBLE_MADE) + 1,
        write_dataset,
        (Victim(SHARD, damaged_bytes, CHECKED[:2]),),
        IMPOSSIBLE_MADE,
    ),
    Family("ledgers", 80, write_ledger, (Victim(LEDGER, damaged_bytes, COSTS),), LEDGERS_MADE),
)
