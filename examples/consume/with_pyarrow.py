"""Read the dataset with pyarrow and NumPy only: python with_pyarrow.py data/dataset"""

import json
import sys
from pathlib import Path

import pyarrow.parquet as pq

for shard in sorted(Path(sys.argv[1]).glob("train-*.parquet")):
    for batch in pq.ParquetFile(shard).iter_batches(
        4, columns=["depth", "color", "radiance_scale"]
    ):
        for name in ("depth", "color"):
            shape = json.loads(batch.schema.field(name).metadata[b"shape"])
            images = batch[name].flatten().to_numpy().reshape(-1, *shape)
            if name == "color":  # stored in a unit that suits half floats
                scale = batch["radiance_scale"].to_numpy().reshape(-1, 1, 1, 1)
                images = images.astype("float32") * scale
            print(name, images.shape, images.dtype, "mean", float(images.mean(dtype=float)))
