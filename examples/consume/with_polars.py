"""Read the dataset with polars: python with_polars.py data/dataset"""

import sys
from pathlib import Path

import polars as pl
from pbrnet_reader import decode

views = pl.scan_parquet(Path(sys.argv[1]) / "*.parquet")
dark = views.filter(pl.col("lighting") == "night").select("scene_id", "color", "K").collect()
for row in map(decode, dark.iter_rows(named=True)):
    print(row["scene_id"], row["color"].shape, row["K"].shape)
