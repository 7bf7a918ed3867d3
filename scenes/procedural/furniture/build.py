"""Collecting meshes into the parts of a piece."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from scenes.procedural.furniture.geometry import Axis, Mesh, merge
from scenes.procedural.piece import Anchor, Material, Part, Piece, Surface


@dataclass
class Builder:
    """Gathers meshes; those of one material (and lamp) become one part of the piece."""

    name: str
    category: str
    anchor: Anchor
    front_clearance: float = 0.0
    side_clearance: float = 0.0
    mount_height: float = 0.0
    surfaces: list[Surface] = field(default_factory=list)
    _groups: dict[tuple[str, Material, bool, float, float], list[Mesh]] = field(
        default_factory=dict
    )

    def add(
        self,
        material: Material,
        *meshes: Mesh,
        name: str = "",
        lumens: float = 0.0,
        kelvin: float = 2800.0,
    ) -> None:
        """Add bodies; `name` says what they are where the material's kind would not."""
        for mesh in meshes:
            key = (name or material.kind, material, mesh.smooth, lumens, kelvin)
            self._groups.setdefault(key, []).append(mesh)

    def take(self, other: Builder, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """Take over what `other` gathered, shifted."""
        for key, meshes in other._groups.items():
            self._groups.setdefault(key, []).extend(mesh.moved(x, y, z) for mesh in meshes)

    def turned(self, axis: Axis, degrees: float) -> Builder:
        """What was gathered, rotated about an axis through the origin."""
        other = Builder(self.name, self.category, self.anchor)
        for key, meshes in self._groups.items():
            other._groups[key] = [mesh.turned(axis, degrees) for mesh in meshes]
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
        """Declare a place where other pieces may stand."""
        self.surfaces.append(Surface(x, y, z, half_x, half_y, headroom))

    def piece(self) -> Piece:
        """The finished piece; part names are unique in it."""
        used: Counter[str] = Counter()
        parts = []
        for (name, material, smooth, lumens, kelvin), meshes in self._groups.items():
            used[name] += 1
            mesh = merge(meshes)
            parts.append(
                Part(
                    name if used[name] == 1 else f"{name}_{used[name]}",
                    np.ascontiguousarray(mesh.vertices),
                    np.ascontiguousarray(mesh.faces),
                    np.ascontiguousarray(mesh.uvs),
                    material,
                    smooth,
                    lumens,
                    kelvin,
                )
            )
        return Piece(
            name=self.name,
            category=self.category,
            parts=tuple(parts),
            anchor=self.anchor,
            front_clearance=self.front_clearance,
            side_clearance=self.side_clearance,
            surfaces=tuple(self.surfaces),
            mount_height=self.mount_height,
        )
