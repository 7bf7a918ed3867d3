"""Specifications: everything random about a piece is drawn first, then it is built from that.

    class Pouf(Spec, piece=("pouf", "stool", "free")):
        radius: float = between(0.22, 0.3)

        def assemble(self, b: Builder) -> None: ...

    Pouf.draw(draw, style).build()

A field says how it is drawn; fields are drawn in their order. `piece` is its name, category and
anchor; clearances and a constant `mount_height` are given as `Builder` has them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple, Self, dataclass_transform

from pbrnet.scenes.procedural.furniture.parts.build import Builder, Print
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
    """A field that is one material with probability `share`, else another; see `material`."""
    return maybe(share, any_of(one), any_of(other))


def any_of(*which: Material | str) -> Any:
    """A field drawn from materials, each as likely; see `material`."""

    def one_of(draw: Draw, spec: Any) -> Material:
        found = [material(draw, spec.style, each) for each in which]
        return draw.pick(found) if len(found) > 1 else found[0]

    return drawn(one_of)


def one(kind: type[Spec]) -> Any:
    """A field that is a specification of a kind."""
    return drawn(lambda draw, spec: kind.draw(draw, spec.style))


def optional(share: float, kind: type[Spec]) -> Any:
    """A field that is a specification of a kind with probability `share`, else None."""
    return maybe(share, one(kind))


def several(kind: type[Spec], low: int, high: int) -> Any:
    """A field of [low, high) specifications of a kind."""
    return repeated(whole(low, high), one(kind))


def maybe(share: float | Callable[[Any], float], how: Any, otherwise: Any = None) -> Any:
    """A field drawn as another with probability `share`, else `otherwise`."""

    def chosen(draw: Draw, spec: Any) -> Any:
        return how if draw.chance(_value(share, draw, spec)) else otherwise

    return drawn(lambda draw, spec: _value(chosen(draw, spec), draw, spec))


def when(is_so: str | Callable[[Any], Any], how: Any, otherwise: Any = None) -> Any:
    """A field drawn as another if a field before it, or a function of those, is true."""
    so = is_so if callable(is_so) else attrgetter(is_so)
    return drawn(lambda draw, spec: _value(how if so(spec) else otherwise, draw, spec))


def by(feature: str, hows: Mapping[Any, Any], otherwise: Any = None) -> Any:
    """A field drawn as the value of a field before it says; `otherwise` for other values."""
    return drawn(lambda draw, spec: _value(hows.get(getattr(spec, feature), otherwise), draw, spec))


def ranged() -> Any:
    """A field that is given as its least and greatest value, and drawn between them."""
    return field(metadata={"of": lambda draw, limits: draw.between(*limits)})


def scaled(low: float, high: float, default: Any = MISSING) -> Any:
    """A field given as one or several lengths, each times a factor drawn from [low, high)."""
    return field(default=default, metadata={"of": lambda draw, of: times(draw, of, low, high)})


def times(draw: Draw, given: Any, low: float, high: float) -> Any:
    """Draw a factor for a length, or for each of several."""
    if isinstance(given, tuple):
        return tuple(length * draw.between(low, high) for length in given)
    return given * draw.between(low, high)


def printed() -> Any:
    """A field that is a part of a printed paper of the home."""
    return drawn(lambda draw, spec: Print.draw(draw, spec.style))


def repeated(count: Any, *hows: Any) -> Any:
    """A field of `count` values, each drawn as a field is; of tuples where several are given.

    `count` is a number, a field that draws one, or a function of the fields before.
    """

    def each(draw: Draw, spec: Any) -> Any:
        values = tuple(_value(how, draw, spec) for how in hows)
        return values if len(hows) > 1 else values[0]

    return drawn(lambda draw, it: tuple(each(draw, it) for _ in range(_value(count, draw, it))))


def _value(how: Any, draw: Draw, spec: Any) -> Any:
    """Value of a field drawn, of a function of the fields before, or the value itself."""
    if isinstance(how, Field):
        return how.metadata["how"](draw, spec)
    return how(spec) if callable(how) else how


def material(draw: Draw, style: Style, which: Material | str) -> Material:
    """The material itself, or the style's of a name, drawn from several or as its method does."""
    if isinstance(which, Material):
        return which
    found = getattr(style, which)
    if callable(found):
        found = found(draw)
    return draw.pick(found) if isinstance(found, tuple) else found


class Piece(NamedTuple):
    """Name, category, place and clearances of a piece, as `Builder` has them."""

    name: str
    category: str
    anchor: Anchor
    front_clearance: float = 0.0
    side_clearance: float = 0.0
    mount_height: float = 0.0


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
@dataclass(frozen=True, kw_only=True)
class Spec:
    """Specification of one piece: frozen, printable; equal ones build equal pieces."""

    piece: ClassVar[Piece]
    style: Style = field(repr=False)

    def __init_subclass__(
        cls,
        piece: tuple[str, str, Anchor] | None = None,
        front_clearance: float = 0.0,
        side_clearance: float = 0.0,
        mount_height: float = 0.0,
    ) -> None:
        if piece:
            cls.piece = Piece(*piece, front_clearance, side_clearance, mount_height)
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def draw(cls, draw: Draw, style: Style, **given: Any) -> Self:
        """Draw a specification; a field that is `given` (and not None) is not drawn.

        What is given for one that is `ranged` or `scaled` is what it is drawn from.
        """
        spec = object.__new__(cls)
        known = {each.name: each for each in fields(cls)}
        if unknown := given.keys() - known.keys():
            raise TypeError(f"{cls.__name__} has no {', '.join(sorted(unknown))}")
        found = vars(spec)  # also what the draws of later fields see; `spec` itself is frozen
        found |= {name: value for name, value in given.items() if value is not None}
        found["style"] = style
        for name, each in known.items():
            if "of" in each.metadata:
                found[name] = each.metadata["of"](draw, found.get(name, each.default))
            elif name not in found and "how" in each.metadata:
                found[name] = each.metadata["how"](draw, spec)
            elif name not in found:
                found[name] = each.default
        return spec

    @classmethod
    def is_piece(cls, module: str) -> bool:
        """Test whether this is a kind of piece, not a part of one, that a module defines."""
        return cls.__module__ == module and "piece" in vars(cls)

    @classmethod
    def make(cls, draw: Draw, style: Style, **given: Any) -> FurniturePiece:
        """Draw a specification and build it."""
        return cls.draw(draw, style, **given).build()

    def build(self) -> FurniturePiece:
        """Build the piece: no draws, no files."""
        return self.builder().piece()

    def builder(self) -> Builder:
        """The builder with the parts; fields named as those of `Piece` replace its values."""
        own = {name: value for name, value in vars(self).items() if name in Piece._fields}
        b = Builder(**self.piece._asdict() | own)
        self.assemble(b)
        return b

    def assemble(self, b: Builder) -> None:
        """Add the parts of the piece. Parts of pieces have other ways to be built."""
        raise NotImplementedError
