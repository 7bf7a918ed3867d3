"""Check that the panorama of the environment agrees with the view's own image."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from pipeline.channels import NORMAL
from pipeline.frames import Channels
from pipeline.views import View
from scenes.arrays import Float64Array
from scenes.geometry.directions import pixel_directions

_SLACK = 0.05  # of the distance, beyond that of the panorama's neighbouring pixels
_MOST_APART = 0.2  # share of the pixels: objects narrower than a pixel of the panorama


def environment_fault(environment: Channels, inputs: Channels, view: View) -> str | None:
    """Say what is wrong with the channels of an `environment` frame, or return None.

    Normals are of unit length where there is a surface, and most surfaces of the view's depth have
    the distance of the panorama's pixels around their direction.
    """
    distance = environment["distance.Z"].astype(np.float64)
    there = distance > 0
    lengths = np.sqrt(sum(environment[band].astype(np.float32) ** 2 for band in NORMAL))
    crooked = int((np.abs(lengths - there) > 0.01).sum())
    if crooked:
        return f"{crooked} normals are not of unit length, or without a surface"
    apart = distance_disagreement(distance, inputs, view)
    if apart > _MOST_APART:
        return f"{apart:.1%} of the view's surfaces are not where the panorama sees them"
    return None


def distance_disagreement(distance: Float64Array, inputs: Channels, view: View) -> float:
    """Return the share of the view's surfaces that a panorama of distances (h, w) does not show.

    A surface is shown if its distance lies between those of the panorama's nine pixels around its
    direction, or up to 5 % beyond them.
    """
    valid = inputs["valid"] > 0
    rays = pixel_directions(view.intrinsics, view.width, view.height)[valid]
    lengths = np.sqrt((rays * rays).sum(axis=-1))
    metres = inputs["Z"][valid] * lengths
    height, width = distance.shape
    azimuth = np.arctan2(rays[:, 0], rays[:, 2]) / (2 * math.pi) + 0.5
    polar = np.arccos(np.clip(-rays[:, 1] / lengths, -1, 1)) / math.pi
    column = (azimuth * width).astype(int) % width
    row = np.minimum((polar * height).astype(int), height - 1)
    modes = ("nearest", "wrap")  # across the poles, and around
    least = minimum_filter(np.where(distance > 0, distance, np.inf), 3, mode=modes)[row, column]
    most = maximum_filter(np.where(distance > 0, distance, np.inf), 3, mode=modes)[row, column]
    shown = (metres >= least * (1 - _SLACK)) & (metres <= most * (1 + _SLACK))
    return float(1 - shown.mean()) if len(shown) else 0.0
