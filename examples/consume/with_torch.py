"""Read the dataset with a PyTorch DataLoader: python with_torch.py data/dataset"""

import sys

from pbrnet_reader import TorchStream
from torch.utils.data import DataLoader

# Rows of radiance in one unit; workers that stay share all rows anew, in another order, each pass.
views = TorchStream(sys.argv[1], ["shading", "color"], renderer_units=True, seed=0)
for batch in DataLoader(views, batch_size=2, num_workers=2, persistent_workers=True):
    print("shading", tuple(batch["shading"].shape), "color", batch["color"].dtype)
