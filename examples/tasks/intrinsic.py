"""Intrinsic images: reflectance and light of a colour. python intrinsic.py FOLDER [STEPS]"""

import torch
from command import arguments
from network import display, fit, network, tensor
from pbrnet_reader import read

FOLDER, STEPS = arguments(__doc__, STEPS=200)
LEAST = 0.02  # of reflectance, whose logarithm is learned


def load(split):
    """Colour, reflectance, light, and where their product matches colour within 20 %."""
    views = list(read(FOLDER, ["color", "reflectance", "irradiance", "residual"], split))
    color, reflectance, light, residual = (tensor([view[k] for view in views]) for k in views[0])
    matte = (residual.abs() < 0.2 * color).all(1, keepdim=True) & (reflectance > LEAST).all(
        1, keepdim=True
    )
    return display(color), reflectance, light, matte.float(), color


def error(output, reflectance, light, matte, color):
    """Error of log reflectance on matt surfaces."""
    difference = (output - reflectance.clamp(min=LEAST).log()) * matte
    return difference.abs().sum() / (3 * matte.sum())


model, train, test = network(3, 3), load("train"), load("test")
with torch.no_grad():
    start = error(model(train[0]), *train[1:])
fit(model, train, error, STEPS)
with torch.no_grad():
    predicted, (_, _, light, matte, color) = model(test[0]), test
    print(f"error on training views {start:.3f} -> {error(model(train[0]), *train[1:]):.3f}")
grey = train[1].clamp(min=LEAST).log().median().expand_as(predicted)
print(f"held-out homes {error(predicted, *test[1:]):.3f}, grey {error(grey, *test[1:]):.3f}")
found = color.clamp(min=1e-6) / predicted.exp()  # light given this reflectance
off = ((found / light.clamp(min=1e-6)).log().abs() * matte).sum() / (3 * matte.sum())
print(f"light is off by a factor of {off.exp():.2f}, on the {matte.mean():.0%} matte pixels")
