"""Rows of the dataset with pyarrow and NumPy, for the tasks in this folder."""

import io
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq


def image(cell):
    """Array (H, W), (H, W, 3) or (n, H, W, 3) of a cell: a .npy file of its byte planes."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


def rows(folder, split, columns):
    """Rows of a split (* for all splits) as dictionaries, images as arrays."""
    for shard in sorted(Path(folder).glob(f"{split}-*.parquet")):
        for batch in pq.ParquetFile(shard).iter_batches(4, columns=columns):
            for row in batch.to_pylist():
                yield {k: image(v) if isinstance(v, bytes) else v for k, v in row.items()}
