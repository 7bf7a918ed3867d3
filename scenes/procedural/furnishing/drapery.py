"""Cloth that people leave over furniture: throws, clothes over chairs and on beds, towels on rims.

Each is simulated on the piece that carries it, in that piece's frame.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furniture.parts.cloth import sampled
from pbrnet.scenes.procedural.furniture.parts.drapes import Cut, over, slices
from pbrnet.scenes.procedural.piece import FurniturePiece

# Garment -> outline, width and length in metres.
_CLOTHES: dict[str, tuple[Cut, float, float]] = {
    "jumper": ("shirt", 1.15, 0.68),
    "shirt": ("shirt", 1.0, 0.74),
    "jacket": ("shirt", 1.25, 0.8),
    "trousers": ("trousers", 0.42, 1.02),
    "scarf": ("sheet", 0.3, 1.5),
}
_BACK = 0.05  # metres below the top of a chair's back within which its middle is looked for
_RIDGE = 0.01  # metres below the top of a back from where a garment's highest part counts
_RESTS = 0.03  # metres, of cloth that lies on a back: half of the highest part is as near to it
_NARROWEST = 0.22  # metres, of a throw
_TRIES = 1
_MOST = 3  # pieces of cloth left in a room


def drape_cloth(furnisher: Furnisher) -> None:
    """Leave throws and clothes over the furniture of a room, by the home's disorder."""
    used: set[str] = set()
    for carrier in furnisher.rng.shuffled(furnisher.space.items):
        if carrier.kind not in _WAYS or carrier.piece.credit is not None or len(used) >= _MOST:
            continue
        base, slope, drape = _WAYS[carrier.kind]
        if not furnisher.chance(base + slope * furnisher.style.disorder):
            continue
        owners = {item.id for item in furnisher.space.items}
        for _ in range(_TRIES):
            made = drape(furnisher, carrier.piece, used)
            if made is None:
                continue
            kind = made.name.replace(" ", "_")
            if furnisher.space.try_place(
                kind, made, carrier.pose, zone=False, touching=(carrier.id,), allow=owners
            ):
                used.add(kind)
                break


def _over_back(
    furnisher: Furnisher, piece: FurniturePiece, used: set[str]
) -> FurniturePiece | None:
    """A garment over the back of a chair; None, too, if it slid down behind."""
    rng = furnisher.rng
    points = np.concatenate([sampled(part.vertices[part.faces]) for part in piece.parts])
    top = float(points[:, 2].max())
    upper = points[points[:, 2] > top - _BACK]
    middle = round(float(0.5 * (upper[:, 1].min() + upper[:, 1].max())), 4)
    low = 0.45 * top + 0.12  # above the seat
    behind = points[(points[:, 2] > low - 0.05) & (points[:, 1] > middle - 0.2)]
    behind = behind[np.abs(behind[:, 0]) <= np.abs(upper[:, 0]).max() + 0.01]
    name = _choose(furnisher, used)
    cut, width, length = _CLOTHES[name]
    at = (rng.normal(0, 0.02), middle + rng.normal(0, 0.02), top + 0.02)
    turn = rng.normal(0 if cut != "shirt" or rng.chance(0.5) else 180, 6)
    made = over(
        rng, piece, name, "clothing", furnisher.style.garment(rng), (width, length), at,
        turn=turn, cut=cut, within=slices(behind, low, 0.015), gap=0.008,
    )  # fmt: skip
    return made if made is not None and _lies_on(made, points) else None


def _lies_on(cloth: FurniturePiece, points: Float64Array) -> bool:
    """Return whether the highest part of a cloth lies on the top of a chair, points (N, 3)."""
    top = float(points[:, 2].max())
    faces = np.concatenate([part.vertices[part.faces] for part in cloth.parts])
    middles = faces.sum(axis=1) / 3
    ridge = middles[middles[:, 2] > top - _RIDGE]
    if cloth.bounds[1, 2] < top or len(ridge) == 0:
        return False
    distance, _ = cKDTree(points).query(ridge)
    return bool(np.median(distance) < _RESTS)


def _over_arm(furnisher: Furnisher, piece: FurniturePiece, used: set[str]) -> FurniturePiece | None:
    """A throw over an arm of a sofa or armchair."""
    rng = furnisher.rng
    low, high = piece.bounds
    side = -1.0 if rng.chance(0.5) else 1.0
    points = np.concatenate([part.vertices for part in piece.parts])
    front = points[(points[:, 1] < low[1] + 0.25) & (points[:, 0] * side > high[0] - 0.1)]
    top = float(front[:, 2].max())
    cushions = [part.vertices for part in piece.parts if part.name.startswith("cushion")]
    room = min((float(c[c[:, 0] * side > 0, 1].min(initial=9)) for c in cushions), default=9.0)
    size = (min(rng.between(0.3, 0.42), room - float(low[1]) - 0.1), rng.between(0.9, 1.25))
    if size[0] < _NARROWEST:
        return None
    x = side * (float(high[0]) - rng.between(0.08, 0.16))
    at = (x, float(low[1]) + 0.5 * size[0] + 0.05, top + 0.05)
    turn = 90.0 + rng.normal(0, 7)
    return over(
        rng, piece, "throw over an arm", "textile", furnisher.style.throw, size, at, turn=turn,
        tight=rng.between(0.06, 0.2), thickness=0.008,
    )  # fmt: skip


def _on_bed(furnisher: Furnisher, piece: FurniturePiece, used: set[str]) -> FurniturePiece | None:
    """A throw across the foot of a bed, or a garment dropped on it."""
    rng = furnisher.rng
    low, high = piece.bounds
    top = float(
        max(part.vertices[:, 2].max() for part in piece.parts if part.name.startswith("duvet"))
    )
    if rng.chance(0.5):
        size = (float(high[0] - low[0]) + rng.between(-0.1, 0.35), rng.between(0.4, 0.7))
        at = (rng.normal(0, 0.08), rng.between(-0.75, -0.35), top + 0.06)
        return over(
            rng, piece, "bed throw", "textile", furnisher.style.throw, size, at,
            turn=rng.normal(0, 6), tight=rng.between(0.03, 0.1), thickness=0.008,
            gap=0.014,
        )  # fmt: skip
    name = _choose(furnisher, used)
    cut, width, length = _CLOTHES[name]
    at = (float(rng.uniform(-0.3, 0.3) * high[0]), rng.between(-0.7, -0.2), top + 0.08)
    return over(
        rng, piece, name, "clothing", furnisher.style.garment(rng), (width, length), at,
        turn=rng.between(0, 360), tight=rng.between(0.15, 0.35), cut=cut, gap=0.014,
    )  # fmt: skip


def _choose(furnisher: Furnisher, used: set[str]) -> str:
    names = [name for name in _CLOTHES if name not in used]
    return furnisher.rng.pick(names)


_WAYS: dict[
    str, tuple[float, float, Callable[[Furnisher, FurniturePiece, set[str]], FurniturePiece | None]]
] = {
    # Kind of furniture -> chance in a tidy home, what disorder adds to it, and the way.
    "dining_chair": (0.02, 0.16, _over_back),
    "office_chair": (0.1, 0.5, _over_back),
    "sofa": (0.3, 0.2, _over_arm),
    "armchair": (0.15, 0.25, _over_arm),
    "double_bed": (0.25, 0.45, _on_bed),
    "single_bed": (0.25, 0.45, _on_bed),
}
