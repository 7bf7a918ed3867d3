"""Surfaces of shapes from BSDF elements; opaque ones become two-sided.

So no surface is black from behind.
"""

from __future__ import annotations

from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.mitsuba.bsdfs import BSDFS, Bsdf
from pbrnet.scenes.mitsuba.reader import Node
from pbrnet.scenes.mitsuba.textures import Textures
from pbrnet.scenes.mitsuba.values import Properties, Scope


class Materials:
    """Translates BSDF elements, each once."""

    def __init__(self, scope: Scope, textures: Textures) -> None:
        self.scope, self.textures = scope, textures
        self._surfaces: dict[int, Surface] = {}

    def surface(self, node: Node | None) -> Surface:
        """Translate the material of a shape; without one, a shape is grey and diffuse."""
        if node is None:
            return Surface(plugin("bsdf", "twosided", bsdf=plugin("bsdf", "diffuse")))
        if id(node) not in self._surfaces:
            surface = self._translate(node).two_sided()
            surface.name = node.attributes.get("id", "")
            self._surfaces[id(node)] = surface
        return self._surfaces[id(node)]

    def _translate(self, node: Node) -> Surface:
        known = BSDFS.get(node.type)
        if known is None:
            self.scope.changes.note(
                "unknown material, replaced by a grey diffuse one: {}",
                f"{node.type!r} ({node.place})",
            )
            return Surface(plugin("bsdf", "diffuse"))
        with self.scope.nested(node, "materials"):
            properties = Properties(node, self.scope)
            properties.ignore("id")
            surface = known(Bsdf(properties, self.textures, self._translate))
            properties.report_unused()
        return surface
