"""Checks of an own piece: scale and proportions, parts that float, open meshes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.reconstruction.scale_clues import usual_size
from pbrnet.scenes.sweethome.catalogue.library import UnusablePiece

_STRANGE, _IMPOSSIBLE = 2.0, 4.0  # times larger or smaller than usual
_STRETCHED, _TORN = 1.1, 2.0  # ratio of scales along the axes
_GAP = 0.02  # metres between parts that do not touch
_DECIMALS = 4  # of metres, to which vertices are welded
_MOST_PARTS = 2000  # of a piece that is looked at


def check_scale(category: str, size: Float64Array, changes: Changes) -> None:
    """Compare the longest side of a size (3,) in metres with that of the category.

    Raises `UnusablePiece` if it is four times as large or small.
    """
    usual = usual_size(category)
    if usual is None:
        return
    longest = float(size.max())
    ratio = max(longest / usual, usual / longest)
    told = f"{longest:.2f} m at the longest side; a {category} usually has {usual:g} m"
    if ratio > _IMPOSSIBLE:
        raise UnusablePiece(f"{told}; is the unit of the table metres?")
    if ratio > _STRANGE:
        changes.note(told)


def check_stretch(scale: Float64Array, changes: Changes) -> None:
    """Compare the scales (3,) of a model along its axes.

    Raises `UnusablePiece` if they differ by more than a factor of two.
    """
    ratio = float(scale.max() / scale.min())
    if ratio > _TORN:
        raise UnusablePiece(
            f"its model would be stretched by {ratio:.2f} to have the table's size; is the front "
            "another axis?"
        )
    if ratio > _STRETCHED:
        changes.note(f"the model was stretched by {ratio:.2f} to have the table's size")


def note_unsound(meshes: Sequence[Mesh], elevation: float, changes: Changes) -> None:
    """Note parts that touch neither the floor nor others, and meshes that are not closed."""
    whole = trimesh.Trimesh(
        np.concatenate([mesh.vertices for mesh in meshes]).round(_DECIMALS),
        np.concatenate(
            [
                mesh.faces + start
                for mesh, start in zip(
                    meshes, np.cumsum([0, *(len(each.vertices) for each in meshes)]), strict=False
                )
            ]
        ),
        process=True,
    )
    whole.merge_vertices(merge_tex=True, merge_norm=True)
    parts = whole.split(only_watertight=False)
    if len(parts) > _MOST_PARTS or not len(parts):
        return
    still = sum(not part.is_watertight for part in parts)
    if still:
        changes.note(f"{still} of {len(parts)} parts are open meshes, seen from both sides")
    if not elevation and (loose := _floating(np.array([part.bounds for part in parts]))):
        changes.note(
            f"{loose} of {len(parts)} parts float: they touch neither others nor the floor"
        )


def _floating(bounds: Float64Array) -> int:
    """Number of boxes (N, 2, 3) that no chain of touching boxes holds to the floor."""
    held = bounds[:, 0, 2] <= bounds[:, 0, 2].min() + _GAP
    for _ in range(len(bounds)):
        low, high = bounds[held, 0] - _GAP, bounds[held, 1] + _GAP
        free = np.flatnonzero(~held)
        touches = (
            (bounds[free, None, 0] <= high[None]) & (bounds[free, None, 1] >= low[None])
        ).all(axis=2)
        found = free[touches.any(axis=1)]
        if not len(found):
            break
        held[found] = True
    return int((~held).sum())
