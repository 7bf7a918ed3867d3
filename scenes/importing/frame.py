"""Frame of a source without stated axes or unit: which way is up, and how long a metre is."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.importing.camera import Camera
from pbrnet.scenes.importing.changes import UNSURE_SCALE, UNSURE_UP, Changes
from pbrnet.scenes.importing.objects import shape_category
from pbrnet.scenes.importing.options import FreeAxesOptions
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.reconstruction.orientation import (
    guess_scale,
    looks_down,
    signed_axis,
    surface_heights,
    tallest_gaps,
    up_from_geometry,
    upright,
)
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.scale_clues import size_clues, usual_size

_SEVERAL = 2  # things with names that tell their size
_TOO_LARGE = 2.5  # standard deviations of their usual size


def upright_metric_frame(
    shapes: list[Shape],
    cameras: list[Camera],
    options: FreeAxesOptions,
    changes: Changes,
    default_up: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> Float64Array:
    """The similarity (4, 4) from a file's right-handed world to ours (metres, Z up).

    Up is what the options state, else that of the first camera, else found in the geometry with
    `default_up` in doubt; the scale is what the options state or a guess.
    """
    corners = np.concatenate([shape.mesh.corners for shape in shapes])
    if options.up != "auto":
        up = np.eye(3)["xyz".index(options.up)]
    elif cameras:
        up = signed_axis(cameras[0].to_world[:3, 1])
        if looks_down(corners, up, cameras[0].to_world[:3, 2]):
            changes.note(f"{UNSURE_UP}: the camera seems to look straight down; give --up")
    else:
        up = up_from_geometry(corners, np.array(default_up))
    turn = upright(up)
    if not np.array_equal(turn, np.eye(3)):
        name = ("-" if up.sum() < 0 else "+") + "XYZ"[int(np.argmax(np.abs(up)))]
        changes.note(f"the scene was turned so that its {name} axis points up (Z)")
    scale = options.scale
    if scale is None:
        scale = guess_scene_scale(corners @ turn.T, cameras, turn, changes)
        _doubt_scale(shapes, scale, changes)
    frame = np.eye(4)
    frame[:3, :3] = scale * turn
    return frame


def guess_scene_scale(
    corners: Float64Array, cameras: list[Camera], turn: Float64Array, changes: Changes
) -> float:
    """Guess metres per unit from the height between floor and ceiling.

    `corners` (F, 3, 3) are upright triangles; `turn` (3, 3) made them so. With cameras, the
    height is measured around the first one.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rays = RayCaster(corners)
    xs, ys = (np.linspace(low[axis], high[axis], 32)[1:-1] + 1e-4 for axis in (0, 1))
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    through = None
    if cameras:
        eye = turn @ cameras[0].to_world[:3, 3]
        if (eye > low).all() and (eye < high).all():
            points = np.concatenate([points, eye[None, :2]])
            through = float(eye[2])
    columns = surface_heights(rays, points, float(low[2]), float(high[2]))
    gaps = tallest_gaps(columns, through)
    if not len(gaps):
        changes.note(
            "the unit of length could not be guessed, because no floor with a ceiling was found; "
            "1 unit was read as 1 m (change it with --scale)"
        )
        return 1.0
    height = float(np.percentile(gaps[:, 1] - gaps[:, 0], 75))
    scale, unit = guess_scale(height)
    if scale != 1.0:
        changes.note(
            f"lengths were read as {unit}, because a room is {height:.4g} units high "
            "(change it with --scale)"
        )
    return scale


def _doubt_scale(shapes: list[Shape], scale: float, changes: Changes) -> None:
    """Note a doubt if all things whose names tell their size are too large, as in a still life.

    The smallest of each category counts: a shape may hold several.
    """
    sizes: dict[str, list[float]] = {}
    for shape in shapes:
        low, high = shape.mesh.bounds
        sizes.setdefault(shape_category(shape), []).append(float(np.max(high - low)))
    clues = size_clues({category: [min(found)] for category, found in sizes.items()})
    count = sum(len(found) for category, found in sizes.items() if usual_size(category))
    if count >= _SEVERAL and all(clue.deviation(scale) > _TOO_LARGE for clue in clues):
        found = ", ".join(clue.sentence(scale) for clue in clues)
        changes.note(f"{UNSURE_SCALE}: {found}; give --scale, unless that is right")
