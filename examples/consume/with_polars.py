"""Read the dataset with polars: python with_polars.py data/dataset"""

import io
import sys
from pathlib import Path

import numpy as np
import polars as pl


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


views = pl.scan_parquet(Path(sys.argv[1]) / "*.parquet")
dark = views.filter(pl.col("lighting") == "night").select("scene_id", "color", "K").collect()
for row in dark.iter_rows(named=True):
    print(row["scene_id"], image(row["color"]).shape, np.array(row["K"]).shape)
