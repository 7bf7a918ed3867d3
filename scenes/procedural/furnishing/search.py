"""Search for valid poses: against walls and on them, in corners, on the floor, on furniture."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from pbrnet.scenes.procedural.furnishing.space import (
    CONTACT_TOLERANCE,
    GAP,
    HEADROOM,
    SKIRTING_TOP,
    PlacedPiece,
    RoomSpace,
    corners_of,
    yaw_facing,
)
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import WallEdge
from pbrnet.scenes.procedural.scene_item import Pose
from pbrnet.scenes.seeds import Draw

_FLAT_DEPTH = 0.02  # metres; flatter items on a wall do not block walking
_APART = 0.01  # metres between things on one surface


def _first(tried: Iterable[PlacedPiece | None]) -> PlacedPiece | None:
    return next((item for item in tried if item is not None), None)


def _overlap(first: npt.NDArray, second: npt.NDArray) -> bool:
    """Test whether rectangles (2, 2) on one surface are nearer than things may stand."""
    low, high = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
    return bool((high - low > -_APART).all())


class SearchedSpace(RoomSpace):
    """Room whose poses are searched at random; each method tries poses until one is valid."""

    def wall_pose(self, piece: FurniturePiece, edge: WallEdge, s: float, z: float = 0.0) -> Pose:
        """Return the pose with the back to the wall and the origin `s` metres along it."""
        back = 0.0 if piece.anchor == "on_wall" else float(piece.bounds[1, 1]) + GAP
        x, y = edge.at(s, back)
        return Pose(x, y, z, yaw_facing(edge.inward))

    def along_walls(
        self,
        rng: Draw,
        piece: FurniturePiece,
        edges: Iterable[WallEdge] | None = None,
        where: str = "any",
        step: float = 0.15,
    ) -> list[tuple[WallEdge, float]]:
        """Return positions (edge, s) along walls in random order.

        `where` "corner" or "middle" prefers positions near corners or wall centres.
        """
        low, high = piece.bounds[:, 0]
        half = 0.5 * float(high - low)
        margin = GAP if piece.mount_height < SKIRTING_TOP else CONTACT_TOLERANCE
        places = []
        for edge in self.room.edges if edges is None else edges:
            first, last = half + margin, edge.length - half - margin
            if last < first:
                continue
            for s in np.linspace(first, last, max(1, int((last - first) / step) + 1)):
                rank = 0.0
                if where == "corner":
                    rank = float(min(s - first, last - s))
                elif where == "middle":
                    rank = float(abs(s - edge.length / 2) / edge.length)
                # The x axis of the piece points against the direction of the wall.
                places.append((rank + 0.4 * rng.random(), edge, float(s + 0.5 * (low + high))))
        places.sort(key=lambda place: place[0])
        return [(edge, s) for _, edge, s in places]

    def against_wall(
        self,
        rng: Draw,
        kind: str,
        piece: FurniturePiece,
        *,
        edges: Iterable[WallEdge] | None = None,
        where: str = "any",
        zone: bool = True,
        tries: int = 60,
    ) -> PlacedPiece | None:
        """Place a piece with its back to a wall."""
        return _first(
            self.try_place(kind, piece, self.wall_pose(piece, edge, s), zone=zone)
            for edge, s in self.along_walls(rng, piece, edges, where)[:tries]
        )

    def on_wall(
        self, rng: Draw, kind: str, piece: FurniturePiece, *, where: str = "any", tries: int = 30
    ) -> PlacedPiece | None:
        """Hang a piece on a wall at its mounting height."""
        return _first(
            self.hang(kind, piece, edge, s, piece.mount_height)
            for edge, s in self.along_walls(rng, piece, where=where)[:tries]
        )

    def hang(
        self, kind: str, piece: FurniturePiece, edge: WallEdge, s: float, z: float
    ) -> PlacedPiece | None:
        """Hang a piece on a wall, `s` metres along it at height `z`."""
        low = piece.bounds[0]
        walked = float(low[2]) + z < HEADROOM and float(low[1]) < -_FLAT_DEPTH
        pose = self.wall_pose(piece, edge, s, z)
        return self.try_place(kind, piece, pose, zone=False, on_floor=walked)

    def in_corner(
        self, rng: Draw, kind: str, piece: FurniturePiece, turned: bool = True
    ) -> PlacedPiece | None:
        """Place a piece in a corner of the room, at a random quarter turn if `turned`."""
        extent = float(np.abs(piece.bounds[:, :2]).max()) + GAP
        edges = self.room.edges
        corners = [
            (before, after)
            for before, after in zip(edges, edges[1:] + edges[:1], strict=True)
            if before.along[0] * after.along[1] - before.along[1] * after.along[0] > 0
        ]
        for before, after in rng.shuffled(corners):
            away = extent + rng.between(0.0, 0.06)
            x = after.start[0] + away * (after.inward[0] + before.inward[0])
            y = after.start[1] + away * (after.inward[1] + before.inward[1])
            turn = yaw_facing(after.inward) + (90.0 * rng.whole(4) if turned else 0.0)
            item = self.try_place(kind, piece, Pose(x, y, 0.0, turn), zone=False)
            if item is not None:
                return item
        return None

    def anywhere(
        self, rng: Draw, kind: str, piece: FurniturePiece, *, tries: int = 40
    ) -> PlacedPiece | None:
        """Place a piece at a random position on the floor."""
        x0, y0, x1, y1 = self.shape.bounds
        poses = (
            Pose(rng.between(x0, x1), rng.between(y0, y1), 0.0, 90.0 * rng.whole(4))
            for _ in range(tries)
        )
        return _first(self.try_place(kind, piece, pose) for pose in poses)

    def on_top(
        self,
        rng: Draw,
        kind: str,
        piece: FurniturePiece,
        carrier: PlacedPiece,
        *,
        centre: bool = False,
        yaw: float = 0.0,
        tries: int = 12,
    ) -> PlacedPiece | None:
        """Place a piece on a support surface of `carrier`, clear of other objects there."""
        turned = Pose(0.0, 0.0, 0.0, yaw).apply(corners_of(piece.bounds))
        low, high = turned.min(axis=0), turned.max(axis=0)
        surfaces = list(zip(carrier.piece.surfaces, carrier.occupied, strict=True))
        for place, occupied in rng.shuffled(surfaces):
            room_x = place.half_x - 0.5 * (high[0] - low[0])
            room_y = place.half_y - 0.5 * (high[1] - low[1])
            if room_x < -1e-6 or room_y < -1e-6 or high[2] - low[2] > place.headroom:
                continue
            for _ in range(1 if centre else tries):
                dx, dy = (0.0, 0.0) if centre else rng.uniform(-1, 1, 2) * (room_x, room_y)
                x = place.x + dx - 0.5 * (low[0] + high[0])
                y = place.y + dy - 0.5 * (low[1] + high[1])
                rect = np.array([[x + low[0], y + low[1]], [x + high[0], y + high[1]]])
                if any(_overlap(rect, other) for other in occupied):
                    continue
                at = carrier.pose.apply(np.array([[x, y, place.z]]))[0].tolist()
                pose = Pose(at[0], at[1], at[2], (carrier.pose.yaw + yaw) % 360)
                item = self.try_place(
                    kind, piece, pose, zone=False, touching=(carrier.id,), on_floor=False
                )
                if item is not None:
                    occupied.append(rect)
                    return item
        return None
