"""Parameters of view sampling."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from pbrnet.pipeline.lenses.model import WIDEST
from pbrnet.pipeline.views import ImageParams
from pbrnet.scenes.checked import OPTIONAL, param, within


@dataclass(frozen=True)
class TrajectoryFile:
    """A file of camera poses, see `cameras.trajectory_files`, and the scene's id."""

    scene: str
    file: str


@dataclass(frozen=True)
class RoomShare:
    """Share of the rooms of a type that get views, drawn for each room by itself."""

    type: str
    share: float = param(1.0, "", within(0, 1))


@dataclass(frozen=True)
class CameraParams:
    """View sampling after PBRS (Zhang et al. 2017), with a clearance test.

    `half_fov_x`, `pitch` and `roll` are ranges, [least, most], from which values are drawn evenly.
    """

    views_per_room: int = param(2, "maximum views per room", within(1, 64))
    views_per_scene: int = param(5, "maximum views per scene", within(1, 1024))
    grid: float = param(
        0.25, "metres between candidates, jittered within the cell", within(0.05, 5)
    )
    eye_height: float = param(1.45, "metres above the floor (PBRS: 1.55)", within(0.2, 3))
    eye_jitter: float = param(0.2, "metres, variation up and down (PBRS: 0.05)", within(0, 1.5))
    tilt: float = param(
        -0.2, "z of the view direction before normalisation, as in PBRS", within(-2, 2)
    )
    half_fov_x: tuple[float, ...] = param(
        (),
        "radians, [min, max] drawn per room and sector; []: image.half_fov_x",
        within(0.05, WIDEST),
    )
    pitch: tuple[float, ...] = param(
        (-0.3, 0.08),
        "radians above the horizon, [min, max] drawn per candidate; []: tilt",
        within(-1.4, 1.4),
    )
    roll: tuple[float, ...] = param(
        (-0.03, 0.03),
        "radians clockwise, [min, max] drawn per candidate; []: none",
        within(-math.pi, math.pi),
    )
    sectors: int = param(
        6, "sectors of directions; at most one view per room and sector", within(1, 36)
    )
    min_objects: int = param(3, "minimum number of counted objects per view", within(0, 100))
    min_coverage: float = param(
        0.01, "minimum share of the pixels for an object to count", within(0, 1)
    )
    min_score: float = param(0.0, "minimum score of a view", within(0))
    clearance: float = param(0.1, "metres around the eye without any surface", within(0, 2))
    near: float = param(
        0.8, "metres; a view is blocked if a share above max_near is nearer", within(0, 10)
    )
    max_near: float = param(0.2, "maximum share of pixels nearer than near", within(0, 1))
    min_own: float = param(
        0.5, "minimum share of the counted objects in the camera's own room", within(0, 1)
    )
    max_alike: float = param(
        0.6, "maximum overlap of furniture pixels between two views of a room", within(0, 1)
    )
    stored_views: bool = param(True, "keep the cameras of imported scenes")
    outside_views: bool = param(False, "also keep those outside all rooms")
    # Not optional: fingerprints of before it existed stood for `paper`.
    framing: Literal["paper", "photograph"] = param(
        "photograph", "photograph: no dominating walls or lamps, rule of thirds; or paper"
    )
    room_shares: tuple[RoomShare, ...] = param(
        (), "{type: kitchen, share: 0.5}: this share of the kitchens gets views", OPTIONAL
    )
    id_width: int = param(80, "pixels, width of the candidates' id images", within(16, 640))
    candidates: int = param(12, "candidates per room and sector", within(1, 4096))
    every_room: bool = param(
        False, "search rooms without views again: more candidates, then looser rules", OPTIONAL
    )
    walks: int = param(0, "camera walks per scene, each a video; 0: none", within(0, 64), OPTIONAL)
    walk_frames: int = param(24, "frames of a walk", within(2, 240), OPTIONAL)
    walk_step: float = param(0.06, "metres, maximum between frames", within(0.005, 0.5), OPTIONAL)
    walk_turn: float = param(0.05, "radians, maximum between frames", within(0.005, 0.5), OPTIONAL)
    stereo_baseline: float = param(
        0.0, "metres to a right stereo partner of each view; 0: none", within(0, 2), OPTIONAL
    )
    overlap_views: int = param(
        0, "views per overlapping set, one set per room; 0: none", within(0, 16), OPTIONAL
    )
    overlap: float = param(0.5, "minimum median overlap of its pairs", within(0.05, 0.95), OPTIONAL)
    share_cameras: bool = param(
        False, "use the same cameras in all scenes of a plan, where they fit", OPTIONAL
    )
    trajectories: tuple[TrajectoryFile, ...] = param(
        (), "{scene: ID, file: PATH}; JSON or TUM format, see docs/cameras.md", OPTIONAL
    )
    collisions: Literal["reject", "warn", "accept"] = param(
        "warn", "warn, reject or accept trajectories that touch or cross surfaces", OPTIONAL
    )

    def share_of(self, room_type: str) -> float:
        """Return the share of the rooms of a type that get views."""
        return next((each.share for each in self.room_shares if each.type == room_type), 1.0)

    def most_views(self, scenes: int = 1, stored: int = 0) -> int:
        """Most views of scenes with so many stored cameras, without trajectories."""
        single = scenes * self.views_per_scene + (stored if self.stored_views else 0)
        views = single * max(1, self.overlap_views)  # each may begin a set
        views += scenes * self.walks * self.walk_frames
        return 2 * views if self.stereo_baseline else views

    @property
    def has_links(self) -> bool:
        """True if some views belong together: in trajectories, pairs, sets, or across a plan."""
        return bool(
            self.walks
            or self.trajectories
            or self.stereo_baseline
            or self.overlap_views
            or self.share_cameras
        )

    def verify(self, where: str) -> None:
        """Raise ValueError for a set of one view, or a range that is not two ascending numbers."""
        if self.overlap_views == 1:
            raise ValueError(f"{where}.overlap_views: 1; a set has at least 2 views, or 0: none")
        for name in ("half_fov_x", "pitch", "roll"):
            bounds = getattr(self, name)
            if bounds and (len(bounds) != 2 or bounds[0] > bounds[1]):
                raise ValueError(f"{where}.{name}: {list(bounds)}; a range is [least, most], or []")


@dataclass(frozen=True)
class ViewParams:
    """The sections that decide which views a scene has."""

    cameras: CameraParams
    image: ImageParams

    @property
    def without_files(self) -> ViewParams:
        """The same without trajectories: a scene gets the content of its own."""
        return replace(self, cameras=replace(self.cameras, trajectories=()))
