"""Builder that collects meshes into the parts of a furniture piece."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pbrnet.scenes.assets.free_space import SupportSurface
from pbrnet.scenes.contract import Box, Joint, Point3
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.procedural.furniture.materials import SCREEN
from pbrnet.scenes.procedural.furniture.parts.geometry import Axis, BodyMesh, merge
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import (
    Anchor,
    Contained,
    FurniturePiece,
    Material,
    PiecePart,
    shifted,
)
from pbrnet.scenes.seeds import Draw

WIDEST = 90.0  # degrees that doors open, unless they stand open wider


class Shown(NamedTuple):
    """Picture of a display: mean luminance, candelas a square metre, and seed of the picture."""

    luminance: float
    picture: int


class Print(NamedTuple):
    """A part of a printed paper of the home, of a size and with a corner in its uvs."""

    paper: Material
    size: tuple[float, ...]
    corner: tuple[float, ...]

    @staticmethod
    def draw(draw: Draw, style: Style) -> Print:
        """Draw a paper and a part of it."""
        size = draw.uniform(0.25, 0.6, 2)
        corner = draw.uniform(0, 1 - size)
        return Print(draw.pick(style.prints), tuple(size.tolist()), tuple(corner.tolist()))

    def on(self, mesh: BodyMesh) -> BodyMesh:
        """The mesh with the uvs of the part."""
        low, size = mesh.uvs.min(axis=0), np.maximum(np.ptp(mesh.uvs, axis=0), 1e-6)
        uvs = (mesh.uvs - low) / size * np.array(self.size) + np.array(self.corner)
        return BodyMesh(mesh.vertices, mesh.faces, uvs, mesh.smooth)


Skin = Material | Print


@dataclass
class Builder:
    """Collects meshes; meshes of the same material and lamp become one part of the piece."""

    name: str
    category: str
    anchor: Anchor
    front_clearance: float = 0.0
    side_clearance: float = 0.0
    mount_height: float = 0.0
    surfaces: list[SupportSurface] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    _groups: dict[tuple[str, Material, bool, float, float, Contained | None], list[BodyMesh]] = (
        field(default_factory=dict)
    )
    _own: Contained | None = None
    _displays: list[PiecePart] = field(default_factory=list)

    def add(
        self,
        skin: Skin,
        *meshes: BodyMesh,
        name: str = "",
        lumens: float = 0.0,
        kelvin: float = 2800.0,
    ) -> None:
        """Add meshes of a material or print; the part's name defaults to the material's kind."""
        material = skin.paper if isinstance(skin, Print) else skin
        for mesh in meshes:
            key = (name or material.kind, material, mesh.smooth, lumens, kelvin, self._own)
            own = skin.on(mesh) if isinstance(skin, Print) else mesh
            self._groups.setdefault(key, []).append(own)

    @contextmanager
    def holding(self, name: str, category: str) -> Iterator[None]:
        """Context in which what is added is a thing that the piece holds, an object of its own."""
        outer, self._own = self._own, Contained(name, category)
        try:
            yield
        finally:
            self._own = outer

    def add_from(self, other: Builder, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """Add all meshes of another builder, translated by metres.

        What the other holds stays an object of its own.
        """
        for (name, material, smooth, lumens, kelvin, own), meshes in other._groups.items():
            key = (name, material, smooth, lumens, kelvin, own or self._own)
            self._groups.setdefault(key, []).extend(mesh.moved(x, y, z) for mesh in meshes)
        self.joints += [shifted(joint, x, y, z) for joint in other.joints]

    def turned(self, axis: Axis, degrees: float) -> Builder:
        """Return a builder with all meshes rotated about an axis through the origin."""
        other = Builder(self.name, self.category, self.anchor)
        for key, meshes in self._groups.items():
            other._groups[key] = [mesh.turned(axis, degrees) for mesh in meshes]
        return other

    def ground(self) -> None:
        """Move all meshes so that the lowest point is at z = 0."""
        groups = self._groups.values()
        self.move(z=-min(float(mesh.vertices[:, 2].min()) for each in groups for mesh in each))

    def move(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """Translate all meshes by metres."""
        for key, meshes in self._groups.items():
            self._groups[key] = [mesh.moved(x, y, z) for mesh in meshes]
        self.joints = [shifted(joint, x, y, z) for joint in self.joints]

    def show(self, mesh: BodyMesh, shown: Shown) -> None:
        """Add a display, a one-sided mesh with uvs [0, 1], that shows something."""
        area = float(face_areas(mesh.vertices[mesh.faces])[0].sum())
        lumens = round(np.pi * shown.luminance * area, 1)
        surface = (mesh.vertices, mesh.faces, mesh.uvs, SCREEN)
        self._displays.append(
            PiecePart("display", *surface, lumens=lumens, kelvin=6500.0, picture=shown.picture)
        )

    def surface(
        self, x: float, y: float, z: float, half_x: float, half_y: float, headroom: float = 10.0
    ) -> None:
        """Add a support surface for other pieces, metres."""
        self.surfaces.append(SupportSurface(x, y, z, half_x, half_y, headroom))

    def hinge(self, pivot: Point3, axis: Point3, angle: float, *boxes: Box) -> None:
        """Add a hinge, open by `angle` degrees; see `Joint` for axis and boxes."""
        limits = (0.0, max(WIDEST, angle))
        self.joints.append(Joint("", "hinge", pivot, axis, limits, angle, boxes))

    def piece(self) -> FurniturePiece:
        """Return the finished piece; its part names are unique."""
        used: Counter[str] = Counter()
        parts = []
        for (name, material, smooth, lumens, kelvin, own), meshes in self._groups.items():
            used[name] += 1
            mesh = merge(meshes)
            parts.append(
                PiecePart(
                    name if used[name] == 1 else f"{name}_{used[name]}",
                    np.ascontiguousarray(mesh.vertices),
                    np.ascontiguousarray(mesh.faces),
                    np.ascontiguousarray(mesh.uvs),
                    material,
                    smooth,
                    lumens,
                    kelvin,
                    own=own,
                )
            )
        return FurniturePiece(
            name=self.name,
            category=self.category,
            parts=(*parts, *self._displays),
            anchor=self.anchor,
            front_clearance=self.front_clearance,
            side_clearance=self.side_clearance,
            surfaces=tuple(self.surfaces),
            mount_height=self.mount_height,
            joints=tuple(self.joints),
        )
