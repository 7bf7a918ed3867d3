"""Pieces of furniture for boxes: drawn with sizes as near as possible, then scaled a little.

The tables are in `fitting.yaml`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.checked import build
from pbrnet.scenes.contract import Joint, Point3
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, Style
from pbrnet.scenes.procedural.furniture.parts.geometry import box
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from pbrnet.scenes.procedural.piece import Anchor, FurniturePiece, PiecePart, shifted
from pbrnet.scenes.procedural.scene_item import make_part
from pbrnet.scenes.seeds import Draw

Place = Literal["floor", "ceiling", "raised"]
Extent = Literal["x", "y", "z", "r", "d"]  # "r", "d": radius and diameter seen from above

LEAST_IOU = 0.5  # of a piece and its box; below, the box stays plain
_CATALOGUE_IOU = 0.75  # least, of a catalogue piece; below, one is generated
_ENOUGH = 0.95  # no better piece is looked for
_DRAWS = 3  # of each kind
_MOST_KINDS = 8  # that are tried for one box
_ROW = 1.7  # of the width of one piece, from which several stand side by side
_LONGEST_ROW = 12  # pieces side by side
_STEPS = 1  # correction of the options of one draw
_THIN = (0.3, 3.0)  # scale of what is thin
_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class _Tables:
    """The tables of `fitting.yaml`."""

    kinds: dict[str, tuple[str, ...]]
    options: dict[str, dict[str, tuple[Extent, float, float]]]
    scale: tuple[float, float]
    round: tuple[str, ...]
    thin: dict[str, Literal["x", "y", "z"]]
    rows: dict[str, float]
    boxes: dict[str, Literal["upholstery", "wood", "cabinet", "lacquer"]]


_TABLES = build(_Tables, data_beside(__file__))


@dataclass(frozen=True)
class Fit:
    """A piece for a box, its kind, and the intersection over union of both."""

    piece: FurniturePiece
    kind: str
    iou: float


def kinds_for(category: str) -> tuple[str, ...]:
    """Kinds of furniture for a category, best first; none for an unknown one."""
    return _TABLES.kinds.get(category) or _OWN.get(category, ())


def fit_piece(
    rng: Draw,
    style: Style,
    category: str,
    size: Point3,
    place: Place = "floor",
    kind: str = "",
    sampler: AssetSampler | None = None,
) -> Fit | None:
    """Return the piece that fills a box of `size` (x, y, z) best; None if none fits.

    `place` is where the box stands, hangs or lies. `kind`, if it is known, is the only one that is
    tried. Pieces are scaled by at most the table's bounds.
    """
    wanted = np.array(size)
    known = kind in FURNITURE_KINDS or kind in THINGS
    kinds = (kind,) if known else _suited(kinds_for(category), place)
    if len(kinds) > _MOST_KINDS:
        kinds = tuple(rng.shuffled(kinds)[:_MOST_KINDS])
    best = _from_own(sampler, category, kinds, wanted) or _from_catalogue(sampler, kinds, wanted)
    if best is not None:
        return best
    for name in kinds:
        for piece in _candidates(rng, style, name, wanted):
            made = _scaled_to(piece, name, wanted)
            if best is None or made.iou > best.iou:
                best = made
            if best.iou >= _ENOUGH:
                return best
    return best if best is not None and best.iou >= (0.0 if known else LEAST_IOU) else None


def plain_box(style: Style, category: str, size: Point3) -> FurniturePiece:
    """A box of a category, in a material of the style."""
    material = getattr(style, _TABLES.boxes.get(category, "lacquer"))
    part = make_part("box", material, box(size, bevel=0.01))
    return FurniturePiece(category, category, (part,), "free")


def box_iou(first: Float64Array, second: Float64Array) -> float:
    """Intersection over union of two boxes (3,) with the same centre."""
    shared = float(np.minimum(first, second).prod())
    return shared / max(float(first.prod() + second.prod()) - shared, 1e-30)


def _suited(kinds: tuple[str, ...], place: Place) -> tuple[str, ...]:
    """The kinds that have their place there; all of them if none does."""
    unsuited = {"floor": _OFF_FLOOR, "raised": _NOT_RAISED, "ceiling": _NOT_RAISED - {"ceiling"}}
    suited = tuple(kind for kind in kinds if anchor_of(kind) not in unsuited[place])
    if place == "ceiling":
        suited = tuple(kind for kind in kinds if anchor_of(kind) == "ceiling") or suited
    return suited or kinds


_OFF_FLOOR = frozenset({"ceiling"})
_NOT_RAISED = frozenset({"ceiling", "corner", "centre"})


def anchor_of(kind: str) -> Anchor:
    """The place where pieces of a kind stand, hang or lie."""
    if kind in THINGS:
        return THINGS[kind].anchor
    return FURNITURE_KINDS[kind].piece.anchor if kind in FURNITURE_KINDS else "free"


def _from_own(
    sampler: AssetSampler | None, category: str, kinds: tuple[str, ...], wanted: Float64Array
) -> Fit | None:
    """The own piece that fills a box best; None if none fills it well."""
    found = sampler.own_pieces(category, kinds) if sampler is not None else []
    if sampler is None or not found:
        return None
    sizes = [np.array(entry.size) for entry, _ in found]
    ious = [
        box_iou(size * _factors(size, kind, wanted), wanted)
        for size, (_, kind) in zip(sizes, found, strict=True)
    ]
    best = int(np.argmax(ious))
    if ious[best] <= _CATALOGUE_IOU:
        return None
    entry, kind = found[best]
    return _scaled_to(sampler.take_own(entry, kind), kind, wanted)


def _from_catalogue(
    sampler: AssetSampler | None, kinds: Iterable[str], wanted: Float64Array
) -> Fit | None:
    """A piece of the catalogues that fills a box well; None if there is none."""
    if sampler is None:
        return None
    sizes = dict(zip(("width", "depth"), wanted.tolist(), strict=False))
    for kind in kinds:
        found = sampler.substitute(kind, sizes)
        if found is not None and (made := _scaled_to(found, kind, wanted)).iou > _CATALOGUE_IOU:
            return made
    return None


def _candidates(
    rng: Draw, style: Style, kind: str, wanted: Float64Array
) -> Iterable[FurniturePiece]:
    """Yield pieces of a kind, with options that make them about as large as wanted."""
    ones = float(wanted[0]) / _TABLES.rows.get(kind, float(wanted[0]))
    count = min(round(ones), _LONGEST_ROW) if ones > _ROW else 1
    for _ in range(_DRAWS):
        if kind in THINGS:
            yield THINGS[kind].make(rng, style)
        elif count == 1:
            yield from _sized(rng, style, kind, wanted)
        else:
            one = wanted / (count, 1.0, 1.0)
            yield _row([list(_sized(rng, style, kind, one))[-1] for _ in range(count)])


def _row(pieces: list[FurniturePiece]) -> FurniturePiece:
    """Pieces side by side as one."""
    left = -0.5 * sum(piece.size[0] for piece in pieces)
    parts, surfaces, joints = [], [], []
    for number, piece in enumerate(pieces):
        shift = left - float(piece.bounds[0, 0])
        for part in piece.parts:
            moved = part.vertices + np.array([shift, 0.0, 0.0])
            parts.append(replace(part, name=f"{part.name}_{number}", vertices=moved))
        surfaces += [replace(each, x=each.x + shift) for each in piece.surfaces]
        joints += [shifted(each, shift) for each in piece.joints]
        left += piece.size[0]
    made = replace(pieces[0], parts=tuple(parts), surfaces=tuple(surfaces), boxes=None)
    return replace(made, joints=tuple(joints))


def _sized(rng: Draw, style: Style, kind: str, wanted: Float64Array) -> Iterable[FurniturePiece]:
    """Yield one draw of a kind, and the same with its options corrected by what it missed."""
    extents = _TABLES.options.get(kind, {})
    options = {name: _clamped(_extent(wanted, how[0]), how) for name, how in extents.items()}
    spec = FURNITURE_KINDS[kind].draw(rng, style, **options)
    piece = spec.build()
    yield piece
    for _ in range(_STEPS if options else 0):
        made = np.array(piece.size)
        better: dict[str, Any] = {
            name: _clamped(
                getattr(spec, name) + _extent(wanted, how[0]) - _extent(made, how[0]), how
            )
            for name, how in extents.items()
        }
        if all(abs(better[name] - getattr(spec, name)) < 1e-3 for name in better):
            return
        spec = replace(spec, **better)
        piece = spec.build()
        yield piece


def _extent(size: Float64Array, which: Extent) -> float:
    if which in _AXES:
        return float(size[_AXES[which]])
    across = float(size[:2].mean())
    return 0.5 * across if which == "r" else across


def _clamped(value: float, how: tuple[Extent, float, float]) -> float:
    return round(min(max(value, how[1]), how[2]), 4)


def _scaled_to(piece: FurniturePiece, kind: str, wanted: Float64Array) -> Fit:
    """The piece scaled towards a size, within the bounds of the table."""
    size = np.maximum(np.array(piece.size), 1e-6)
    factors = _factors(size, kind, wanted)
    made = piece if (factors == 1).all() else scaled(piece, factors)
    return Fit(made, kind, box_iou(size * factors, wanted))


def _factors(size: Float64Array, kind: str, wanted: Float64Array) -> Float64Array:
    """Scale (3,) of a piece of a size (3,) towards the wanted one, within the table's bounds."""
    factors = np.clip(wanted / size, *_TABLES.scale)
    if kind in _TABLES.round:
        factors[:2] = np.clip(wanted[:2].mean() / size[:2].mean(), *_TABLES.scale)
    if kind in _TABLES.thin:
        axis = _AXES[_TABLES.thin[kind]]
        factors[axis] = np.clip(wanted[axis] / size[axis], *_THIN)
    return np.where(np.abs(factors - 1) < 2e-3, 1.0, factors)


def scaled(piece: FurniturePiece, factors: Float64Array) -> FurniturePiece:
    """The piece scaled by factors (3,) along its axes; textures keep their size."""

    def part(one: PiecePart) -> PiecePart:
        normals = one.given_normals
        if normals is not None:
            normals = normals / factors
            normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return replace(one, vertices=one.vertices * factors, given_normals=normals)

    x, y, z = factors.tolist()
    return replace(
        piece,
        parts=tuple(part(one) for one in piece.parts),
        surfaces=tuple(
            replace(
                each, x=x * each.x, y=y * each.y, z=z * each.z,
                half_x=x * each.half_x, half_y=y * each.half_y, headroom=z * each.headroom,
            )
            for each in piece.surfaces
        ),
        mount_height=piece.mount_height,
        boxes=None if piece.boxes is None else piece.boxes * factors,
        joints=tuple(_scaled_joint(one, factors) for one in piece.joints if _stays(one, x == y)),
    )  # fmt: skip


def _stays(joint: Joint, even: bool) -> bool:
    """Test whether a joint remains one: not a hinge that is open, unless the scale is even."""
    return joint.kind == "slide" or joint.value == 0 or even


def _scaled_joint(joint: Joint, factors: Float64Array) -> Joint:
    def scale(point: Point3) -> Point3:
        return as_triple(np.array(point) * factors)

    reach = float(factors[1]) if joint.kind == "slide" else 1.0  # along y
    boxes = tuple((scale(low), scale(high)) for low, high in joint.boxes)
    limits = (reach * joint.limits[0], reach * joint.limits[1])
    made = replace(joint, pivot=scale(joint.pivot), boxes=boxes, limits=limits)
    return replace(made, value=reach * joint.value)


def _own_kinds() -> Mapping[str, tuple[str, ...]]:
    """Kinds by the category that their pieces have."""
    found: dict[str, list[str]] = {}
    for name, kind in FURNITURE_KINDS.items():
        found.setdefault(kind.piece.category, []).append(name)
    for name, thing in THINGS.items():
        found.setdefault(thing.category, []).append(name)
    return {category: tuple(names) for category, names in found.items()}


_OWN = _own_kinds()
