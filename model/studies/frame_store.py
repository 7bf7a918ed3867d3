"""Frames that the studies render of a dataset's views, kept by fingerprint."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.model.data.reader import Dataset, Example, Split
from pbrnet.model.evaluation.evaluate import open_split
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.channels import TRUTHS, Kind
from pbrnet.pipeline.frames import (
    Channels,
    Frame,
    Result,
    frame_path,
    holds,
    read_frame,
    write_frame,
)
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.registry import frame_fingerprint, render, trace_seed
from pbrnet.pipeline.passes.settings import GroundTruthParams, IlluminationParams
from pbrnet.pipeline.render.scene import (
    RenderScene,
    free_memory,
    open_scene,
    renderer_version,
)
from pbrnet.pipeline.tonemap import ToneParams
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError

_TOLERANCE = 0.02  # largest relative difference of two panoramas of one scene


@dataclass(frozen=True)
class FrameStore:
    """Frames below `root`, rendered with the settings of their kinds and a root seed.

    A frame with another fingerprint is missing.
    """

    root: Path
    settings: Mapping[Kind, Any]
    seed: int

    def missing(self, view: View, digest: str, kinds: Sequence[Kind] = TRUTHS) -> list[Kind]:
        """Return the missing kinds of frames; `digest` identifies the scene and its light."""
        return [
            kind
            for kind in kinds
            if not holds(frame_path(self.root, kind, view), [self.fingerprint(kind, view, digest)])
        ]

    def render(self, scene: RenderScene, view: View, digest: str) -> None:
        """Path-trace shading and colour of the view and write both frames."""
        for kind, (channels, stats) in self.made(TRUTHS, scene, view).items():
            self.write(kind, channels, view, digest, **stats)

    def made(self, kinds: Sequence[Kind], scene: RenderScene, view: View) -> dict[Kind, Result]:
        """Render frames of one trace, without writing them."""
        settings = {kind: self.settings[kind] for kind in kinds}
        return render(scene, view, settings, trace_seed(kinds[0], view, self.seed))

    def write(
        self, kind: Kind, channels: Channels, view: View, digest: str, **stats: object
    ) -> None:
        """Write one frame; `stats` go into its metadata."""
        write_frame(
            frame_path(self.root, kind, view),
            kind,
            channels,
            view,
            **stats,
            seed=trace_seed(kind, view, self.seed),
            renderer=renderer_version(),
            fingerprint=self.fingerprint(kind, view, digest),
        )

    def read(self, kind: Kind, view: View) -> Frame:
        """Read a frame that exists."""
        return read_frame(frame_path(self.root, kind, view))

    def fingerprint(self, kind: Kind, view: View, digest: str) -> str:
        """Fingerprint of everything that determines a frame's pixels."""
        settings, renderer = self.settings[kind], renderer_version()
        return frame_fingerprint(kind, view, settings, self.seed, digest, renderer)


def with_samples(truth: GroundTruthParams, spp: int, denoise: bool) -> GroundTruthParams:
    """Return the parameters of ground truth with `spp` samples a pixel, denoised or not."""
    return truth.sampled(spp, "oidn" if denoise else "none")


@dataclass(frozen=True)
class StudyViews:
    """Views of the evaluated split that a study renders again, with networks to compare."""

    networks: Networks
    split: str
    examples: list[Example]
    views: list[View]
    scenes: dict[str, Scene]


def open_views(
    split: Split, tone: ToneParams, folders: Folders, methods: Sequence[str], count: int
) -> StudyViews:
    """Open at most `count` views at even distances in the split, and the networks of `methods`.

    Raises as `open_split`, and `InputError` for missing scenes or cameras.
    """
    networks, dataset = open_split(split, tone, folders, methods)
    examples = evenly_spread_views(dataset, count)
    scenes = {
        name: load_dataset_scene(folders.data, name) for name in {e.scene_id for e in examples}
    }
    views = cameras_of(folders.data, examples)
    return StudyViews(networks, dataset.split, examples, views, scenes)


def evenly_spread_views(dataset: Dataset, count: int) -> list[Example]:
    """Return at most `count` views at even distances in the split, so over all its scenes."""
    numbers = np.unique(np.linspace(0, len(dataset) - 1, min(count, len(dataset))).round())
    return list(dataset.at([int(number) for number in numbers]))


def load_dataset_scene(data: Path, scene_id: str) -> Scene:
    """Load the scene of a dataset row; raises `InputError` if its folder is missing."""
    folder = data / "scenes" / scene_id
    if not (folder / "scene.json").is_file():
        raise InputError(
            f"{folder}: no such scene. The study renders views of the dataset again and needs the "
            "scenes it was made from; make them with: pbrnet scenes"
        )
    return load_scene(folder)


@contextmanager
def opened_scene(scene: Scene) -> Iterator[RenderScene]:
    """Open a scene for rendering, and free the renderer's memory afterwards."""
    try:
        yield open_scene(scene)
    finally:
        free_memory()


def check_same_scene(
    scene: RenderScene, folder: Path, view: View, packed: AnyArray, params: IlluminationParams
) -> None:
    """Raise `InputError` unless the opened scene has the panorama that the dataset has.

    `folder`: folder of the scene, for the message; `packed`: panorama intensity of the view in the
    dataset, float32 (h, w).
    """
    made = render_illumination(scene, view, params)["intensity.Y"]
    if made.shape != packed.shape:
        raise InputError(
            f"illumination.width: {params.width}, but the dataset's panoramas are "
            f"{packed.shape[1]} pixels wide; use the parameters that the dataset was made with"
        )
    if np.abs(made - packed).sum() > _TOLERANCE * max(packed.sum(), 1e-12):
        raise InputError(
            f"{folder}: not the scene that the dataset was made from (the panorama of "
            f"{view.scene_id}/{view.view_id} differs); pack the dataset again: pbrnet dataset"
        )


def cameras_of(data: Path, examples: Iterable[Example]) -> list[View]:
    """Return the camera of every example, read from the camera files.

    Raises `InputError` if a camera file is missing or differs from the dataset.
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
        shape = example["depth"].shape
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
