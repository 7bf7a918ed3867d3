"""Read the dataset with pyarrow and NumPy only: python with_pyarrow.py data/dataset"""

import io
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


columns = ["depth", "color", "radiance_scale", "K"]
for shard in sorted(Path(sys.argv[1]).glob("train-*.parquet")):
    for batch in pq.ParquetFile(shard).iter_batches(4, columns=columns):
        for row in batch.to_pylist():
            depth, color, K = image(row["depth"]), image(row["color"]), np.array(row["K"])
            # Stored in a unit that suits half floats.
            radiance = color.astype("float32") * row["radiance_scale"]
            print(depth.shape, color.shape, color.dtype, K.dtype, "mean", float(radiance.mean()))
