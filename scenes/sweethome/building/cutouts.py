"""Parser of cut-out shapes of doors, windows and stairwells: SVG paths in the unit square, y down.

All commands of SVG 1.1 (M L H V C S Q T A Z, absolute and relative).
"""

from __future__ import annotations

import cmath
import math
import re
from itertools import pairwise

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.geometry.regions import buffered, symmetric_difference, union, valid

_TOKEN = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_ARGUMENTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_STEPS = 12  # segments of a curve
_MAX_TOKENS = 20_000


class UnreadablePath(ValueError):
    """A text that is not a valid SVG path."""


def path_region(text: str) -> Polygon:
    """Return the region that a path encloses (even-odd rule); raises `UnreadablePath`."""
    rings = [ring for ring in _rings(text) if len(ring) >= 3]
    region = None
    for ring in rings:
        points = np.array([[point.real, point.imag] for point in ring])
        shape = buffered(valid(Polygon(points)), 0)
        region = shape if region is None else symmetric_difference(region, shape)
    if region is None or region.is_empty or not np.isfinite(region.area):
        raise UnreadablePath("it encloses nothing")
    return union([region])


def _rings(text: str) -> list[list[complex]]:
    tokens = _TOKEN.findall(text)
    if len(tokens) > _MAX_TOKENS:
        raise UnreadablePath("it is too long")
    rings: list[list[complex]] = []
    ring: list[complex] = []
    at = start = 0j
    control = 0j  # of the curve before, for the smooth commands
    command, before = "", ""
    position = 0
    while position < len(tokens):
        letter, _ = tokens[position]
        if letter:
            command = letter
            position += 1
        elif not command or command in "Zz":
            raise UnreadablePath("a number stands where a command should")
        kind, relative = command.upper(), command.islower()
        count = _ARGUMENTS[kind]
        numbers = [float(value or "nan") for _, value in tokens[position : position + count]]
        if len(numbers) < count or not all(map(math.isfinite, numbers)):
            raise UnreadablePath(f"command {command} lacks numbers")
        position += count
        base = at if relative else 0j
        if kind == "M":
            if ring:
                rings.append(ring)
            at = start = base + complex(*numbers)
            ring = [at]
            command = "l" if relative else "L"
        elif kind == "Z":
            if ring:
                rings.append(ring)
            at, ring = start, []
        else:
            ring = ring or [at]
            if kind == "H":
                target = complex(base.real + numbers[0], at.imag)
                ring.append(target)
            elif kind == "V":
                target = complex(at.real, base.imag + numbers[0])
                ring.append(target)
            elif kind == "A":
                target = base + complex(*numbers[5:])
                ring += _arc(at, target, numbers)
            else:
                points = [base + complex(*numbers[k : k + 2]) for k in range(0, count, 2)]
                if kind in "ST":
                    smooth = before in ("CS" if kind == "S" else "QT")
                    points.insert(0, 2 * at - control if smooth else at)
                target = points[-1]
                control = points[-2] if len(points) > 1 else at
                ring += _curve([at, *points])
            at = target
        before = kind
    if ring:
        rings.append(ring)
    return rings


def _curve(points: list[complex]) -> list[complex]:
    """Points of a Bézier curve of any degree (de Casteljau), without the first point."""
    if len(points) == 2:
        return points[1:]
    made = []
    for step in range(1, _STEPS + 1):
        t, row = step / _STEPS, points
        while len(row) > 1:
            row = [(1 - t) * a + t * b for a, b in pairwise(row)]
        made.append(row[0])
    return made


def _arc(start: complex, end: complex, numbers: list[float]) -> list[complex]:
    """Points of an elliptic arc, without the first (SVG 1.1, appendix F.6)."""
    rx, ry = abs(numbers[0]), abs(numbers[1])
    if rx == 0 or ry == 0 or start == end:
        return [end]
    turn = cmath.exp(1j * math.radians(numbers[2]))
    half = (start - end) / 2 / turn
    spread = (half.real / rx) ** 2 + (half.imag / ry) ** 2
    if spread > 1:
        rx, ry, spread = rx * math.sqrt(spread), ry * math.sqrt(spread), 1.0
    factor = math.sqrt(max(1 / spread - 1, 0.0))
    if (numbers[3] != 0) == (numbers[4] != 0):
        factor = -factor
    centre = factor * complex(rx * half.imag / ry, -ry * half.real / rx)
    first = _angle(half - centre, rx, ry)
    sweep = _angle(-half - centre, rx, ry) - first
    if numbers[4] != 0 and sweep < 0:
        sweep += 2 * math.pi
    elif numbers[4] == 0 and sweep > 0:
        sweep -= 2 * math.pi
    middle = (start + end) / 2 + centre * turn
    steps = max(2, math.ceil(abs(sweep) / (math.pi / 16)))
    angles = [first + sweep * step / steps for step in range(1, steps)]
    return [
        *(middle + complex(rx * math.cos(a), ry * math.sin(a)) * turn for a in angles),
        end,
    ]


def _angle(point: complex, rx: float, ry: float) -> float:
    return math.atan2(point.imag / ry, point.real / rx)
