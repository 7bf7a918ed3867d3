"""Denoiser pairs: a small network learns to clean few samples. python denoise.py FOLDER [STEPS]"""

import torch
from command import arguments
from network import fit, network, tensor
from pbrnet_reader import read

FOLDER, STEPS = arguments(__doc__, STEPS=200)
COLORS = ["noisy_color", "denoised_color", "color"]


def load(split):
    """Noisy input with reflectance and normal; noisy, denoised by Intel, ground truth."""
    views = list(read(FOLDER, [*COLORS, "reflectance", "normal"], split))
    noisy, denoised, truth = (
        torch.log1p(20 * tensor([view[name] for view in views])) for name in COLORS
    )
    guides = [tensor([view[name] for view in views]) for name in ("reflectance", "normal")]
    return torch.cat([noisy, *guides], 1), noisy, denoised, truth


def cleaned(output, noisy):
    """Image from the network's output: each pixel is a weighted mean of its neighbours."""
    weights = torch.softmax(output, 1)  # of 7 x 7 neighbours
    patches = torch.nn.functional.unfold(noisy, 7, padding=3)
    patches = patches.view(len(noisy), 3, 49, *noisy.shape[2:])
    return (patches * weights[:, None]).sum(2)


def loss(output, noisy, denoised, truth):
    """Mean difference of the logarithms."""
    return (cleaned(output, noisy) - truth).abs().mean()


test, model = load("test"), network(9, 49)
fit(model, load("train"), loss, STEPS)
_, noisy, denoised, truth = test
with torch.no_grad():
    ours = loss(model(test[0]), noisy, denoised, truth)
print(f"error {(noisy - truth).abs().mean():.3f} -> {ours:.3f}")
print(f"Intel's denoiser {(denoised - truth).abs().mean():.3f}")
