"""A small convolutional network and its training, for the tasks in this folder."""

import numpy as np
import torch
from command import counted
from torch import nn


def tensor(images):
    """Float tensor (N, bands, H, W) of a list of images (H, W) or (H, W, bands)."""
    values = torch.from_numpy(np.stack(images).astype("float32"))
    return values.permute(0, 3, 1, 2) if values.ndim == 4 else values[:, None]


def display(radiance):
    """Radiance as the network sees it, -0.5 to 0.5; rows store it so that about 0.2 is medium."""
    return radiance / (radiance + 0.2) - 0.5


def network(inputs, outputs, width=24):
    """Convolutions at half the size, dilated so that each pixel sees 39 x 39 of its neighbours."""
    torch.manual_seed(0)
    layers = [nn.AvgPool2d(2)]
    for dilation in (1, 1, 2, 4, 8, 1):
        layers += [nn.Conv2d(inputs, width, 3, padding="same", dilation=dilation), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers, nn.Conv2d(width, outputs, 1), nn.Upsample(scale_factor=2))


def fit(model, data, loss, steps):
    """Train by Adam on random, sometimes mirrored, views; `data`: tensors, the first the input."""
    optimizer = torch.optim.Adam(model.parameters(), 3e-3)
    for _ in counted(range(steps), f"of {steps} steps"):
        views = torch.randint(len(data[0]), (4,))
        batch = [values[views] for values in data]
        if torch.rand(()) < 0.5:
            batch = [values.flip(-1) for values in batch]
        optimizer.zero_grad()
        loss(model(batch[0]), *batch[1:]).backward()
        optimizer.step()
