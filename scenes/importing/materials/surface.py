"""Surface of a shape: a BSDF of Mitsuba 3 and how light passes it."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.xml_elements import Value, plugin

_CLEAR_ROUGHNESS = 0.05  # alpha up to which rough glass counts as clear


@dataclass
class Surface:
    """A translated material."""

    element: Element | None  # BSDF of Mitsuba 3, None if invisible
    transmissive: bool = False
    double: bool = False  # already two-sided
    see_through: bool = False  # light passes straight, as through a clear pane
    frosted: bool = False  # light passes and is scattered
    invisible: bool = False  # no effect on light at all
    unstated: bool = False  # the file states no material
    name: str = ""

    @property
    def opaque_element(self) -> Element | None:
        """The BSDF without its `twosided` wrapper."""
        if self.element is None or self.element.get("type") != "twosided":
            return self.element
        return self.element[0]

    def two_sided(self) -> Surface:
        """The surface, wrapped by `twosided` if it is opaque and one-sided."""
        if self.element is None or self.transmissive or self.double:
            return self
        return Surface(wrapped("twosided", self.element), double=True)

    def blended(self, other: Surface, weight: float | Element) -> Surface:
        """`blendbsdf` with `weight` of `other`."""
        transmissive = self.transmissive or other.transmissive
        parts = []
        for surface in (self, other):
            element = surface.two_sided().element if transmissive else surface.opaque_element
            parts.append(plugin("bsdf", "null") if element is None else copy.deepcopy(element))
        return Surface(wrapped("blendbsdf", *parts, weight=weight), transmissive=transmissive)


def wrapped(kind: str, *nested: Element | None, **values: Value | None) -> Element:
    """A BSDF around nested ones, with properties as of `plugin`."""
    made = plugin("bsdf", kind, "", **values)
    made.extend(one for one in nested if one is not None)
    return made


def invisible() -> Surface:
    """A surface without effect on light."""
    return Surface(None, transmissive=True, see_through=True, invisible=True)


def clear_glass(ior: float = 1.5, name: str = "") -> Surface:
    """A clear pane."""
    made = plugin("bsdf", "thindielectric", int_ior=ior)
    return Surface(made, transmissive=True, see_through=True, name=name)


def cut_out(bsdf: Element, opacity: float | Element) -> Surface:
    """`bsdf` on both sides, behind a mask if `opacity` is a texture or less than 1."""
    both = wrapped("twosided", bsdf)
    if isinstance(opacity, float) and opacity >= 0.999:
        return Surface(both, double=True)
    return Surface(wrapped("mask", both, opacity=opacity), transmissive=True)


def thin_sheet(color: Color | Element, transmitted: float) -> Surface:
    """A thin diffuse sheet; `transmitted` is 0 if it reflects all light, 2 if none."""
    made = plugin(
        "bsdf",
        "principledthin",
        base_color=color,
        roughness=1.0,
        diff_trans=transmitted,
        eta=1.001,
    )
    return Surface(made, transmissive=True, frosted=True)


def principled_surface(element: Element, transmission: float) -> Surface:
    """The surface of a `principled(thin)` BSDF; `transmission` is its `spec_trans`."""
    thin = element.get("type") == "principledthin"
    return Surface(
        element,
        transmissive=thin or transmission > 0,
        see_through=transmission > 0.5,
        frosted=thin and transmission <= 0.5,
    )


def rough_glass(element: Element, alpha: float) -> Surface:
    """The surface of a dielectric BSDF with roughness `alpha`, clear if that is small."""
    clear = alpha <= _CLEAR_ROUGHNESS
    return Surface(element, transmissive=True, see_through=clear, frosted=not clear)


def clipped(values: Float64Array | tuple[float, ...]) -> Color:
    """Values (3,) clipped to [0, 1], as a colour."""
    red, green, blue = np.clip(values, 0.0, 1.0).tolist()
    return (red, green, blue)
