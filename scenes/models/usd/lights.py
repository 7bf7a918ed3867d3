"""Lights of UsdLux as plain data: shapes that shine, and lights without extent.

Runs in the child process that holds OpenUSD. Intensities are luminances in candela per square
metre: color x intensity x 2^exposure, divided by the area in the stage's units if the light is
normalised (OpenUSD, "UsdLux overview"). With a narrow cone a light becomes a spot.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdLux

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.primitives import sphere
from pbrnet.scenes.models.usd.geometry import revolved

OUTDOORS = ("DomeLight", "DomeLight_1")
KINDS = ("SphereLight", "RectLight", "DiskLight", "CylinderLight", "DistantLight", *OUTDOORS)
_SUN_IN_NITS = 1e6  # from which the intensity of a distant light is read as a luminance
_SEGMENTS = 16  # around a tube
_LEAST = 1e-3  # units: radius of a point


def light_data(prim: Any, matrix: Float64Array, metres: float, time: Any) -> dict[str, Any] | None:
    """Return a light under `matrix` (4, 4) of a stage whose unit has `metres`; None if it is off.

    `kind` is "area" with `points` (F, 3, 3) in the light's axes, or "point", "spot" and
    "directional" with `intensity` in candela or lux; `color` is linear.
    """
    light = UsdLux.LightAPI(prim)
    color = _color(light, time)
    kind = str(prim.GetTypeName())
    sizes = np.linalg.norm(matrix[:3, :3], axis=0)
    if color is None or not np.isfinite(sizes).all() or sizes.min() <= 0:
        return None
    normalised = bool(_value(light.GetNormalizeAttr(), time, False))
    name = prim.GetName()
    if kind == "DistantLight":
        angle = math.radians(_value(prim.GetAttribute("inputs:angle"), time, 0.53))
        solid = math.pi * math.sin(0.5 * angle) ** 2
        lux = solid if not normalised and max(color) >= _SUN_IN_NITS else 1.0
        return {"kind": "directional", "name": name, "color": color, "intensity": lux}
    shape, area = _shape(prim, kind, sizes, time)
    if normalised:
        color = [value / area for value in color]
    cone = _value(prim.GetAttribute("inputs:shaping:cone:angle"), time, 90.0)
    point = kind == "SphereLight" and _value(prim.GetAttribute("treatAsPoint"), time, False)
    if cone < 89 or point:
        # A sphere shows a quarter of its area, a flat light all of it, along its axis.
        facing = area / 4 if kind == "SphereLight" else area
        softness = _value(prim.GetAttribute("inputs:shaping:cone:softness"), time, 0.0)
        outer = math.radians(min(max(cone, 0.6), 89.0))
        return {
            "kind": "spot" if cone < 89 else "point",
            "name": name,
            "color": color,
            "intensity": facing * metres**2,
            "outer": outer,
            "inner": outer * (1 - min(max(softness, 0.0), 1.0)),
        }
    return {"kind": "area", "name": name, "color": color, "points": shape}


def _color(light: Any, time: Any) -> list[float] | None:
    """Luminance by band, before normalisation; None without any."""
    strength = _value(light.GetIntensityAttr(), time, 1.0)
    exposure = min(max(_value(light.GetExposureAttr(), time, 0.0), -60.0), 60.0)
    color = np.array(_value(light.GetColorAttr(), time, (1, 1, 1)), dtype=np.float64)
    if _value(light.GetEnableColorTemperatureAttr(), time, False):
        kelvin = _value(light.GetColorTemperatureAttr(), time, 6500.0)
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(min(max(kelvin, 1000), 10000)))
    made = np.maximum(color * strength * 2.0**exposure, 0)
    if not np.isfinite(made).all() or made.max() <= 0 or made.max() > 1e15:
        return None
    return [float(value) for value in made]


def _shape(prim: Any, kind: str, sizes: Float64Array, time: Any) -> tuple[Float64Array, float]:
    """Triangles (F, 3, 3) in the light's axes, front outwards, and the area in the world."""
    radius = max(_value(prim.GetAttribute("inputs:radius"), time, 0.5), _LEAST)
    if kind == "RectLight":
        width = max(_value(prim.GetAttribute("inputs:width"), time, 1.0), _LEAST)
        height = max(_value(prim.GetAttribute("inputs:height"), time, 1.0), _LEAST)
        x, y = 0.5 * width, 0.5 * height
        corners = np.array([[-x, -y, 0], [-x, y, 0], [x, y, 0], [x, -y, 0]])
        area = width * sizes[0] * height * sizes[1]
        return corners[np.array([[0, 1, 2], [0, 2, 3]])], float(area)
    if kind == "DiskLight":
        around = -np.linspace(0, 2 * np.pi, 33)
        rim = radius * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
        fan = np.stack([np.zeros((32, 3)), rim[:-1], rim[1:]], axis=1)
        return fan, float(math.pi * radius**2 * sizes[0] * sizes[1])
    if kind == "CylinderLight":
        length = max(_value(prim.GetAttribute("inputs:length"), time, 1.0), _LEAST)
        tube = revolved(np.array([[radius, -0.5 * length], [radius, 0.5 * length]]), _SEGMENTS)
        area = 2 * math.pi * radius * sizes[1] * length * sizes[0]
        return tube.corners[..., [2, 0, 1]], float(area)
    ball = sphere().corners * radius
    return ball, float(4 * math.pi * radius**2 * sizes[0] ** 2)


def _value(attribute: Any, time: Any, default: Any) -> Any:
    value = attribute.Get(time) if attribute else None
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return default
    return value
