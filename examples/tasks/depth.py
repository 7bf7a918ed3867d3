"""Monocular depth: a small network learns depth from colour. python depth.py FOLDER [STEPS]"""

import torch
from command import arguments
from network import display, fit, network, tensor
from pbrnet_reader import read
from PIL import Image

FOLDER, STEPS = arguments(__doc__, STEPS=200)


def load(split):
    """Colour and the pixel's row in the image, log depth, and the mask of known depth."""
    views = list(read(FOLDER, ["color", "depth"], split))
    color = display(tensor([view["color"] for view in views]))
    depth = tensor([view["depth"] for view in views])
    height = torch.linspace(-1, 1, color.shape[2])[:, None].expand_as(depth)
    return torch.cat([color, height], 1), depth.clamp(min=0.1).log(), (depth > 0).float()


def error(predicted, log_depth, known):
    """Error of log depth after the best scale per view."""
    difference = (predicted - log_depth) * known
    count = known.sum((1, 2, 3)).clamp(min=1)
    mean, square = difference.sum((1, 2, 3)) / count, (difference**2).sum((1, 2, 3)) / count
    return (square - mean**2).clamp(min=1e-6).sqrt().mean()


model, train, test = network(4, 1), load("train"), load("test")
with torch.no_grad():
    start = [error(model(views[0]), *views[1:]) for views in (train, test)]
fit(model, train, error, STEPS)
with torch.no_grad():
    predicted = model(test[0])
    end = [error(model(views[0]), *views[1:]) for views in (train, test)]
print(f"error on training views {start[0]:.3f} -> {end[0]:.3f}")
print(f"error on held-out homes {start[1]:.3f} -> {end[1]:.3f}")
_, log_depth, known = (values[:1] for values in test)
offset = ((log_depth - predicted[:1]) * known).sum() / known.sum()  # the unknown scale
pair = torch.cat([log_depth, predicted[:1] + offset], 3)[0, 0]
grey = 255 * (pair - log_depth.min()) / (log_depth.max() - log_depth.min())
Image.fromarray(grey.clamp(0, 255).numpy().astype("uint8")).save("depth.png")
torch.save(model.state_dict(), "depth.pt")
print("depth.png: true and predicted depth of a view; depth.pt: the network")
