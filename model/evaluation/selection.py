"""Selection of the views that `pbrnet predict` draws: of scenes and camera files, or of frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pbrnet.model.evaluation.predict import ViewSource, from_frames
from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.views import ImageParams, View, as_matrix, intrinsics_of, load_cameras, look
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import exists

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Selected:
    """Views of scenes, the scenes' folders by id, and messages by what cannot be used."""

    views: Sequence[View] = ()
    folders: Mapping[str, Path] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FromScenes:
    """Views of scene folders: those named VIEW or SCENE/VIEW, without names all, or a new one.

    `cameras` is a camera file, or a folder of files SCENE.json; by default that of the data folder.
    `placed`, position and direction in world metres, is the new camera of the only scene.
    """

    scenes: Sequence[Path]
    views: Sequence[str] = ()
    cameras: Path | None = None
    size: tuple[int, int] | None = None
    placed: tuple[Point, Point] | None = None

    def select(self, data: Path, image: ImageParams) -> Selected:
        """Select the views; of several scenes, those without are named and left out.

        Raises `InputError` if nothing is left, or two scenes have one id.
        """
        wanted = [(scene, name) for scene in self.scenes for name in self._names_in(scene)]
        views: list[View] = []
        folders: dict[str, Path] = {}
        failed: dict[str, str] = {}
        for scene, name in wanted or [(scene, "") for scene in self.scenes]:
            try:
                found = self._views_of(scene, name, data, image)
            except InputError as error:
                if len(self.scenes) == 1:
                    raise
                failed[f"{scene.name}/{name}" if name else scene.name] = str(error)
                continue
            if folders.setdefault(found[0].scene_id, scene) != scene:
                raise InputError(f"{folders[found[0].scene_id]} and {scene} have the same scene id")
            views += found
        if not views:
            raise InputError(*(f"{what}: {message}" for what, message in failed.items()))
        return Selected(views, folders, failed)

    def _names_in(self, scene: Path) -> list[str]:
        """Names of views that select one of this scene."""
        pairs = [view.rpartition("/") for view in self.views]
        return list(dict.fromkeys(view for of, _, view in pairs if of in ("", scene.name)))

    def _views_of(self, scene: Path, name: str, data: Path, image: ImageParams) -> list[View]:
        """The view of this name, all views, or the new camera of a scene."""
        if self.placed is not None:
            if self.size:
                image = replace(image, width=self.size[0], height=self.size[1])
            if not image.is_pinhole:
                raise InputError(
                    f"--eye: image.projection is {image.projection}; pictures by networks need "
                    "perspective without distortion"
                )
            scene_id = load_scene(scene).scene_id
            return [placed_view(scene_id, *self.placed, intrinsics_of(image))]
        cameras = self.cameras or data / "cameras"
        if self.cameras is None or cameras.is_dir():
            cameras /= f"{scene.name}.json"
        return find_views(scene, cameras, [name] if name else [], self.size)


@dataclass(frozen=True)
class FromFrames:
    """Frames of a view by kind, or folders of frames; some may lie beside the panorama."""

    inputs: Path
    illumination: Path
    transport: Path | None = None
    materials: Path | None = None
    noisy: Path | None = None

    def select(self, truth: Path | None) -> list[ViewSource]:
        """Select the views; `truth` is the data folder to read their true images from."""
        given: dict[Kind, Path | None] = {
            "inputs": self.inputs,
            "illumination": self.illumination,
            "transport": self.transport or _beside(self.illumination, "transport"),
            "materials": self.materials or _beside(self.illumination, "materials"),
            "visibility": _beside(self.illumination, "visibility"),
            "noisy": self.noisy,
        }
        paths = {kind: path for kind, path in given.items() if path}
        return [
            from_frames(dict(zip(paths, files, strict=True)), truth)
            for files in frame_sets(*paths.values())
        ]


def _beside(illumination: Path, kind: str) -> Path | None:
    """Frames of the same views and another kind: `kind` instead of `illumination` in the path.

    None if there are none.
    """
    parts = illumination.parts
    if "illumination" not in parts:
        return None
    place = len(parts) - 1 - parts[::-1].index("illumination")
    found = Path(*parts[:place], kind, *parts[place + 1 :])
    exists = any(found.rglob("*.exr")) if found.is_dir() else found.is_file()
    return found if exists else None


def frame_sets(inputs: Path, *others: Path) -> list[tuple[Path, ...]]:
    """Sets of frames with the same relative path in these folders; for files, the files themselves.

    Raises `InputError` if there are none, or if a frame is missing in one of the folders.
    """
    if not any(path.is_dir() for path in (inputs, *others)):
        return [(inputs, *others)]
    for folder in (inputs, *others):
        if not folder.is_dir():
            raise InputError(f"{folder}: not a folder; give folders or files, not both")
    names = sorted(path.relative_to(inputs) for path in inputs.rglob("*.exr"))
    if not names:
        raise InputError(f"{inputs}: no .exr frames in this folder")
    for folder in others:
        missing = [name for name in names if not (folder / name).is_file()]
        if missing:
            raise InputError(
                f"{folder / missing[0]}: missing, but there is {inputs / missing[0]}"
                + (f", and {len(missing) - 1} more" if len(missing) > 1 else "")
                + "; render them with: pbrnet illumination"
                + (", pbrnet inputs, pbrnet groundtruth" if folder != others[0] else "")
            )
    return [(inputs / name, *(folder / name for folder in others)) for name in names]


def find_views(
    scene: Path, cameras: Path, names: Sequence[str], size: tuple[int, int] | None
) -> list[View]:
    """The named views of a camera file, or all of them, resized to `size` (width, height).

    Raises `InputError` for an unknown view, and for a camera file that is missing or of another
    scene.
    """
    scene_id = load_scene(scene).scene_id
    if not exists(cameras):
        raise InputError(
            f"{cameras}: no cameras of {scene_id} yet; sample them with: pbrnet cameras, or give "
            "--eye and --towards"
        )
    views = load_cameras(cameras).views
    found = []
    for name in names or [view.view_id for view in views]:
        view = next((view for view in views if view.view_id == name), None)
        if view is None:
            raise InputError(f"{cameras}: no view {name!r} (there are: {_named(views)})")
        found.append(resized(view, size) if size else view)
    if not found:
        raise InputError(f"{cameras}: contains no views")
    if found[0].scene_id != scene_id:
        raise InputError(f"{cameras}: cameras of {found[0].scene_id!r}, not of the scene {scene}")
    return found


def _named(views: Iterable[View]) -> str:
    """Names of views; of a walk or another trajectory, the first and the last."""
    names: dict[str, list[str]] = {}
    for view in views:
        names.setdefault(view.trajectory or view.view_id, []).append(view.view_id)
    return ", ".join(" to ".join(dict.fromkeys((of[0], of[-1]))) for of in names.values()) or "none"


def placed_view(scene_id: str, eye: Point, towards: Point, intrinsics: AnyArray) -> View:
    """View with the name `camera` from a position and a direction, world, metres.

    The centre of the image is the principal point. Raises `InputError` for a camera that looks
    straight up or down.
    """
    if np.linalg.norm(np.cross(towards, (0, 0, 1))) < 1e-6 * np.linalg.norm(towards) + 1e-12:
        raise InputError("a camera that looks straight up or down has no up vector; tilt it a bit")
    width, height = (round(float(2 * side)) for side in intrinsics[:2, 2])
    pose = look(eye, towards)
    return View(scene_id, "camera", width, height, as_matrix(intrinsics), as_matrix(pose))


def resized(view: View, size: tuple[int, int]) -> View:
    """The same camera with (width, height) pixels; they stay square.

    The horizontal field of view is kept, the vertical one follows from the aspect ratio.
    """
    width, height = size
    scale = width / view.width
    camera = view.intrinsics
    camera[:2] *= scale
    camera[1, 2] += 0.5 * (height - scale * view.height)
    return replace(view, width=width, height=height, K=as_matrix(camera))
