"""Read the dataset with DuckDB: python with_duckdb.py data/dataset"""

import sys

import duckdb
import numpy as np
from pbrnet_reader import image

shards = f"{sys.argv[1]}/*.parquet"
query = f"SELECT scene_id, color, K FROM '{shards}' WHERE lighting = 'night' ORDER BY objects DESC"
for scene, color, K in duckdb.sql(query).fetchall():
    print(scene, image(color).shape, np.array(K).shape)
