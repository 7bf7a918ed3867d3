"""Twins of a BSDF: neutral (every colour one grey), reflectance (colour only), diffuse lobe.

All are made from the scene file's nodes and share textures with the original. A table here names
the properties that hold colour. Everything else (roughness, metalness, index of refraction, glass,
alpha masks, bump and normal maps, blend weights) stays unchanged in the neutral twin.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.scene_geometry import Mirror
from pbrnet.pipeline.render.scenegraph import Graph, create
from pbrnet.scenes.errors import InputError

_WRAPPERS = ("twosided", "mask", "bumpmap", "normalmap", "blendbsdf")
_CONDUCTORS = ("conductor", "roughconductor")
_DIELECTRICS = ("dielectric", "thindielectric", "roughdielectric")
# plugin -> property that holds its base colour; Mitsuba's default of each is 0.5
_BASE = {
    "diffuse": "reflectance",
    "plastic": "diffuse_reflectance",
    "roughplastic": "diffuse_reflectance",
    "pplastic": "diffuse_reflectance",
    "principled": "base_color",
    "principledthin": "base_color",
}
_PRINCIPLED = ("principled", "principledthin")
# Tints that are removed: their defaults are colourless.
_TINTS = ("specular_transmittance", "spec_tint", "sheen_tint")
_DEFAULT_BASE = 0.5


class NeutralTwins:
    """Neutral twins of a scene's BSDFs, with every colour replaced by the grey `albedo`.

    BSDFs that differ in colour alone have one twin: kernels are traced through each BSDF.
    """

    def __init__(self, graph: Graph, albedo: float) -> None:
        self._graph = graph
        self._albedo = albedo
        self._made: dict[tuple[str, ...], Any] = {}

    def twin(self, index: int, held: bool = False) -> Any:
        """Return the neutral twin of node `index`; `held` is one that only other BSDFs hold.

        Metals become grey mirrors of that reflectance, tinted glass becomes clear. A colourless
        constant `specular_reflectance` is gloss, not colour, and stays. Raises `InputError` for a
        BSDF that the table does not hold.
        """
        graph, albedo = self._graph, self._albedo
        plugin, props = graph.plugin(index), graph.props(index)
        if plugin == "null":
            return graph.make(index)
        if plugin in _WRAPPERS:
            for name, child in graph.references(index).items():
                if graph.kind(child) == "BSDF":
                    props[name] = self.twin(child, held=True)
            return self._make(index, props, held)
        if plugin in _CONDUCTORS:
            _drop(props, "eta", "k", "material", "specular_reflectance")
            props["material"] = "none"
            props["specular_reflectance"] = albedo
            return self._make(index, props, held)
        if plugin in _BASE:
            _drop(props, _BASE[plugin])
            props[_BASE[plugin]] = albedo
        elif plugin not in _DIELECTRICS:
            raise InputError(
                f"{graph.where(index)}: this material has no neutral twin; "
                f"use one of {', '.join(sorted({*_BASE, *_CONDUCTORS, *_DIELECTRICS}))}"
            )
        _drop(props, *_TINTS)
        gloss = "specular_reflectance"
        if gloss in props and not _colourless(props[gloss]):
            del props[gloss]
        return self._make(index, props, held)

    def _make(self, index: int, props: Any, held: bool) -> Any:
        """Return the BSDF of these properties; the one made before if they are equal.

        One that is held is out of the reach of virtual calls, so shapes have others.
        """
        names = sorted(props.keys())
        key = (
            props.plugin_name(),
            str(held),
            *(f"{name} = {_described(props[name])}" for name in names),
        )
        if key not in self._made:
            self._made[key] = self._graph.make_from(index, props)
        return self._made[key]


def diffuse_lobe(graph: Graph, index: int) -> Any:
    """Return a BSDF whose diffuse lobes are those of node `index`, for evaluation only.

    To be evaluated in a `mi.BSDFContext` of diffuse lobes. Most materials obey that context and
    are returned themselves. The principled ones evaluate all their lobes in any context, so here
    they have only diffuse ones, sheen included: with a relative index of refraction of 1 nothing is
    reflected specularly, and transmission is replaced by a blend with black. Where a material has
    transmission, its sheen is scaled with the other diffuse lobes.
    """
    plugin, props = graph.plugin(index), graph.props(index)
    if plugin in _WRAPPERS:
        for name, child in graph.references(index).items():
            if graph.kind(child) == "BSDF":
                props[name] = diffuse_lobe(graph, child)
        return graph.make_from(index, props)
    if plugin not in _PRINCIPLED:
        return graph.make(index)
    transmission = _value(graph, index, "spec_trans", 0.0)
    _drop(props, "spec_trans", "clearcoat", "clearcoat_gloss", "spec_tint", "specular", "eta")
    if plugin == "principled":
        props["eta"] = 1.0
    opaque = graph.make_from(index, props)
    if isinstance(transmission, float | int) and transmission == 0:
        return opaque
    black = mi.Properties("diffuse")
    black["reflectance"] = 0.0
    blend = mi.Properties("blendbsdf")
    blend["weight"], blend["bsdf_0"], blend["bsdf_1"] = transmission, opaque, create(black)
    return graph.compose(blend)


def reflectance_twin(graph: Graph, index: int) -> Any:
    """Return a BSDF whose `eval_diffuse_reflectance` is the base colour of node `index`.

    Diffuse, plastic, principled: the base colour or its texture. Metals: reflectance at normal
    incidence (times `specular_reflectance`; where that is a texture, the texture alone).
    Rough glass: its transmittance. Bump maps and masks are handled by the ray caster. Materials
    without a base colour (measured, hair) give 0.5.
    """
    plugin, references = graph.plugin(index), graph.references(index)
    children = graph.nested(index, "BSDF")
    if plugin == "blendbsdf" or (plugin == "twosided" and len(children) == 2):
        props = graph.props(index)
        for name, child in references.items():
            if graph.kind(child) == "BSDF":
                props[name] = reflectance_twin(graph, child)
        return graph.make_from(index, props)
    if plugin in _WRAPPERS and children:
        return reflectance_twin(graph, children[0])
    twin = mi.Properties("diffuse")
    twin["reflectance"] = _base_colour(graph, index)
    return create(twin)


def passes_light(graph: Graph, index: int) -> bool:
    """Test whether camera rays pass node `index` undeviated.

    True for smooth dielectrics, thin panes and the null BSDF.
    """
    return graph.plugin(index) in ("dielectric", "thindielectric", "null")


def mirrored_sides(graph: Graph, index: int) -> Mirror:
    """Return which sides of node `index` are a perfect mirror, without bumps and masks."""
    children = graph.nested(index, "BSDF")
    if graph.plugin(index) == "twosided":
        return "both" if all(graph.plugin(child) == "conductor" for child in children) else ""
    return "front" if graph.plugin(index) == "conductor" else ""


def transmitted_share(graph: Graph, index: int) -> float:
    """Return the part of the diffuse light of node `index` that goes through, in [0, 1].

    The rest is reflected. Where a texture decides, as in a blend, it is taken as one half.
    """
    plugin, children = graph.plugin(index), graph.nested(index, "BSDF")
    if plugin == "principledthin":  # whose `diff_trans` of 2 transmits all
        value = _value(graph, index, "diff_trans", 0.0)
        return min(1.0, max(0.0, value / 2)) if isinstance(value, float | int) else 0.5
    if plugin == "twosided" or not children:
        return 0.0
    return sum(transmitted_share(graph, child) for child in children) / len(children)


def has_mask(graph: Graph, index: int) -> bool:
    """Test whether a BSDF node holds an alpha mask anywhere."""
    return graph.plugin(index) == "mask" or any(
        has_mask(graph, child) for child in graph.nested(index, "BSDF")
    )


def _base_colour(graph: Graph, index: int) -> Any:
    plugin = graph.plugin(index)
    if plugin in _BASE:
        return _value(graph, index, _BASE[plugin], _DEFAULT_BASE)
    if plugin in _DIELECTRICS:
        return _value(graph, index, "specular_transmittance", 1.0)
    if plugin in _CONDUCTORS:
        tint = _value(graph, index, "specular_reflectance", 1.0)
        metal = normal_incidence(graph.make(index))
        if isinstance(tint, float | int):
            return mi.ScalarColor3d(metal * tint)
        if "specular_reflectance" in graph.references(index):
            return tint
        return mi.ScalarColor3d(metal * np.array(tint, dtype=np.float64).ravel())
    return _DEFAULT_BASE


def _value(graph: Graph, index: int, name: str, default: float) -> Any:
    references = graph.references(index)
    if name in references:
        return graph.make(references[name])
    props = graph.props(index)
    return props.get(name, default)


def normal_incidence(conductor: Any) -> np.ndarray:
    """Return the Fresnel reflectance of a conductor at normal incidence, RGB (3,), in [0, 1]."""
    params = mi.traverse(conductor)
    if "eta.value" not in params or "k.value" not in params:
        return np.ones(3)  # material "none": a perfect mirror
    eta = np.broadcast_to(np.array(params["eta.value"], dtype=np.float64).ravel(), 3)
    k = np.broadcast_to(np.array(params["k.value"], dtype=np.float64).ravel(), 3)
    if not (eta.any() or k.any()):
        return np.ones(3)
    return np.clip(((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2), 0, 1)


def _described(value: Any) -> str:
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


def _drop(props: Any, *names: str) -> None:
    for name in names:
        if name in props:
            del props[name]


def _colourless(value: Any) -> bool:
    if isinstance(value, float | int):
        return True
    if isinstance(value, mi.Properties.ResolvedReference):
        return False
    try:
        bands = np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        return False
    return bands.size > 0 and bool(np.ptp(bands) < 1e-6)
