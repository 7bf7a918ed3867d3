"""Read the dataset with Hugging Face datasets: python with_datasets.py data/dataset"""

import sys
from pathlib import Path

from datasets import load_dataset

files = {"train": str(Path(sys.argv[1]) / "train-*.parquet")}
views = load_dataset("parquet", data_files=files, split="train", streaming=True)
for view in views.with_format("numpy"):
    depth = view["depth"].reshape(view["height"], view["width"])
    print(view["scene_id"], view["view_id"], view["preview"].shape, "depth", depth.shape)
