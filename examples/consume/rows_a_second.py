"""Rows per second of several readers, decoding all images: python rows_a_second.py data/dataset

Wall and processor time, medians of five turns; libraries that are not installed are left out.
"""

import io
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

SHARDS = sorted(map(str, Path(sys.argv[1]).glob("*-of-*.parquet")))
SCHEMA = pq.read_schema(SHARDS[0])
IMAGES = [field.name for field in SCHEMA if b"dtype" in (field.metadata or {})]
GROUPS = [
    (path, group) for path in SHARDS for group in range(pq.read_metadata(path).num_row_groups)
]


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


def decoded(cells):
    """Number of values in these cells."""
    return sum(image(cell).size for cell in cells)


def pyarrow():
    for path, group in GROUPS:
        for column in pq.ParquetFile(path).read_row_group(group, IMAGES).columns:
            decoded(cell.as_py() for cell in column)


def one_group(place):
    path, group = place
    for column in pq.ParquetFile(path).read_row_group(group, IMAGES, use_threads=False).columns:
        decoded(cell.as_py() for cell in column)


def pyarrow_threads():
    with ThreadPoolExecutor() as pool:
        list(pool.map(one_group, GROUPS))


def polars():
    import polars as pl

    for column in pl.scan_parquet(SHARDS).select(IMAGES).collect().iter_columns():
        decoded(column)


def duckdb():
    import duckdb

    rows = duckdb.connect().execute(f"SELECT {', '.join(IMAGES)} FROM read_parquet({SHARDS})")
    while row := rows.fetchone():
        decoded(row)


def datasets():
    from datasets import load_dataset

    views = load_dataset("parquet", data_files=SHARDS, split="train", columns=IMAGES)
    for row in views:
        decoded(row.values())


def torch():
    from torch.utils.data import DataLoader

    def rows(places):
        for path, group in places:
            for row in pq.ParquetFile(path).read_row_group(group, IMAGES).to_pylist():
                yield {name: image(cell) for name, cell in row.items()}

    for _ in DataLoader(GROUPS, batch_size=None, collate_fn=lambda place: list(rows([place]))):
        pass


count = sum(pq.read_metadata(path).num_rows for path in SHARDS)
print(f"{count} rows, {len(IMAGES)} images per row: {', '.join(IMAGES)}")
for reader in (pyarrow, pyarrow_threads, polars, duckdb, datasets, torch):
    spent = []
    try:
        reader()  # imports, and the cache of datasets
        for _ in range(5):
            wall, cpu = time.perf_counter(), time.process_time()
            reader()
            spent.append((time.perf_counter() - wall, time.process_time() - cpu))
    except ImportError as error:
        print(f"{reader.__name__:16} {error}")
        continue
    wall, cpu = (sorted(times)[len(times) // 2] for times in zip(*spent, strict=True))
    best = min(times[1] for times in spent)
    print(f"{reader.__name__:16} {count / wall:6.0f} rows per second, "
          f"{count / cpu:6.0f} per CPU second, {count / best:6.0f} at best")  # fmt: skip
