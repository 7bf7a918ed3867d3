"""Read the dataset with a PyTorch DataLoader: python with_torch.py data/dataset"""

import json
import sys
from pathlib import Path

import pyarrow.parquet as pq
import torch


class Views(torch.utils.data.IterableDataset):
    def __iter__(self):
        for shard in sorted(Path(sys.argv[1]).glob("train-*.parquet")):
            columns = ["shading", "color", "radiance_scale"]
            for batch in pq.ParquetFile(shard).iter_batches(4, columns=columns):
                shape = json.loads(batch.schema.field("color").metadata[b"shape"])
                scale = batch["radiance_scale"].to_numpy().reshape(-1, 1, 1, 1)
                arrays = [batch[name].flatten().to_numpy() for name in columns[:2]]
                images = [
                    torch.from_numpy(array.reshape(-1, *shape).astype("float32") * scale)
                    for array in arrays
                ]
                yield from zip(*images, strict=True)


for shading, color in torch.utils.data.DataLoader(Views(), batch_size=2):
    print("shading", tuple(shading.shape), "color", tuple(color.shape), color.dtype)
