"""Check that the panorama of the environment agrees with the view's own image."""

from __future__ import annotations

import math

import numpy as np

from pbrnet.pipeline.channels import NORMAL
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.views import View
from pbrnet.scenes.geometry.directions import pixel_directions

_SLACK = 0.05  # of the distance, beyond those of the panorama's pixels around a direction
_COSINE = 0.7  # of the angle between the normals
_MOST_APART = 0.2  # share of the pixels: objects narrower than a pixel of the panorama


def environment_fault(environment: Channels, inputs: Channels, view: View) -> str | None:
    """Say what is wrong with the channels of an `environment` frame, or return None.

    Normals are of unit length where there is a surface, and the panorama shows most surfaces of
    the view in their directions.
    """
    there = environment["distance.Z"] > 0
    lengths = np.sqrt(sum(environment[band].astype(np.float32) ** 2 for band in NORMAL))
    crooked = int((np.abs(lengths - there) > 0.01).sum())
    if crooked:
        return f"{crooked} normals are not of unit length, or without a surface"
    apart = disagreement(environment, inputs, view)
    if apart > _MOST_APART:
        return f"{apart:.1%} of the view's surfaces are not where the panorama sees them"
    return None


def disagreement(environment: Channels, inputs: Channels, view: View) -> float:
    """Return the share of the view's surfaces that its panorama does not show.

    Of the nine pixels of the panorama around a surface's direction, the distances enclose the
    surface's (with 5 % to spare), and one of the normals is at most 45 degrees from it.
    """
    valid = inputs["valid"] > 0
    rays = pixel_directions(view.intrinsics, view.width, view.height)[valid]
    lengths = np.sqrt((rays * rays).sum(axis=-1))
    metres = inputs["Z"][valid] * lengths
    normals = [inputs[band][valid].astype(np.float32) for band in NORMAL]
    height, width = environment["distance.Z"].shape
    azimuth = np.arctan2(rays[:, 0], rays[:, 2]) / (2 * math.pi) + 0.5
    polar = np.arccos(np.clip(-rays[:, 1] / lengths, -1, 1)) / math.pi
    across, down = (azimuth * width).astype(int), (polar * height).astype(int)
    least, most = np.full(len(metres), np.inf), np.zeros(len(metres))
    alike = np.zeros(len(metres), dtype=bool)
    for offset in np.ndindex(3, 3):
        row = np.clip(down + offset[0] - 1, 0, height - 1)
        column = (across + offset[1] - 1) % width
        distance = environment["distance.Z"][row, column].astype(np.float64)
        distance[distance == 0] = np.inf  # no surface: beyond all of them
        least, most = np.minimum(least, distance), np.maximum(most, distance)
        found = (environment[band][row, column] for band in NORMAL)
        alike |= sum(a * b for a, b in zip(found, normals, strict=True)) >= _COSINE
    shown = alike & (metres >= least * (1 - _SLACK)) & (metres <= most * (1 + _SLACK))
    return float(1 - shown.mean()) if len(shown) else 0.0
