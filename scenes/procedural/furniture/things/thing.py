"""Specification of a thing that people leave in rooms."""

from __future__ import annotations

from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder, Print
from pbrnet.scenes.procedural.furniture.spec import Spec, drawn, ranged
from pbrnet.scenes.procedural.piece import Anchor

OUTLINES: dict[str, list[list[float]]] = data_beside(__file__)
Size = tuple[float, float, float]


def turned(outline: str, radius: float, height: float, segments: int) -> g.BodyMesh:
    """A turned body of one of the outlines."""
    return g.lathe([(radius * r, height * z) for r, z in OUTLINES[outline]], segments)


class Thing(Spec):
    """A thing; its row in the table of kinds names it and may change category and anchor."""

    name: str
    category: str = drawn(lambda draw, thing: thing.piece.category)
    anchor: Anchor = drawn(lambda draw, thing: thing.piece.anchor)

    def __init_subclass__(cls, category: str = "", anchor: Anchor = "on_top") -> None:
        super().__init_subclass__((cls.__name__, category, anchor))


class RoundThing(Thing):
    """A body of revolution; a row has limits of its radius and height."""

    radius: float = ranged()
    height: float = ranged()

    def add_label(self, b: Builder, label: Print, low: float, high: float, segments: int) -> None:
        """Add a printed label round the body between two heights."""
        paper = g.lathe([(self.radius + 0.0006, low), (self.radius + 0.0006, high)], segments)
        b.add(label, paper, name="label")
