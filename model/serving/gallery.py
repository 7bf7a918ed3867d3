"""Pictures of one scene by all available methods, for cameras that a page asks for.

Scene and networks are loaded once and stay in memory.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from pbrnet.model.evaluation.inference import PREDICTABLE, Networks, load_networks
from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.evaluation.previews import PREVIEWS, RADIOSITY, Preview
from pbrnet.model.evaluation.selection import placed_view
from pbrnet.model.release.pretrained import find_models
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.pipeline.images import NOTHING, Picture, png_bytes, reflectance_picture
from pbrnet.pipeline.lenses.settings import STEEPEST
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.views import ImageParams, View, intrinsics_of
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.checked import param, shown, within
from pbrnet.scenes.contract import Room, Scene
from pbrnet.scenes.errors import InputError

SURFACES = "surfaces"  # the draft while the camera moves: reflectance, lit from the camera
TITLES = {**METHOD_TITLES, SURFACES: "Reflectance, lit from the camera", "denoised": "16 samples"}
EYE_HEIGHT = 1.55  # metres, of cameras in scenes without a camera file
_FROM_LIGHT = (RADIOSITY, "plus", "hybrid")  # need light transport, which scalar variants lack
_PLACE = within(-1e5, 1e5)
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Shot:
    """A picture that a page asks for: camera in world coordinates, method, size."""

    eye: Point = field(metadata=_PLACE)
    towards: Point = field(metadata=_PLACE)
    method: str
    width: int = param(320, "pixels", within(16, 1280))
    height: int = param(240, "pixels", within(16, 1280))


@dataclass(frozen=True)
class Shown:
    """PNG of a shot, seconds that it took, metres to the surface in its middle (0: not known)."""

    png: bytes
    seconds: float
    distance: float = 0.0


@dataclass(frozen=True)
class Gallery:
    """Pictures of a scene; `models`: folder of networks, None for the default folders."""

    renderer: ViewRenderer
    models: Path | None = None
    _loaded: dict[str, Networks] = field(default_factory=dict, init=False)

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """The methods that this machine and the trained networks allow, the draft first."""
        found = [SURFACES, *PREVIEWS]
        for method in PREDICTABLE:
            with suppress(InputError):
                found.append(find_models(self.models, method).method)
        paths = integrator.available()
        return tuple(method for method in found if paths or method not in _FROM_LIGHT)

    def draw(self, shot: Shot) -> Shown:
        """Draw a shot; raises `InputError` if its method or camera is impossible."""
        started = time.perf_counter()
        if shot.method not in self.methods:
            known = ", ".join(self.methods)
            raise InputError(f"method: {shown(shot.method)} is not one of {known}")
        half_fov_x = min(self.renderer.params.image.half_fov_x, STEEPEST)
        image = ImageParams(shot.width, shot.height, half_fov_x)
        scene = self.renderer.scene.scene.scene_id
        view = placed_view(scene, shot.eye, shot.towards, intrinsics_of(image))
        picture, distance = self._surfaces(view) if shot.method == SURFACES else (None, 0.0)
        if picture is None:
            picture = photograph(self._color(view, shot.method))
        return Shown(png_bytes(picture), time.perf_counter() - started, distance)

    def _surfaces(self, view: View) -> tuple[Picture, float]:
        """Draft of a view, and the distance to the surface in its middle."""
        frame = render_inputs(self.renderer.scene, view)
        facing = 0.35 + 0.65 * np.abs(frame["N.Z"])
        colors = np.stack([frame[f"albedo.{band}"] for band in "RGB"], axis=-1)
        picture = reflectance_picture(colors * facing[..., None])
        picture[frame["valid"] == 0] = NOTHING
        return picture, float(frame["Z"][view.height // 2, view.width // 2])

    def _color(self, view: View, method: str) -> Any:
        """Linear colour (H, W, 3) of a view."""
        if method in PREVIEWS:
            return Preview(self.renderer, method).render(view).color
        if method not in self._loaded:
            folder = find_models(self.models, method).folder
            self._loaded[method] = load_networks(folder, [method])
        networks = self._loaded[method]
        given = self.renderer.inputs(view, [networks.card])
        example = example_of(view, given, networks.card, None)
        return networks.radiance(example, networks.predict(method, example)).color


def cameras_of(scene: Scene, views: Sequence[View], bounds: Float64Array) -> list[dict[str, Any]]:
    """Cameras to begin with, as `name`, `eye`, `towards`: those views, or else one in each room,
    the largest first.

    Without rooms, one in the middle of the scene's `bounds` (2, 3), metres.
    """
    perspective = [view for view in views if view.lens.is_rectilinear]
    if perspective:
        return [_camera(view.view_id, view.eye, view.pose[:3, 2]) for view in perspective]
    largest_first = sorted(scene.rooms, key=lambda room: -Polygon(room.floor).area)
    found = [_in_room(room) for room in largest_first]
    return found or [_camera("middle", bounds.mean(axis=0), np.array([1.0, 0.0, 0.0]))]


def _in_room(room: Room) -> dict[str, Any]:
    """A camera inside a room's floor that looks to its farthest corner."""
    inside = Polygon(room.floor).representative_point()
    height = min(EYE_HEIGHT, 0.6 * (room.ceiling_z - room.floor_z))
    eye = np.array([inside.x, inside.y, room.floor_z + height])
    corners = np.array(room.floor) - eye[:2]
    corner = corners[np.argmax(np.linalg.norm(corners, axis=1))]
    return _camera(room.name or room.id, eye, np.append(corner / np.linalg.norm(corner), -0.2))


def _camera(name: str, eye: Float64Array, towards: Float64Array) -> dict[str, Any]:
    return {"name": name, "eye": eye.tolist(), "towards": towards.tolist()}
