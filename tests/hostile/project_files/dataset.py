"""Hostile shards of datasets, and ledgers."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.mutations import LONG, damaged_bytes, deep
from tests.hostile.project_files.base import small_params, write_ledger

CHECKED = (
    "inspect data/dataset --out p.png",
    "inspect data/dataset --diversity --out p.png",
    "train unet --data data --models made",
    "evaluate --data data --models models",
)


def _dataset(folder: Path) -> None:
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


def _column(name: str, make: Callable[[int], Any] | None, command: int = 0) -> Made:
    """A shard in which one column is another, or absent."""

    def write(folder: Path) -> Arguments:
        import pyarrow as pa
        import pyarrow.parquet as pq

        for shard in sorted((folder / "data" / "dataset").glob("*.parquet")):
            table = pq.read_table(shard)
            place = table.column_names.index(name)
            field = table.schema.field(name)
            table = table.remove_column(place)
            if make:
                values = pa.array(make(table.num_rows))
                changed = pa.field(name, values.type, metadata=field.metadata)
                table = table.add_column(place, changed, values)
            pq.write_table(table, shard)
        return CHECKED[command].split()

    return write


def _shape(text: str, command: int = 0) -> Made:
    """A shard whose images have another shape in their metadata."""

    def write(folder: Path) -> Arguments:
        import pyarrow.parquet as pq

        for shard in sorted((folder / "data" / "dataset").glob("*.parquet")):
            table = pq.read_table(shard)
            fields = [
                one.with_metadata({**one.metadata, b"shape": text.encode()})
                if one.metadata and b"shape" in one.metadata
                else one
                for one in table.schema
            ]
            import pyarrow as pa

            pq.write_table(pa.Table.from_arrays(table.columns, schema=pa.schema(fields)), shard)
        return CHECKED[command].split()

    return write


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

LEDGER = "data/ledger.parquet"

COSTS = (f"inspect {LEDGER} --out p.png", "cost --data data", "cost --data data --check --json")


def _ledger_made(name: str, make: Callable[[int], Any] | None, command: int) -> Made:
    def write(folder: Path) -> Arguments:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pq.read_table(folder / LEDGER)
        place = table.column_names.index(name)
        table = table.remove_column(place)
        if make:
            table = table.add_column(place, name, pa.array(make(table.num_rows)))
        pq.write_table(table, folder / LEDGER)
        return COSTS[command].split()

    return write


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
        _dataset,
        (Victim(SHARD, damaged_bytes, CHECKED),),
        SHARDS_MADE,
        ends_early=CHECKED[2:],
        seconds=1.5,
    ),
    Family("ledgers", 80, write_ledger, (Victim(LEDGER, damaged_bytes, COSTS),), LEDGERS_MADE),
)
