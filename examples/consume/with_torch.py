"""Read the dataset with a PyTorch DataLoader: python with_torch.py data/dataset"""

import io
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch


def image(cell):
    """Array (H, W) or (H, W, 3) of a cell: a .npy file of its values, byte plane by byte plane."""
    planes = np.load(io.BytesIO(cell))
    return np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]


class Views(torch.utils.data.IterableDataset):
    """All views once, in another order in each pass; the workers share the row groups."""

    def __init__(self, folder, split="train"):
        shards = sorted(Path(folder).glob(f"{split}-*.parquet"))
        self.groups = [(s, g) for s in shards for g in range(pq.ParquetFile(s).num_row_groups)]
        self.passes = 0

    def __iter__(self):
        worker = torch.utils.data.get_worker_info()
        number, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        order = np.random.default_rng(self.passes).permutation(len(self.groups))
        self.passes += 1
        columns = ["shading", "color", "radiance_scale"]
        for index in order[number::workers]:
            shard, group = self.groups[index]
            for row in pq.ParquetFile(shard).read_row_group(group, columns).to_pylist():
                scale = row.pop("radiance_scale")
                yield {name: torch.from_numpy(image(row[name])).float() * scale for name in row}


loader = torch.utils.data.DataLoader(
    Views(sys.argv[1]), batch_size=2, num_workers=2, persistent_workers=True
)
for batch in loader:
    print("shading", tuple(batch["shading"].shape), "color", batch["color"].dtype)
