"""Twins of a BSDF: neutral (every colour one grey), reflectance (colour only), diffuse lobe.

All are descriptions (`pbrnet.pipeline.render.bsdfs`) with the original's textures. A table here
names the properties that hold colour. Everything else (roughness, metalness, index of refraction,
glass, alpha masks, bump and normal maps, blend weights) stays unchanged in the neutral twin.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.bsdfs import Bsdf
from pbrnet.pipeline.render.scene_geometry import Mirror
from pbrnet.pipeline.render.scenegraph import Graph
from pbrnet.scenes.errors import InputError

_WRAPPERS = ("twosided", "mask", "bumpmap", "normalmap", "blendbsdf")
_CONDUCTORS = ("conductor", "roughconductor")
_DIELECTRICS = ("dielectric", "thindielectric", "roughdielectric")
_CLEAR = ("dielectric", "thindielectric", "null")  # camera rays pass these undeviated
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
# Properties of BSDFs whose values depend linearly on the base colour: without tints, and without
# transmission, which takes its square root.
_AFFINE = {
    "diffuse": {"reflectance"},
    "principled": {
        "base_color",
        "roughness",
        "metallic",
        "sheen",
        "clearcoat",
        "clearcoat_gloss",
        "anisotropic",
        "specular",
        "eta",
        "main_specular_sampling_rate",
    },
    "principledthin": {"base_color", "roughness", "diff_trans", "eta", "sheen"},
}
# Tints that are removed: their defaults are colourless.
_TINTS = ("specular_transmittance", "spec_tint", "sheen_tint")
_DEFAULT_BASE = 0.5
LOBES = frozenset({"metallic", "sheen"})
_NO_LOBE = 1e-30  # as good as 0, of which Mitsuba makes BSDFs of another form


def neutral_twin(graph: Graph, bsdf: Bsdf, albedo: float) -> Bsdf:
    """Return the neutral twin of a BSDF: every colour replaced by the grey `albedo`.

    Metals become grey mirrors of that reflectance, tinted glass becomes clear. A colourless
    constant `specular_reflectance` is gloss, not colour, and stays. Raises `InputError` for a BSDF
    that the table does not hold.
    """
    plugin, gloss = bsdf.plugin, "specular_reflectance"
    if plugin == "null":
        return bsdf
    if plugin in _WRAPPERS:
        twins = {name: neutral_twin(graph, held, albedo) for name, held in bsdf.held.items()}
        return bsdf.changed(twins)
    if plugin in _CONDUCTORS:
        return bsdf.changed({"material": "none", gloss: albedo}, ("eta", "k"))
    tinted = gloss in bsdf.properties and not _colourless(bsdf.properties[gloss])
    dropped = (*_TINTS, gloss) if tinted else _TINTS
    if plugin in _BASE:
        return bsdf.changed({_BASE[plugin]: albedo}, dropped)
    if plugin in _DIELECTRICS:
        return bsdf.changed({}, dropped)
    raise InputError(
        f"{graph.where(bsdf.node)}: this material has no neutral twin; "
        f"use one of {', '.join(sorted({*_BASE, *_CONDUCTORS, *_DIELECTRICS}))}"
    )


def lobes_of(bsdf: Bsdf) -> frozenset[str]:
    """Return the properties of principled materials that add a lobe, `LOBES`, in a BSDF."""
    held = (lobes_of(each) for each in bsdf.held.values())
    return frozenset(bsdf.properties.keys() & LOBES).union(*held)


def basis_twin(bsdf: Bsdf, lobes: frozenset[str] = frozenset()) -> Bsdf | None:
    """Return a BSDF with the base colour (0, 1, 0), from which another's and its twin's follow.

    Values of a BSDF here are a + colour * b in each band, where a and b have no colour: red of the
    basis is a, and green is a + b. Colours decide on no direction, either. None for a material of
    which this is not known. A principled basis also has all of `lobes`, so that those of a scene
    have one form.
    """
    if bsdf.plugin in _WRAPPERS[:-1] and len(bsdf.held) == 1:
        ((name, held),) = bsdf.held.items()
        basis = basis_twin(held, lobes)
        return None if basis is None else bsdf.changed({name: basis})
    if bsdf.plugin not in _AFFINE or not _AFFINE[bsdf.plugin].issuperset(bsdf.properties):
        return None
    added = lobes - bsdf.properties.keys() if bsdf.plugin == "principled" else frozenset()
    colour = {_BASE[bsdf.plugin]: mi.ScalarColor3d(0, 1, 0)}
    return bsdf.changed({**dict.fromkeys(added, _NO_LOBE), **colour})


def diffuse_lobe(bsdf: Bsdf) -> Bsdf:
    """Return a BSDF whose diffuse lobes are those of another, for evaluation only.

    To be evaluated in a `mi.BSDFContext` of diffuse lobes. Most materials obey that context and
    are returned themselves. The principled ones evaluate all their lobes in any context, so here
    they have only diffuse ones, sheen included: with a relative index of refraction of 1 nothing is
    reflected specularly, and transmission is replaced by a blend with black. Where a material has
    transmission, its sheen is scaled with the other diffuse lobes.
    """
    if bsdf.plugin in _WRAPPERS:
        lobes = {name: diffuse_lobe(held) for name, held in bsdf.held.items()}
        return bsdf.changed(lobes)
    if bsdf.plugin not in _PRINCIPLED:
        return bsdf
    transmission = bsdf.properties.get("spec_trans", 0.0)
    dropped = ("spec_trans", "clearcoat", "clearcoat_gloss", "spec_tint", "specular", "eta")
    opaque = bsdf.changed({"eta": 1.0} if bsdf.plugin == "principled" else {}, dropped)
    if isinstance(transmission, float | int) and transmission == 0:
        return opaque
    black = Bsdf(bsdf.node, "diffuse", {"reflectance": 0.0})
    parts = {"weight": transmission, "bsdf_0": opaque, "bsdf_1": black}
    return Bsdf(bsdf.node, "blendbsdf", parts)


def reflectance_twin(graph: Graph, bsdf: Bsdf) -> Bsdf:
    """Return a BSDF whose `eval_diffuse_reflectance` is the base colour of another.

    Diffuse, plastic, principled: the base colour or its texture. Metals: reflectance at normal
    incidence (times `specular_reflectance`; where that is a texture, the texture alone).
    Rough glass: its transmittance. Bump maps and masks are handled by the ray caster. Materials
    without a base colour (measured, hair) give 0.5.
    """
    held = bsdf.held
    if bsdf.plugin == "blendbsdf" or (bsdf.plugin == "twosided" and len(held) == 2):
        twins = {name: reflectance_twin(graph, child) for name, child in held.items()}
        return bsdf.changed(twins)
    if bsdf.plugin in _WRAPPERS and held:
        return reflectance_twin(graph, next(iter(held.values())))
    return Bsdf(bsdf.node, "diffuse", {"reflectance": _base_colour(graph, bsdf)})


def traits(graph: Graph, bsdfs: Sequence[int], own: int | None) -> tuple[bool, bool, Mirror, float]:
    """Return `clear`, `masked`, `mirrors` and `transmitted` of a shape, see `SceneGeometry`.

    `bsdfs` are its BSDF nodes, for an instance those of its group; `own` is its own, if any.
    """
    clear = bool(bsdfs) and all(graph.plugin(each) in _CLEAR for each in bsdfs)
    masked = any(_has_mask(graph, each) for each in bsdfs)
    if own is None:
        return clear, masked, "", 0.0
    return clear, masked, _mirrored_sides(graph, own), _transmitted_share(graph, own)


def _mirrored_sides(graph: Graph, index: int) -> Mirror:
    """Return which sides of node `index` are a perfect mirror, without bumps and masks."""
    children = graph.nested(index, "BSDF")
    if graph.plugin(index) == "twosided":
        return "both" if all(graph.plugin(child) == "conductor" for child in children) else ""
    return "front" if graph.plugin(index) == "conductor" else ""


def _transmitted_share(graph: Graph, index: int) -> float:
    """Return the part of the diffuse light of node `index` that goes through, in [0, 1].

    The rest is reflected. Where a texture decides, as in a blend, it is taken as one half.
    """
    plugin, children = graph.plugin(index), graph.nested(index, "BSDF")
    if plugin == "principledthin":  # whose `diff_trans` of 2 transmits all
        value = graph.props(index).get("diff_trans", 0.0)
        return min(1.0, max(0.0, value / 2)) if isinstance(value, float | int) else 0.5
    if plugin == "twosided" or not children:
        return 0.0
    return sum(_transmitted_share(graph, child) for child in children) / len(children)


def _has_mask(graph: Graph, index: int) -> bool:
    """Test whether a BSDF node holds an alpha mask anywhere."""
    return graph.plugin(index) == "mask" or any(
        _has_mask(graph, child) for child in graph.nested(index, "BSDF")
    )


def _base_colour(graph: Graph, bsdf: Bsdf) -> Any:
    plugin, properties = bsdf.plugin, bsdf.properties
    if plugin in _BASE:
        return properties.get(_BASE[plugin], _DEFAULT_BASE)
    if plugin in _DIELECTRICS:
        return properties.get("specular_transmittance", 1.0)
    if plugin in _CONDUCTORS:
        tint = properties.get("specular_reflectance", 1.0)
        if isinstance(tint, mi.Properties.ResolvedReference):
            return tint
        perfect = properties.get("material") == "none"
        metal = np.ones(3) if perfect else normal_incidence(graph.leaf(bsdf.node))
        return mi.ScalarColor3d(metal * np.array(tint, dtype=np.float64).ravel())
    return _DEFAULT_BASE


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
