"""Builder that collects meshes into the parts of a furniture piece."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from pbrnet.scenes.assets.free_space import SupportSurface
from pbrnet.scenes.procedural.furniture.parts.geometry import Axis, BodyMesh, merge
from pbrnet.scenes.procedural.piece import Anchor, Contained, FurniturePiece, Material, PiecePart


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
    _groups: dict[tuple[str, Material, bool, float, float, Contained | None], list[BodyMesh]] = (
        field(default_factory=dict)
    )
    _own: Contained | None = None

    def add(
        self,
        material: Material,
        *meshes: BodyMesh,
        name: str = "",
        lumens: float = 0.0,
        kelvin: float = 2800.0,
    ) -> None:
        """Add meshes of a material; the part's name defaults to the kind of the material."""
        for mesh in meshes:
            key = (name or material.kind, material, mesh.smooth, lumens, kelvin, self._own)
            self._groups.setdefault(key, []).append(mesh)

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

    def turned(self, axis: Axis, degrees: float) -> Builder:
        """Return a builder with all meshes rotated about an axis through the origin."""
        other = Builder(self.name, self.category, self.anchor)
        for key, meshes in self._groups.items():
            other._groups[key] = [mesh.turned(axis, degrees) for mesh in meshes]
        return other

    def grounded(self) -> Builder:
        """Return a builder with all meshes moved so that the lowest point is at z = 0."""
        other = Builder(self.name, self.category, self.anchor)
        low = min(
            float(mesh.vertices[:, 2].min()) for each in self._groups.values() for mesh in each
        )
        other.add_from(self, z=-low)
        return other

    def surface(
        self,
        x: float,
        y: float,
        z: float,
        half_x: float,
        half_y: float,
        headroom: float = 10.0,
    ) -> None:
        """Add a support surface for other pieces, metres."""
        self.surfaces.append(SupportSurface(x, y, z, half_x, half_y, headroom))

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
            parts=tuple(parts),
            anchor=self.anchor,
            front_clearance=self.front_clearance,
            side_clearance=self.side_clearance,
            surfaces=tuple(self.surfaces),
            mount_height=self.mount_height,
        )
