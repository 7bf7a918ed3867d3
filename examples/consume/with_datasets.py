"""Read the dataset with Hugging Face datasets: python with_datasets.py data/dataset"""

import sys
from pathlib import Path

from datasets import load_dataset
from pbrnet_reader import decode

views = load_dataset(str(Path(sys.argv[1]).resolve()), "depth", split="train")
for view in views.with_transform(decode):
    print(view["scene_id"], view["view_id"], view["preview"].size, view["color"].shape)
