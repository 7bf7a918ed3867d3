"""Read the dataset with Hugging Face datasets: python with_datasets.py data/dataset"""

import io
import sys
from pathlib import Path

import numpy as np
from datasets import load_dataset


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


def decode(batch):
    """Turn all cells with bytes to arrays."""
    return {
        name: [image(cell) if isinstance(cell, bytes) else cell for cell in cells]
        for name, cells in batch.items()
    }


files = {"train": str(Path(sys.argv[1]) / "train-*.parquet")}
views = load_dataset("parquet", data_files=files, split="train").with_transform(decode)
for view in views:
    print(view["scene_id"], view["view_id"], view["preview"].size, view["color"].shape)
