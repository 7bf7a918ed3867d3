"""BSDFs of Mitsuba 3 that materials of pbrt are translated to."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.materials.surface import Surface, clipped, rough_glass
from pbrnet.scenes.importing.xml_elements import plugin, prop

WHITE: Color = (1.0, 1.0, 1.0)

Alpha = float | tuple[float, float]  # GGX roughness, of one or two axes; 0 if smooth


def plastic(
    diffuse: Color | Element,
    alpha: Alpha,
    ior: float,
    specular: Color | Element,
) -> Surface:
    """`plastic`, or `roughplastic`, which has one roughness for both axes."""
    made = plugin(
        "bsdf", "roughplastic" if alpha else "plastic", diffuse_reflectance=diffuse, int_ior=ior
    )
    if specular != WHITE:
        made.append(prop("specular_reflectance", specular))
    if alpha:
        made.append(prop("alpha", float(np.mean(alpha))))
        made.append(prop("distribution", "ggx"))
    return Surface(made)


def glass(kind: str, ior: float, alpha: Alpha, reflected: Color, through: Color) -> Surface:
    """`roughdielectric`, or the smooth `kind`: "dielectric" or "thindielectric"."""
    rough = max(np.atleast_1d(alpha).tolist())
    made = plugin("bsdf", "roughdielectric" if rough else kind, int_ior=ior)
    for one in roughness(alpha):
        made.append(one)
    if reflected != WHITE:
        made.append(prop("specular_reflectance", clipped(np.array(reflected))))
    if through != WHITE:
        made.append(prop("specular_transmittance", clipped(np.array(through))))
    return rough_glass(made, rough)


def roughness(alpha: Alpha) -> list[Element]:
    """Properties of a microfacet BSDF; none for a smooth one."""
    if not alpha:
        return []
    kind = prop("distribution", "ggx")
    if isinstance(alpha, tuple):
        return [kind, prop("alpha_u", alpha[0]), prop("alpha_v", alpha[1])]
    return [kind, prop("alpha", alpha)]


def mirror(color: Color | Element) -> Surface:
    """A perfect mirror of a reflectance."""
    return Surface(plugin("bsdf", "conductor", material="none", specular_reflectance=color))


def remapped(value: float, version: int) -> float:
    """GGX alpha of pbrt's roughness parameter in [0, 1]."""
    if value <= 0:
        return 0.0
    if version == 4:
        return math.sqrt(min(value, 1.0))
    x = math.log(min(max(value, 1e-3), 1.0))
    alpha = 1.62142 + 0.819955 * x + 0.1734 * x**2 + 0.0171201 * x**3 + 0.000640711 * x**4
    return min(alpha, 1.0)
