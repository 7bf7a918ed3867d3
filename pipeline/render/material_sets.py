"""What the shapes of an open scene wear: their own materials, or a grey twin of each."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import mitsuba as mi

from pipeline.render.neutral import neutral_twin
from pipeline.render.scenegraph import Graph, create, shapes_of
from scenes.errors import InputError

_ANY_GREY = 0.5

Suit = list[tuple[Any, Any]]  # shape and BSDF


class Wardrobe:
    """Changes the materials of a scene's shapes, which share geometry and textures.

    Dr.Jit compiles every material that exists into each path tracing kernel, so a grey suit
    made only after the first colour image would cost a second compilation, and the next colour
    image a third. Hence one grey suit always exists, whatever its grey: that is data, not code.
    """

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._own = _suit(graph, None)
        self._grey: Suit = []
        self._shade: float | None = None
        self._worn: float | None = None
        self.suit = 0  # number of the present grey suit; those before are gone
        with suppress(InputError):  # raised again when the grey is asked for
            self._tailor(_ANY_GREY)

    def wear(self, albedo: float | None) -> None:
        """Dress all shapes in the grey `albedo`, or None: in their own materials.

        Raises `InputError` for a material that has no grey twin.
        """
        if albedo == self._worn:
            return
        if albedo is not None and albedo != self._shade:
            self.wear(None)
            self._grey = []  # gone before the next is made, so that their number stays
            self._tailor(albedo)
        for shape, bsdf in self._own if albedo is None else self._grey:
            shape.set_bsdf(bsdf)
        self._worn = albedo

    def twins(self, albedo: float) -> list[tuple[Any, Any]]:
        """Every shape's own material with its twin in the grey `albedo`.

        They hold until another grey is asked for; shapes that wear another one take it off. Raises
        `InputError` as `wear` does.
        """
        if albedo != self._shade:
            self.wear(albedo)
            self.wear(None)
        pairs = zip(self._own, self._grey, strict=True)
        return [(own, grey) for (_, own), (_, grey) in pairs]

    def _tailor(self, albedo: float) -> None:
        self._shade = None
        self._grey = _suit(self._graph, albedo)
        self.suit += 1
        self._shade = albedo


def _suit(graph: Graph, albedo: float | None) -> Suit:
    """Every shape with what it wears in one form of the scene."""
    twins: dict[int, Any] = {}
    suit = []
    for node in shapes_of(graph):
        if graph.plugin(node) in ("shapegroup", "instance"):
            continue
        shape = graph.make(node)
        if albedo is None:
            suit.append((shape, shape.bsdf()))
            continue
        material = next(iter(graph.nested(node, "BSDF")), -1)
        if material not in twins:
            twins[material] = (
                neutral_twin(graph, material, albedo) if material >= 0 else _plain(albedo)
            )
        suit.append((shape, twins[material]))
    return suit


def _plain(albedo: float) -> Any:
    """What shapes without a material wear."""
    grey = mi.Properties("diffuse")
    grey["reflectance"] = albedo
    return create(grey)
