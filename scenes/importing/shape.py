"""Shapes, surfaces and emitters of a scene that is imported."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal
from xml.etree.ElementTree import Element

from scenes.arrays import Float64Array
from scenes.geometry.mesh import Mesh


@dataclass(frozen=True)
class Shape:
    """One shape, in the file's world space.

    `mesh` always holds triangles (for measuring); `sphere` is the 4x4 map of the unit sphere
    where the shape stays an analytic sphere. `emitter` is what
    the source says of its emission, None if it emits nothing.
    """

    id: str
    name: str
    mesh: Mesh
    surface: Surface
    emitter: Any = None
    sphere: Float64Array | None = None
    inside_out: bool = False  # of a sphere

    def transformed(self, matrix: Float64Array) -> Shape:
        """The shape under a similarity."""
        return replace(
            self,
            mesh=self.mesh.transformed(matrix),
            sphere=None if self.sphere is None else matrix @ self.sphere,
        )


@dataclass
class Surface:
    """A translated material.

    `see_through` lets light pass straight (a clear pane), `frosted` scatters it on the way,
    `invisible` does nothing to light at all. `element` is None for invisible ones.
    """

    element: Element | None
    transmissive: bool = False
    double: bool = False  # already twosided
    see_through: bool = False
    frosted: bool = False
    invisible: bool = False
    name: str = ""


Kind = Literal["area", "point", "spot", "directional", "sun", "sky", "environment"]


@dataclass(frozen=True)
class Emitter:
    """A light outside the shapes; `position` in the new world, where it has one."""

    element: Element
    kinds: tuple[Kind, ...]
    position: tuple[float, float, float] | None = None


MAX_SHAPES = 100_000


MAX_SCENE_TRIANGLES = 20_000_000
