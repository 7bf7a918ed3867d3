"""Specifications: everything random about a piece is drawn first, then it is built from that.

    class Pouf(Spec, piece=("pouf", "stool", "free")):
        radius: float = between(0.22, 0.3)

        def assemble(self, b: Builder) -> None: ...

    Pouf.draw(draw, style).build()

A field says how it is drawn; fields are drawn in their order. `piece` is its name, category and
anchor; clearances and a constant `mount_height` are given as `Builder` has them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Self, dataclass_transform

from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Anchor, FurniturePiece, Material
from pbrnet.scenes.seeds import Draw


def drawn(how: Callable[[Draw, Any], Any]) -> Any:
    """A field whose value is `how(draw, spec)`; `spec` has the style and the fields before it."""
    return field(metadata={"how": how})


def between(low: float, high: float) -> Any:
    """A field drawn uniformly from [low, high)."""
    return drawn(lambda draw, spec: draw.between(low, high))


def whole(low: int, high: int) -> Any:
    """A field drawn from the whole numbers [low, high)."""
    return drawn(lambda draw, spec: draw.whole(low, high))


def chance(share: float) -> Any:
    """A field that is true with probability `share`."""
    return drawn(lambda draw, spec: draw.chance(share))


def pick(*items: Any) -> Any:
    """A field drawn from items, each as likely."""
    return drawn(lambda draw, spec: draw.pick(items))


def shape(feature: str, *variants: str) -> Any:
    """A field drawn from the variants that the style has of a feature, else from all."""
    return drawn(lambda draw, spec: spec.style.shape(draw, feature, variants))


def either(share: float, one: Material | str, other: Material | str) -> Any:
    """A field that is one material with probability `share`, else another.

    Names are those of the style's materials; "accents" stands for any of its first five accents.
    """
    return drawn(
        lambda draw, spec: material(draw, spec.style, one if draw.chance(share) else other)
    )


def any_of(which: str) -> Any:
    """A field drawn from the style's materials of a name: "accents", "cushions", "books"."""
    return drawn(lambda draw, spec: material(draw, spec.style, which))


def one(kind: type[Spec]) -> Any:
    """A field that is a specification of a kind."""
    return drawn(lambda draw, spec: kind.draw(draw, spec.style))


def optional(share: float, kind: type[Spec]) -> Any:
    """A field that is a specification of a kind with probability `share`, else None."""
    return drawn(lambda draw, spec: kind.draw(draw, spec.style) if draw.chance(share) else None)


def optional_of(share: float, which: str) -> Any:
    """A field that is one of the style's materials of a name with a probability, else None."""
    return drawn(
        lambda draw, spec: material(draw, spec.style, which) if draw.chance(share) else None
    )


def several(kind: type[Spec], low: int, high: int) -> Any:
    """A field of [low, high) specifications of a kind."""
    return drawn(
        lambda draw, spec: tuple(kind.draw(draw, spec.style) for _ in range(draw.whole(low, high)))
    )


def repeated(count: int | Callable[[Any], int], *hows: Any) -> Any:
    """A field of `count` values, each drawn as a field is; of tuples where several are given.

    `count` may depend on the fields before.
    """
    draws = [how.metadata["how"] for how in hows]

    def each(draw: Draw, spec: Any) -> Any:
        values = tuple(one(draw, spec) for one in draws)
        return values if len(draws) > 1 else values[0]

    def all_of(draw: Draw, spec: Any) -> tuple[Any, ...]:
        return tuple(each(draw, spec) for _ in range(count(spec) if callable(count) else count))

    return drawn(all_of)


def material(draw: Draw, style: Style, which: Material | str) -> Material:
    """The material itself, or the style's of that name, drawn where it has several."""
    if isinstance(which, Material):
        return which
    found = getattr(style, which)
    return draw.pick(found) if isinstance(found, tuple) else found


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
@dataclass(frozen=True, kw_only=True)
class Spec:
    """Specification of one piece: frozen, printable; equal ones build equal pieces."""

    _piece: ClassVar[tuple[str, str, Anchor, float, float, float]]
    style: Style = field(repr=False)

    def __init_subclass__(
        cls,
        piece: tuple[str, str, Anchor] | None = None,
        front_clearance: float = 0.0,
        side_clearance: float = 0.0,
        mount_height: float = 0.0,
    ) -> None:
        if piece:
            cls._piece = (*piece, front_clearance, side_clearance, mount_height)
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def draw(cls, draw: Draw, style: Style, **given: Any) -> Self:
        """Draw a specification; a field that is `given` (and not None) is not drawn."""
        spec = object.__new__(cls)
        known = {each.name: each for each in fields(cls)}
        if unknown := given.keys() - known.keys():
            raise TypeError(f"{cls.__name__} has no {', '.join(sorted(unknown))}")
        found = vars(spec)  # also what the draws of later fields see; `spec` itself is frozen
        found |= {name: value for name, value in given.items() if value is not None}
        found["style"] = style
        for name, each in known.items():
            if name not in found and "how" in each.metadata:
                found[name] = each.metadata["how"](draw, spec)
            elif name not in found:
                found[name] = each.default
        return spec

    @classmethod
    def is_piece(cls, module: str) -> bool:
        """Test whether this is a kind of piece, not a part of one, that a module defines."""
        return cls.__module__ == module and "_piece" in vars(cls)

    @classmethod
    def category(cls) -> str:
        """The category of the piece."""
        return cls._piece[1]

    @classmethod
    def anchor(cls) -> Anchor:
        """The place where the piece stands, hangs or lies."""
        return cls._piece[2]

    @classmethod
    def make(cls, draw: Draw, style: Style, **given: Any) -> FurniturePiece:
        """Draw a specification and build it."""
        return cls.draw(draw, style, **given).build()

    def build(self) -> FurniturePiece:
        """Build the piece: no draws, no files."""
        b = Builder(*self._piece)
        b.mount_height = vars(self).get("mount_height", b.mount_height)
        self.assemble(b)
        return b.piece()

    def assemble(self, b: Builder) -> None:
        """Add the parts of the piece. Parts of pieces have other ways to be built."""
        raise NotImplementedError
