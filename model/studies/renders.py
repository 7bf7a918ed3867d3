"""What the studies render of a dataset's views, kept by fingerprint: no frame is made twice."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from model.data.reader import Dataset, Example
from pipeline.channels import Kind
from pipeline.frames import Channels, Frame, frame_path, holds, read_frame, write_frame
from pipeline.params import Params
from pipeline.passes.illumination import render_illumination
from pipeline.passes.registry import TRUTHS, camera_of, frame_fingerprint, pass_seed, render_truths
from pipeline.render.scene import RenderScene, renderer_version
from pipeline.views import View, load_cameras
from scenes.arrays import AnyArray
from scenes.contract import Scene, load_scene
from scenes.errors import InputError

_SAME = 0.02  # relative difference of two panoramas of one scene, at most


@dataclass(frozen=True)
class Renders:
    """Shading and colour frames below a folder of their own, by the parameters given."""

    root: Path
    params: Params

    def missing(self, view: View, digest: str, kinds: Sequence[Kind] = TRUTHS) -> list[Kind]:
        """Frames of the view that are not there; `digest` is that of the scene in its light."""
        return [
            kind
            for kind in kinds
            if not holds(frame_path(self.root, kind, view), self.mark(kind, view, digest))
        ]

    def render(self, scene: RenderScene, view: View, digest: str) -> None:
        """Trace both truths of the view and write them."""
        for kind, (channels, stats) in render_truths(
            scene, view, self.params, pass_seed("color", view, self.params.seed)
        ).items():
            self.write(kind, channels, view, digest, **stats)

    def write(
        self, kind: Kind, channels: Channels, view: View, digest: str, **stats: object
    ) -> None:
        """Keep one frame."""
        write_frame(
            frame_path(self.root, kind, view),
            kind,
            channels,
            camera_of(view),
            **stats,
            seed=pass_seed(kind, view, self.params.seed),
            renderer=renderer_version(),
            fingerprint=self.mark(kind, view, digest),
        )

    def read(self, kind: Kind, view: View) -> Frame:
        """A frame that is there."""
        return read_frame(frame_path(self.root, kind, view))

    def mark(self, kind: Kind, view: View, digest: str) -> str:
        """The fingerprint of all that determines a frame's pixels."""
        return frame_fingerprint(kind, view, self.params, digest, renderer_version())


def with_samples(params: Params, spp: int, denoise: bool) -> Params:
    """The same, with so many samples a pixel for every truth, denoised or not."""
    truth = params.groundtruth
    block = next(size for size in range(min(truth.block_spp, spp), 0, -1) if spp % size == 0)
    truth = replace(
        truth, spp=spp, block_spp=block, noise=0.0, denoise="oidn" if denoise else "none"
    )
    return replace(params, groundtruth=truth)


def spread_over(dataset: Dataset, count: int) -> list[Example]:
    """At most `count` views, spread evenly over the split's rows, so over its scenes."""
    numbers = np.unique(np.linspace(0, len(dataset) - 1, min(count, len(dataset))).round())
    return list(dataset.at([int(number) for number in numbers]))


def scene_of(data: Path, scene_id: str) -> Scene:
    """The scene of a dataset's row; `InputError` says how to get it."""
    folder = data / "scenes" / scene_id
    if not (folder / "scene.json").is_file():
        raise InputError(
            f"{folder}: no such scene, but the dataset has views of it; the study renders them "
            "anew, so bring the scenes the dataset was made of: pbrnet scenes"
        )
    return load_scene(folder)


def refuse_other_scene(
    opened: RenderScene, folder: Path, view: View, packed: AnyArray, params: Params
) -> None:
    """Raise `InputError` unless the opened scene, that in `folder`, is the dataset's.

    `packed`: what the dataset has as the view's panorama, its intensity, float32 (h, w).
    """
    made = render_illumination(opened, view, params.illumination)["intensity.Y"]
    if made.shape != packed.shape:
        raise InputError(
            f"illumination.width: {params.illumination.width}, but the dataset's panoramas are "
            f"{packed.shape[1]} pixels wide; take the parameters that it was made with"
        )
    if np.abs(made - packed).sum() > _SAME * max(packed.sum(), 1e-12):
        raise InputError(
            f"{folder}: not the scene that the dataset was made of (the panorama of "
            f"{view.scene_id}/{view.view_id} is another); pack it again with: pbrnet dataset"
        )


def views_of(data: Path, examples: Iterable[Example]) -> list[View]:
    """The camera of every example, from the camera files.

    Raises `InputError` if a camera file is missing, or has another camera than the dataset.
    """
    known: dict[str, dict[str, View]] = {}
    found = []
    for example in examples:
        path = data / "cameras" / f"{example.scene_id}.json"
        if example.scene_id not in known:
            if not path.is_file():
                raise InputError(f"{path}: no such camera file; make it with: pbrnet cameras")
            views = load_cameras(path).views
            known[example.scene_id] = {view.view_id: view for view in views}
        view = known[example.scene_id].get(example.view_id)
        shape = example.depth.shape
        if (
            view is None
            or (view.height, view.width) != shape
            or not np.allclose(view.intrinsics, example.intrinsics)
        ):
            raise InputError(
                f"{path}: not the cameras that the dataset was made with ({example.name} is "
                "missing or different); pack it again with: pbrnet dataset"
            )
        found.append(view)
    return found
