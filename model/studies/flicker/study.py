"""Temporal stability along a camera move: every frame against the previous one, reprojected.

A short camera move is rendered. Every pixel of a frame is reprojected into the previous frame, by
its depth and both cameras. Where both frames see the same point, their display values are compared.
The renderer's images are measured alike. They differ, too, because of specular reflection, noise
and interpolation between pixels; only the excess over the renderer is flicker of a network. Light
transport and denoised samples, which some networks start from, are measured beside them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from pbrnet.model.data.encoding import color_exposure
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.evaluate import RENDERED
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.studies.flicker.results import MethodFlicker, Move
from pbrnet.pipeline.images import Picture, contact_sheet
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.tonemap import to_bytes, tonemap
from pbrnet.pipeline.views import View, as_matrix
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.directions import pixel_directions

SAME_DEPTH = 0.02  # relative difference up to which two depths are of the same surface
CLEARANCE = 0.1  # minimum distance of the camera from surfaces along its path, metres


@dataclass(frozen=True)
class FlickerConfig:
    """Camera move; `step` is in metres per frame for `dolly` and `truck`, degrees for `pan`."""

    move: Move
    frames: int
    step: float


@dataclass(frozen=True)
class FlickerMeasurement:
    """Differences between frames by method, and a sheet of frames."""

    visible: float  # share of pixels visible in both frames of a pair
    methods: dict[str, MethodFlicker]
    sheet: Picture


def measure_move(
    networks: Sequence[Networks], renderer: ViewRenderer, view: View, config: FlickerConfig
) -> FlickerMeasurement:
    """Predict and render the frames of a move that starts at `view`, and compare neighbours.

    `renderer` is displayed under each frame's own exposure, as the networks' targets are;
    `renderer_one_exposure` under that of the first frame, which shows the share of exposure in the
    difference. Where a network takes light transport or noisy samples, `radiosity` and `denoised`
    are their pictures alone. Raises `InputError` if an obstacle blocks the move, or if neighbouring
    frames have no pixel in common.
    """
    views = move_cameras(view, config)
    _refuse_collisions(renderer.scene, views)
    card = networks[0].card
    cards = [card for each in networks for card in each.cards.values()]
    examples: list[Example] = []
    methods = {method: each for each in networks for method in each.methods}
    images: dict[str, list[AnyArray]] = defaultdict(list)
    with Progress(len(views), "flicker", "frames") as progress:
        for shown in views:
            given = renderer.inputs(shown, cards)
            example = example_of(shown, given, card, renderer.truth(shown))
            examples.append(example)
            for method, each in methods.items():
                images[method].append(each.predict(method, example).color)
            own, first = (color_exposure(e, card.exposure) for e in (example, examples[0]))
            for name, image in _starts(example).items():
                images[name].append(tonemap(image, own))
            images["renderer"].append(tonemap(example["color"], own))
            images["renderer_one_exposure"].append(tonemap(example["color"], first))
            progress.advance()
    matches = [
        reproject(examples[i], examples[i + 1], views[i].pose, views[i + 1].pose)
        for i in range(len(views) - 1)
    ]
    if any(not seen.any() for _, seen in matches):
        raise InputError(
            "two neighbouring frames of the move have no pixel in common; use a smaller --step"
        )
    measured = {name: flicker(shots, matches) for name, shots in images.items()}
    visible = float(np.mean([seen.mean() for _, seen in matches]))
    return FlickerMeasurement(visible, measured, _sheet(images))


def _starts(example: Example) -> dict[str, AnyArray]:
    """Return the linear pictures (H, W, 3) that networks of this example start from."""
    return {name: example[column] for name, column in RENDERED.items() if column in example}


def move_cameras(view: View, config: FlickerConfig) -> list[View]:
    """Return the cameras of all frames, named VIEW-MOVE-00 and so on; the first is `view`.

    `pan` rotates about the world's up axis, clockwise from above. `dolly` and `truck` move
    horizontally along the camera's forward or right axis.
    """
    views = []
    for index in range(config.frames):
        pose, distance = view.pose.copy(), index * config.step
        if config.move == "pan":
            angle = -np.radians(distance)  # clockwise from above
            rotation = np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
            )
            pose[:3, :3] = rotation @ pose[:3, :3]
        elif config.move != "still":
            direction = pose[:3, 2 if config.move == "dolly" else 0] * (1, 1, 0)
            pose[:3, 3] += distance * direction / np.linalg.norm(direction)
        name = f"{view.view_id}-{config.move}-{index:02d}"
        views.append(
            View(view.scene_id, name, view.width, view.height, view.K, as_matrix(pose), view.room)
        )
    return views


def reproject(before: Example, after: Example, pose_before: AnyArray, pose_after: AnyArray) -> Any:
    """Reproject each pixel of `after` into `before`.

    Returns (row, column) in `before`, float64 (2, H, W), where 0 is the centre of the first pixel,
    and whether both frames see the point, bool (H, W). Poses are camera_to_world (4, 4). A point is
    visible in `before` if the pixels around its projection are surfaces whose interpolated depth
    agrees within `SAME_DEPTH`.
    """
    height, width = after["depth"].shape
    rays = pixel_directions(after.intrinsics, width, height)
    world = (rays * after["depth"][..., None]) @ pose_after[:3, :3].T + pose_after[:3, 3]
    camera = (world - pose_before[:3, 3]) @ pose_before[:3, :3]
    z = camera[..., 2]
    pixel = (camera / np.where(z > 1e-6, z, 1.0)[..., None]) @ before.intrinsics.T
    rows, columns = pixel[..., 1] - 0.5, pixel[..., 0] - 0.5
    # Positions within rounding of a pixel's centre are snapped, so that no neighbour is read.
    rows, columns = _snap_to_pixels(rows), _snap_to_pixels(columns)
    bottom, right = before["depth"].shape[0] - 1, before["depth"].shape[1] - 1
    inside = (rows >= 0) & (columns >= 0) & (rows <= bottom) & (columns <= right)
    seen = after["valid"] & inside & (z > 1e-6)
    positions = np.stack([rows, columns])
    # The reciprocal depth of a plane is linear in the image, whatever its slope.
    surface = map_coordinates(
        before["valid"].astype(np.float64), positions, order=1, mode="nearest"
    )
    reciprocal = 1 / np.where(before["valid"], before["depth"], np.inf).astype(np.float64)
    reciprocal_there = map_coordinates(reciprocal, positions, order=1, mode="nearest")
    seen &= (surface > 1 - 1e-6) & (np.abs(reciprocal_there * z - 1) <= SAME_DEPTH)
    return positions, seen


def flicker(images: Sequence[AnyArray], matches: Sequence[Any]) -> MethodFlicker:
    """Return the mean absolute difference of images (H, W, 3) from the previous one, reprojected.

    `matches`: results of `reproject` for each pair of neighbours.
    """
    pairs = []
    for before, after, (positions, seen) in zip(images[:-1], images[1:], matches, strict=True):
        warped = np.stack(
            [
                map_coordinates(before[..., band], positions[:, seen], order=1, mode="nearest")
                for band in range(3)
            ],
            axis=-1,
        )
        pairs.append(float(np.abs(warped - after[seen]).mean()))
    return MethodFlicker(float(np.mean(pairs)), tuple(pairs))


def _snap_to_pixels(values: AnyArray) -> AnyArray:
    near = np.rint(values)
    return np.where(np.abs(values - near) < 1e-4, near, values)


def _refuse_collisions(scene: RenderScene, views: Sequence[View]) -> None:
    """Raise `InputError` if an obstacle is on the line from the first to the last eye."""
    path = views[-1].eye - views[0].eye
    length = float(np.linalg.norm(path))
    if length == 0:
        return
    _, free = raycast.nearest(scene.geometry, views[0].eye, (path / length)[None], through=False)
    if free[0] < length + CLEARANCE:
        raise InputError(
            f"the camera of {views[0].view_id!r} would move {length:.2f} m, but an obstacle is "
            f"{float(free[0]):.2f} m away; use fewer --frames, a smaller --step or "
            "another --move"
        )


def _sheet(images: dict[str, list[AnyArray]]) -> Picture:
    """Draw the first, middle and last frame of every method, a row each."""
    count = len(next(iter(images.values())))
    chosen = sorted({0, count // 2, count - 1})
    shown = [(name, i) for name in images for i in chosen]
    return contact_sheet(
        [to_bytes(images[name][i]) for name, i in shown],
        columns=len(chosen),
        labels=[f"{name}, frame {i}" for name, i in shown],
    )
