"""Segmentation: a small network learns 13 classes. python segmentation.py FOLDER [STEPS]"""

import json
from pathlib import Path

import numpy as np
import torch
from command import arguments
from network import display, fit, network, tensor
from pbrnet_reader import read
from PIL import Image

FOLDER, STEPS = arguments(__doc__, STEPS=200)


def load(split):
    """Colour and normal, and the class of each pixel, 0: none."""
    views = list(read(FOLDER, ["color", "normal", "nyu13"], split))
    color = display(tensor([view["color"] for view in views]))
    normal = tensor([view["normal"] for view in views])
    return torch.cat([color, normal], 1), tensor([view["nyu13"] for view in views]).long()


def loss(scores, label):
    """Cross entropy, without pixels of no class."""
    return torch.nn.functional.cross_entropy(scores, label[:, 0], ignore_index=0)


classes = json.loads((Path(FOLDER) / "classes.json").read_text())["nyu13"]
train, (seen, label) = load("train"), load("test")
model = network(6, 14)
fit(model, train, loss, STEPS)
commonest = train[1][train[1] > 0].mode().values
with torch.no_grad():
    predicted, learned = (
        model(seen).argmax(1, keepdim=True),
        model(train[0]).argmax(1, keepdim=True),
    )
for where, truth, said in (
    ("training views", train[1], learned),
    ("held-out homes", label, predicted),
):
    known = truth > 0
    least, right = ((each == truth)[known].float().mean() for each in (commonest, said))
    print(f"accuracy on {where}, most common class {least:.3f} -> {right:.3f}")
for number in label.unique().tolist():
    there, said = label == number, predicted == number
    if number:
        print(f"  {classes[number]:12} IoU {(there & said).sum() / (there | said).sum():.2f}")
palette = np.random.default_rng(0).integers(40, 255, (14, 3), dtype=np.uint8)
Image.fromarray(palette[torch.cat([label, predicted], 3)[0, 0].numpy()]).save("segmentation.png")
