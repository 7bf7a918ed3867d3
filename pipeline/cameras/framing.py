"""Framing of a view as in photographs: no blank wall or lamp that fills it, a subject on a third.

Measured on the small id image of `pbrnet.pipeline.cameras.view_sampling`. PBRS has no such rule;
the parameter `cameras.framing` chooses.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pbrnet.scenes.contract import Scene

LARGEST_BLANK = 0.25  # of the view, one blank surface
LARGEST_LAMP = 0.12  # of the view, one lamp
LARGEST_THING = 0.5  # of the view, one object
NEAREST = 1.2  # metres, geometric mean of the distances of what is seen
THIRDS = 2.0  # most that a subject on a third adds to the score of a view
THINGS = 0.8  # that each object in view, however small, adds to the score of a view
_BLOCKS = (8, 6)  # columns and rows in which a view is tested for blank surfaces
_BLANK = 0.97  # share of a block that one surface fills if it is blank
_BARE = ("wall", "ceiling", "door", "structure", "slab", "skirting")
_SPREAD = 0.12  # of the image's width, distance from a third at which the bonus falls to 1/e


@dataclass(frozen=True)
class Framing:
    """Measures of a view's composition."""

    blank: float  # share of the view in its largest blank wall, ceiling or door
    lamp: float  # share of the largest lamp
    thing: float  # share of the largest object that is not structure
    thirds: float  # closeness of the subject to a crossing of the thirds, [0, 1]


def framing_of(ids: npt.NDArray[np.uint32], scene: Scene, counted: Collection[str]) -> Framing:
    """Return the framing of an image (H, W) of object numbers + 1; `counted` are the ids of objects
    that may be its subject, which is the largest of them."""
    pixels = np.bincount(ids.ravel(), minlength=len(scene.objects) + 1)[1:] / ids.size
    kinds = np.array([item.category for item in scene.objects])
    loose = np.array([not item.is_structure for item in scene.objects], dtype=bool)
    bare = np.flatnonzero(~loose & np.isin(kinds, _BARE)) + 1
    subjects = [k for k, item in enumerate(scene.objects) if item.id in counted and pixels[k] > 0]
    thirds = 0.0
    if subjects:
        subject = max(subjects, key=lambda k: float(pixels[k]))
        thirds = _closeness(ids == subject + 1)
    return Framing(
        _largest_blank(ids, bare),
        float(pixels[kinds == "lamp"].max(initial=0)),
        float(pixels[loose].max(initial=0)),
        thirds,
    )


def is_framed(framing: Framing, reach: float) -> bool:
    """Test whether a photographer would take it; `reach` is the mean distance, metres."""
    return (
        framing.blank <= LARGEST_BLANK
        and framing.lamp <= LARGEST_LAMP
        and framing.thing <= LARGEST_THING
        and reach >= NEAREST
    )


def _largest_blank(ids: npt.NDArray[np.uint32], bare: npt.NDArray[np.int64]) -> float:
    """Return the share of blocks in the largest region of blocks that one bare surface fills."""
    columns, rows = _BLOCKS
    height, width = ids.shape
    top, left = (np.arange(n) * size // n for n, size in ((rows, height), (columns, width)))
    sizes = np.diff(top, append=height)[:, None] * np.diff(left, append=width)
    pixels = np.bincount(ids.ravel(), minlength=int(bare.max(initial=0)) + 1)[bare]
    largest = 0
    for surface in bare[pixels >= _BLANK * sizes.min()]:
        inside = np.add.reduceat((ids == surface).astype(np.int64), top, axis=0)
        filled = np.add.reduceat(inside, left, axis=1) >= _BLANK * sizes
        regions, count = ndimage.label(filled)
        if count:
            largest = max(largest, int(np.bincount(regions.ravel())[1:].max()))
    return largest / sizes.size


def _closeness(subject: npt.NDArray[np.bool_]) -> float:
    """Return how close the middle of a subject's mask (H, W) is to a crossing of the thirds."""
    rows, columns = np.nonzero(subject)
    height, width = subject.shape
    x, y = float(columns.mean() + 0.5) / width, float(rows.mean() + 0.5) / height
    away = min(
        (x - across) ** 2 + ((y - down) * height / width) ** 2
        for across in (1 / 3, 2 / 3)
        for down in (1 / 3, 2 / 3)
    )
    return math.exp(-away / _SPREAD**2)
