"""BSDFs that exported materials had, where the parameters of a format say less.

`pbrnet export-scene` writes a `Statement` beside the material (GLB: `extras.pbrnet`, USD: custom
data). Colour, roughness and index of refraction are those of the format, so that edits count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.checked import OPTIONAL, build, param, within
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.materials.surface import Surface, rough_glass, thin_sheet
from pbrnet.scenes.importing.xml_elements import plugin

_PASSING = ("dielectric", "roughdielectric", "thindielectric", "principledthin")


@dataclass(frozen=True)
class Statement:
    """Plugin of Mitsuba, and its parameters that formats do not know."""

    bsdf: Literal[
        "diffuse",
        "plastic",
        "roughplastic",
        "conductor",
        "roughconductor",
        "dielectric",
        "roughdielectric",
        "thindielectric",
        "principledthin",
        "principled",
    ]
    distribution: Literal["beckmann", "ggx"] = param("beckmann", "", OPTIONAL)
    nonlinear: bool = param(False, "", OPTIONAL)
    eta: tuple[float, ...] = param((), "", within(0, 100), OPTIONAL)  # of a conductor, RGB
    k: tuple[float, ...] = param((), "", within(0, 100), OPTIONAL)
    transmitted: float = param(0.0, "", within(0, 2), OPTIONAL)  # `diff_trans`
    sheen: float = param(0.0, "", within(0, 1), OPTIONAL)
    lift: float = param(1.0, "", within(1, 2), OPTIONAL)  # base colour in the file over that here

    def verify(self, where: str) -> None:
        """Check the numbers of bands; raises ValueError."""
        if len(self.eta) not in (0, 3) or len(self.k) != len(self.eta):
            raise ValueError(f"{where}: eta and k need three numbers each, or none")

    @property
    def is_passing(self) -> bool:
        """True of glass and of thin sheets, which light passes."""
        return self.bsdf in _PASSING

    @property
    def is_opaque(self) -> bool:
        """True of BSDFs that `opaque_bsdf` makes."""
        return self.bsdf not in (*_PASSING, "principled")

    @property
    def reflectance(self) -> Float64Array:
        """Reflectance of the conductor at normal incidence, RGB (3,)."""
        if not self.eta:
            return np.ones(3)
        n, k = np.array(self.eta), np.array(self.k)
        made: Float64Array = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
        return made


def statement(given: Any, place: str) -> Statement | None:
    """The statement `given` of a material, None without one; raises `InputError` if damaged."""
    return build(Statement, given, place, InputError) if isinstance(given, dict) else None


def opaque_bsdf(stated: Statement, color: Color | Element, roughness: float, ior: float) -> Element:
    """BSDF of an opaque material, one-sided; `roughness` is perceptual."""
    if stated.bsdf == "diffuse":
        return plugin("bsdf", "diffuse", reflectance=color)
    rough = _rough(stated, roughness)
    if stated.bsdf.endswith("conductor"):
        return _conductor(stated, color, rough)
    nonlinear = stated.nonlinear or None
    return plugin("bsdf", stated.bsdf, diffuse_reflectance=color, int_ior=ior,
                  nonlinear=nonlinear, **rough)  # fmt: skip


def passing_surface(
    stated: Statement, color: Color | Element, roughness: float, ior: float
) -> Surface:
    """Surface of glass or of a thin sheet; `roughness` is perceptual."""
    if stated.bsdf == "principledthin":
        return thin_sheet(color, stated.transmitted)
    rough = _rough(stated, roughness)
    tint = None if color == (1.0, 1.0, 1.0) else color
    made = plugin("bsdf", stated.bsdf, int_ior=ior, specular_transmittance=tint, **rough)
    return rough_glass(made, rough.get("alpha", 0.0))


def _rough(stated: Statement, roughness: float) -> dict[str, Any]:
    """Properties of a rough plugin, none of a smooth one."""
    if not stated.bsdf.startswith("rough"):
        return {}
    return {"alpha": max(roughness**2, 1e-4), "distribution": stated.distribution}


def _conductor(stated: Statement, color: Color | Element, rough: dict[str, Any]) -> Element:
    """A conductor whose reflectance at normal incidence is `color`; an image is its tint."""
    if not isinstance(color, Element):
        color = as_triple(np.clip(np.array(color) / np.maximum(stated.reflectance, 1e-3), 0, 1))
    spectrum: dict[str, Any] = {"material": "none"}
    if stated.eta:
        spectrum = {"eta": as_triple(np.array(stated.eta)), "k": as_triple(np.array(stated.k))}
    return plugin("bsdf", stated.bsdf, specular_reflectance=color, **spectrum, **rough)
