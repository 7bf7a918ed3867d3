"""Read the dataset with DuckDB: python with_duckdb.py data/dataset"""

import io
import sys

import duckdb
import numpy as np


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


shards = f"{sys.argv[1]}/*.parquet"
query = f"SELECT scene_id, color, K FROM '{shards}' WHERE lighting = 'night' ORDER BY objects DESC"
for scene, color, K in duckdb.sql(query).fetchall():
    print(scene, image(color).shape, np.array(K).shape)
