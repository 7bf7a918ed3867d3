"""BSDFs of a scene file: described, and made, all of one form as one object.

Dr.Jit traces every BSDF that exists for each call of a kernel, though the hundred or two of a home
differ only in textures and numbers. So materials whose BSDFs have one form share one BSDF: the
same plugins and properties, with the textures and numbers of `_SLOTS` in tables by material
(`pbrnet.pipeline.render.texture_tables`). Kernels are then recorded once per form, and homes share
them. Scalar variants have one BSDF per material.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.scenegraph import Graph
from pbrnet.pipeline.render.texture_tables import Column, Kind, TextureTables, constant

# Properties that a table may hold, by plugin. Those of `principled` are lobes that exist if the
# number is not 0, so 0 is part of the form. Plastics are missing: how often they sample their gloss
# follows from the mean of a texture.
_PRINCIPLED: dict[str, Kind] = dict.fromkeys(
    [
        "roughness",
        "metallic",
        "sheen",
        "sheen_tint",
        "spec_tint",
        "clearcoat",
        "clearcoat_gloss",
        "anisotropic",
    ],
    "number",
)
_SLOTS: dict[str, dict[str, Kind]] = {
    "twosided": {},
    "normalmap": {"normalmap": "vector"},
    "diffuse": {"reflectance": "colour"},
    "principled": {"base_color": "colour", **_PRINCIPLED},
    "principledthin": {"base_color": "colour", "roughness": "number", "diff_trans": "number"},
}

# Rate at which `principled` samples its gloss, relative to its diffuse light (Mitsuba: 1). Most of
# the gloss of homes is faint, and emitter samples find much of it.
_GLOSS_RATE = 0.25

Form = tuple[Any, ...]  # what BSDFs that are made as one have in common


@dataclass(frozen=True)
class Bsdf:
    """Description of a BSDF: its node in the scene file, its plugin, its properties by name.

    A property is a constant, a reference to a texture's node, a Mitsuba object, or another
    description.
    """

    node: int
    plugin: str
    properties: Mapping[str, Any]

    def changed(self, properties: Mapping[str, Any], drop: tuple[str, ...] = ()) -> Bsdf:
        """Return this BSDF with some properties changed, and without others."""
        kept = {name: value for name, value in self.properties.items() if name not in drop}
        return replace(self, properties={**kept, **properties})

    @property
    def held(self) -> dict[str, Bsdf]:
        """The BSDFs that it holds, by property."""
        return {name: value for name, value in self.properties.items() if isinstance(value, Bsdf)}


def describe(graph: Graph, node: int) -> Bsdf:
    """Return the description of a BSDF node of a scene file."""
    props = graph.props(node)
    properties = {}
    for name in props.keys():  # noqa: SIM118 (mi.Properties is not iterable)
        value = props[name]
        if isinstance(value, mi.Properties.ResolvedReference):
            child = value.index()
            value = describe(graph, child) if graph.kind(child) == "BSDF" else value
        properties[name] = value
    plugin = graph.plugin(node)
    if plugin == "principled":
        properties.setdefault("main_specular_sampling_rate", _GLOSS_RATE)
    return Bsdf(node, plugin, properties)


@dataclass
class BsdfSet:
    """BSDFs of a scene's materials, by node; those of one form are one object."""

    made: dict[int, Any] = field(default_factory=dict)
    members: dict[Form, tuple[Any, dict[int, Form]]] = field(default_factory=dict)


class BsdfMaker:
    """Maker of BSDFs of one scene, which share its textures and tables."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._merges = bool(dr.is_jit_v(mi.Float))
        self.tables = TextureTables(graph)

    def make(self, described: Mapping[int, Bsdf], known: tuple[BsdfSet, ...] = ()) -> BsdfSet:
        """Make the BSDFs of materials, by node of the material.

        Those that one of the `known` sets has already, with equal contents, are taken from it.
        Raises `InputError` as `Graph.make` does.
        """
        groups: dict[Form, dict[int, Bsdf]] = {}
        for node, bsdf in described.items():
            groups.setdefault(self._form(bsdf), {})[node] = bsdf
        found = BsdfSet()
        for form, group in groups.items():
            contents = {node: _contents(bsdf) for node, bsdf in group.items()}
            made = _known(form, contents, known)
            if made is None:
                made = self._make(group)
            found.members[form] = made, contents
            found.made.update(dict.fromkeys(group, made))
        return found

    def _form(self, bsdf: Bsdf) -> Form:
        parts: list[Form] = []
        for name, value in sorted(bsdf.properties.items()):
            if isinstance(value, Bsdf):
                parts.append((name, self._form(value)))
            elif column := self._column(bsdf, name):
                parts.append((name, column.form))
            else:
                parts.append((name, described(value)))
        return (bsdf.plugin, *parts)

    def _column(self, bsdf: Bsdf, name: str) -> Column | None:
        """Return what a table holds of a property, None for one that stays in the BSDF."""
        kind, value = _SLOTS.get(bsdf.plugin, {}).get(name), bsdf.properties[name]
        if kind is None or not self._merges:
            return None
        if isinstance(value, mi.Properties.ResolvedReference):
            return self.tables.texture(kind, value.index())
        return constant(kind, value)

    def _make(self, group: Mapping[int, Bsdf]) -> Any:
        """Make the BSDF of a group of materials of one form."""
        first = next(iter(group.values()))
        props = mi.Properties(first.plugin)
        for name, value in first.properties.items():
            if isinstance(value, Bsdf):
                held = {node: bsdf.properties[name] for node, bsdf in group.items()}
                props[name] = self._make(held)
                continue
            columns = {
                node: column
                for node, bsdf in group.items()
                if (column := self._column(bsdf, name)) is not None
            }
            props[name] = self.tables.table(columns) if columns else value
        return self._graph.make_from(first.node, props)


def _known(form: Form, contents: dict[int, Form], sets: tuple[BsdfSet, ...]) -> Any:
    """Return the BSDF of a set that holds these contents in this form, None if none does."""
    for other in sets:
        made, members = other.members.get(form, (None, {}))
        if made is not None and all(members.get(node) == one for node, one in contents.items()):
            return made
    return None


def _contents(bsdf: Bsdf) -> Form:
    """Return all that decides what a BSDF is, comparable."""
    return (
        bsdf.plugin,
        *(
            (name, _contents(value) if isinstance(value, Bsdf) else described(value))
            for name, value in sorted(bsdf.properties.items())
        ),
    )


def described(value: Any) -> str:
    """Return a property's value as text; of an object, which one it is."""
    if isinstance(value, mi.Properties.ResolvedReference):
        return f"node {value.index()}"
    if isinstance(value, mi.Object):
        return f"object {value.ptr}"
    if isinstance(value, bool | int | float | str):
        return repr(value)
    try:
        return repr(np.array(value, dtype=np.float64).tolist())
    except (TypeError, ValueError):
        return f"object {id(value)}"
