"""How steady pictures are while the camera moves: each frame against the one before, warped.

A short camera move is rendered; every pixel of a frame is followed, by its depth and the two
cameras, to where the same point of the room was in the frame before. Where both frames see it, the
colours are compared as displayed. The renderer's own pictures are measured likewise: gloss,
noise, and the blur of reading between pixels make even those differ, so only what is above them
is the network's flicker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from model.data.encoding import color_exposure
from model.data.reader import Example
from model.evaluation.inference import Networks
from model.evaluation.predict import example_of, lit, sampled, trace
from model.studies.flicker.results import Flicker, Move
from pipeline.images import Picture, contact_sheet
from pipeline.params import Params
from pipeline.passes.inputs import render_inputs
from pipeline.progress import Progress
from pipeline.render import raycast
from pipeline.render.scene import RenderScene, open_scene, set_variant
from pipeline.tonemap import to_bytes, tonemap
from pipeline.views import View, as_matrix
from scenes.arrays import AnyArray
from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.geometry.directions import pixel_directions

SAME_DEPTH = 0.02  # relative: nearer than this, two depths are of the same surface
AIR = 0.1  # metres that the camera keeps from what is in its way


@dataclass(frozen=True)
class Wish:
    """A move: `step` is metres a frame of `dolly` (ahead) and `truck` (right), degrees of `pan`."""

    move: Move
    frames: int
    step: float


@dataclass(frozen=True)
class Study:
    """What `measure_move` found, and a sheet of the frames."""

    visible: float  # share of the pixels that both frames of a pair see
    methods: dict[str, Flicker]
    sheet: Picture


def measure_move(
    networks: Sequence[Networks], scene_folder: Path, view: View, wish: Wish, params: Params
) -> Study:
    """Predict and render the frames of a move from `view`, and compare neighbours.

    `renderer` is displayed with each frame's own exposure, as the networks are taught to;
    `renderer_one_exposure` with the first frame's, so what differs is flicker of the exposure.
    Raises `InputError` if something stands in the way, or if neighbours share nothing.
    """
    set_variant(params.farm.variant)
    scene = open_scene(load_scene(scene_folder))
    views = moved(view, wish)
    _refuse_collisions(scene, views)
    card = networks[0].card
    cards = [card for each in networks for card in each.cards.values()]
    sampling = next((one for one in cards if one.training.get("noisy_spp")), card)
    examples: list[Example] = []
    methods = {method: each for each in networks for method in each.methods}
    images: dict[str, list[AnyArray]] = {
        name: [] for name in (*methods, "renderer", "renderer_one_exposure")
    }
    with Progress(len(views), "flicker", "frames") as progress:
        for shown in views:
            inputs = render_inputs(scene, shown)
            light = lit(scene, shown, params, cards, inputs)
            truth = trace(scene, shown, params)
            noisy = sampled(scene, shown, params, sampling)
            example = example_of(shown, inputs, light, card, truth, noisy)
            examples.append(example)
            for method, each in methods.items():
                images[method].append(each.predict(method, example).color)
            exposures = [color_exposure(e, card.exposure) for e in (example, examples[0])]
            for name, exposure in zip(
                ("renderer", "renderer_one_exposure"), exposures, strict=True
            ):
                images[name].append(tonemap(example.color, exposure))
            progress.advance()
    matches = [
        match(examples[i], examples[i + 1], views[i].pose, views[i + 1].pose)
        for i in range(len(views) - 1)
    ]
    if any(not seen.any() for _, seen in matches):
        raise InputError(
            "two neighbouring frames of the move have no pixel in common; use a smaller --step"
        )
    measured = {name: flicker(shots, matches) for name, shots in images.items()}
    visible = float(np.mean([seen.mean() for _, seen in matches]))
    return Study(visible, measured, _sheet(images))


def moved(view: View, wish: Wish) -> list[View]:
    """The frames' cameras, the first is `view`; named VIEW-MOVE-00 and so on.

    `pan` turns about the world's up, to the right; `dolly` follows the camera's direction in the
    plane, so that the eye keeps its height.
    """
    views = []
    for index in range(wish.frames):
        pose, distance = view.pose.copy(), index * wish.step
        if wish.move == "pan":
            angle = -np.radians(distance)  # seen from above, right is clockwise
            turn = np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
            )
            pose[:3, :3] = turn @ pose[:3, :3]
        elif wish.move != "still":
            way = pose[:3, 2 if wish.move == "dolly" else 0] * (1, 1, 0)
            pose[:3, 3] += distance * way / np.linalg.norm(way)
        name = f"{view.view_id}-{wish.move}-{index:02d}"
        views.append(
            View(view.scene_id, name, view.width, view.height, view.K, as_matrix(pose), view.room)
        )
    return views


def match(before: Example, after: Example, pose_before: AnyArray, pose_after: AnyArray) -> Any:
    """Where each pixel of `after` was in `before`: (row, column) and whether both see the point.

    Returns float64 (2, H, W) array indices, 0 the first pixel's centre, and bool (H, W). Poses
    are camera_to_world (4, 4). A point is seen in both if the pixels around its place before are
    surfaces, and what is there is at its depth, within `SAME_DEPTH`.
    """
    height, width = after.depth.shape
    ahead = pixel_directions(after.intrinsics, width, height)
    world = (ahead * after.depth[..., None]) @ pose_after[:3, :3].T + pose_after[:3, 3]
    camera = (world - pose_before[:3, 3]) @ pose_before[:3, :3]
    z = camera[..., 2]
    pixel = (camera / np.where(z > 1e-6, z, 1.0)[..., None]) @ before.intrinsics.T
    rows, columns = pixel[..., 1] - 0.5, pixel[..., 0] - 0.5
    # Snapped where rounding alone keeps a place from a pixel's centre, so no neighbour is read.
    rows, columns = _snapped(rows), _snapped(columns)
    bottom, right = before.depth.shape[0] - 1, before.depth.shape[1] - 1
    inside = (rows >= 0) & (columns >= 0) & (rows <= bottom) & (columns <= right)
    seen = after.valid & inside & (z > 1e-6)
    places = np.stack([rows, columns])
    # Along a plane the reciprocal of the depth is linear in the image, whatever its slope.
    surface = map_coordinates(before.valid.astype(np.float64), places, order=1, mode="nearest")
    nearness = 1 / np.where(before.valid, before.depth, np.inf).astype(np.float64)
    there = map_coordinates(nearness, places, order=1, mode="nearest")
    seen &= (surface > 1 - 1e-6) & (np.abs(there * z - 1) <= SAME_DEPTH)
    return places, seen


def flicker(images: Sequence[AnyArray], matches: Sequence[Any]) -> Flicker:
    """Mean absolute difference of images (H, W, 3) to the one before, by `match`'s results."""
    pairs = []
    for before, after, (places, seen) in zip(images[:-1], images[1:], matches, strict=True):
        warped = np.stack(
            [
                map_coordinates(before[..., band], places[:, seen], order=1, mode="nearest")
                for band in range(3)
            ],
            axis=-1,
        )
        pairs.append(float(np.abs(warped - after[seen]).mean()))
    return Flicker(float(np.mean(pairs)), tuple(pairs))


def _snapped(values: AnyArray) -> AnyArray:
    near = np.rint(values)
    return np.where(np.abs(values - near) < 1e-4, near, values)


def _refuse_collisions(scene: RenderScene, views: Sequence[View]) -> None:
    """Raise `InputError` if the straight way from the first to the last eye is blocked."""
    way = views[-1].eye - views[0].eye
    length = float(np.linalg.norm(way))
    if length == 0:
        return
    _, free = raycast.nearest(scene.geometry, views[0].eye, (way / length)[None], through=False)
    if free[0] < length + AIR:
        raise InputError(
            f"the camera of {views[0].view_id!r} would move {length:.2f} m, but something is in "
            f"its way after {float(free[0]):.2f} m; use fewer --frames, a smaller --step or "
            "another --move"
        )


def _sheet(images: dict[str, list[AnyArray]]) -> Picture:
    """First, middle and last frame of every method, a row each."""
    count = len(next(iter(images.values())))
    chosen = sorted({0, count // 2, count - 1})
    shown = [(name, i) for name in images for i in chosen]
    return contact_sheet(
        [to_bytes(images[name][i]) for name, i in shown],
        columns=len(chosen),
        labels=[f"{name}, frame {i}" for name, i in shown],
    )
