"""Read the dataset with a PyTorch DataLoader: python with_torch.py data/dataset"""

import json
import sys
from pathlib import Path

import pyarrow.parquet as pq
import torch


class Views(torch.utils.data.IterableDataset):
    def __iter__(self):
        for shard in sorted(Path(sys.argv[1]).glob("train-*.parquet")):
            for batch in pq.ParquetFile(shard).iter_batches(4, columns=["shading", "color"]):
                shape = json.loads(batch.schema.field("color").metadata[b"shape"])
                arrays = [column.flatten().to_numpy().copy() for column in batch.columns]
                images = [torch.from_numpy(array).reshape(-1, *shape) for array in arrays]
                yield from zip(*images, strict=True)


for shading, color in torch.utils.data.DataLoader(Views(), batch_size=2):
    print("shading", tuple(shading.shape), "color", tuple(color.shape), color.dtype)
