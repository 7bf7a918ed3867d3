"""Materials that are the same in all homes; imported as `m`."""

from __future__ import annotations

from pbrnet.scenes.color import Color, decode_srgb_value
from pbrnet.scenes.procedural.piece import Material


def hex_color(code: str) -> Color:
    """Return linear Rec. 709 RGB of an sRGB colour written as "#rrggbb"."""
    channels = [int(code[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    linear = [decode_srgb_value(channel) for channel in channels]
    return (linear[0], linear[1], linear[2])


def scaled_color(color: Color, factor: float) -> Color:
    """Return a linear RGB colour times `factor`."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)


CHROME = Material("metal", hex_color("#dcdde0"), roughness=0.08)
STEEL = Material("metal", hex_color("#bcbdbd"), roughness=0.32)
IRON = Material("metal", hex_color("#4a4a4b"), roughness=0.5)
GLASS = Material("glass", (0.95, 0.97, 0.96), roughness=0.0)
MIRROR = Material("mirror", (0.92, 0.92, 0.92), roughness=0.0)
CERAMIC = Material("ceramic", hex_color("#efeeea"), roughness=0.12)
WHITE_PLASTIC = Material("plastic", hex_color("#e9e8e4"), roughness=0.35)
BLACK_PLASTIC = Material("plastic", hex_color("#1d1e20"), roughness=0.4)
SCREEN = Material("plastic", hex_color("#0b0c0e"), roughness=0.12)
RUBBER = Material("plastic", hex_color("#26262a"), roughness=0.7)
WHITE_PAINT = Material("paint", hex_color("#ece9e2"), roughness=0.4)
PAGES = Material("paper", hex_color("#e8dfc9"), roughness=0.9)
SOIL = Material("soil", hex_color("#3a2a1e"), roughness=0.95)
TERRACOTTA = Material("ceramic", hex_color("#b4683f"), roughness=0.8, family="earthenware")
WICKER = Material(
    "wood", hex_color("#b08a58"), roughness=0.6, accent=hex_color("#7d5c36"), family="wicker"
)
