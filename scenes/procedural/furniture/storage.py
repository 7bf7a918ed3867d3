"""Cupboards and shelves with their contents: books, vases, baskets, clothes, shoes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    FRONT,
    add_door,
    add_drawer,
    add_drawers,
    add_feet,
    carcass,
    left_open,
    pulled_out,
    shelf,
)
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    chance,
    drawn,
    either,
    several,
    when,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw


class Book(NamedTuple):
    """One book of a row: metres, degrees that it leans, depth behind the front of the row."""

    thickness: float
    height: float
    lean: float
    back: float
    binding: Material


class Books(Spec):
    """A row of books on a shelf from x = `low` to `high`, with spines at about y = `front`.

    Books differ in size and colour and are at most `deep` deep; one in twelve leans.
    """

    low: float
    high: float
    z: float
    front: float
    headroom: float
    deep: float = 0.2
    books: tuple[Book, ...] = drawn(lambda draw, spec: tuple(_books(draw, spec)))

    def add_to(self, b: Builder) -> None:
        """Add the row, an object of its own."""
        x, row = self.low + 0.004, Builder("", "", "free")
        for book in self.books:
            deep = min(0.16, max(0.11, 0.68 * book.height), self.deep - 0.018)
            cover, pages = _book(book.thickness, book.height, deep)
            sine, _ = _slope(book.lean)
            # A leaning book touches the shelf with its lower right corner.
            z = self.z + float(book.thickness * sine)
            at = (x + float(book.height * sine), self.front + book.back, z)
            row.add(book.binding, cover.turned("y", -book.lean).moved(*at), name="books")
            row.add(m.PAGES, pages.turned("y", -book.lean).moved(*at), name="pages")
            x += _needed(book.thickness, book.height, book.lean) + 0.0008
        with b.holding("books", "books"):
            b.add_from(row)


def _books(draw: Draw, row: Books) -> Iterator[Book]:
    bindings = draw.shuffled(row.style.books)[:_BINDINGS]
    x, stop = row.low + 0.004, row.low + 1.0 * (row.high - row.low)
    while True:
        thickness = draw.between(0.014, 0.045)
        height = min(draw.normal(0.22, 0.03), row.headroom - 0.015)
        lean = draw.between(6, 16) if draw.chance(0.08) else 0.0
        need = _needed(thickness, height, lean)
        if x + need > stop or height < 0.1:
            return
        yield Book(thickness, height, lean, draw.between(0.0, 0.018), draw.pick(bindings))
        x += need + 0.0008


def _slope(lean: float) -> tuple[Any, Any]:
    """Sine and cosine of an angle in degrees."""
    return np.sin(np.radians(lean)), np.cos(np.radians(lean))


def _needed(thickness: float, height: float, lean: float) -> float:
    """Width that a leaning book takes, metres."""
    sine, cosine = _slope(lean)
    return float(thickness * cosine + height * sine)


_BINDINGS = 4  # colours of the books in a row


def _book(thickness: float, height: float, depth: float) -> tuple[g.BodyMesh, g.BodyMesh]:
    """Binding and pages of a book: spine at y = 0, bottom at z = 0, left cover at x = 0."""
    board = 0.0022
    cover = [
        g.span((0, 0.0, 0), (thickness, board, height)),
        g.span((0, board, 0), (board, depth, height)),
        g.span((thickness - board, board, 0), (thickness, depth, height)),
    ]
    pages = g.span((board, board, 0.003), (thickness - board, depth - 0.004, height - 0.004))
    return g.merge(cover), pages


class LyingBook(Spec):
    """A book of a stack."""

    thickness: float = between(0.015, 0.035)
    height: float = between(0.19, 0.26)
    askew: float = between(-8, 8)
    binding: Material = any_of("books")


def add_stack(
    b: Builder, books: Iterable[LyingBook], x: float, y: float, z: float, turn: float = 0.0
) -> None:
    """Add a stack of books at (x, y, z)."""
    for book in books:
        thickness, height = book.thickness, book.height
        cover, pages = _book(thickness, height, 0.7 * height)
        for material, mesh, name in ((book.binding, cover, "books"), (m.PAGES, pages, "pages")):
            lying = mesh.moved(-thickness / 2, -0.35 * height, -height / 2).turned("y", 90)
            lying = lying.turned("z", 90 + (turn + book.askew)).moved(x, y, z + thickness / 2)
            b.add(material, lying, name=name)
        z += thickness + 0.0004


class VaseBody(Spec):
    """The body of a vase with an open mouth, `height` metres high."""

    height: float
    wide: float = between(0.28, 0.42)
    mouth: float = between(0.35, 0.75)
    belly: float = between(0.8, 1.5)

    def mesh(self) -> g.BodyMesh:
        """The vase, standing at the origin."""
        height, width = self.height, self.wide * self.height
        mouth, t = self.mouth * width, np.linspace(0, 1, 17)
        swell = (width - 0.5 * mouth) * np.sin(np.pi * t**self.belly) * 0.6
        outer = 0.55 * width * (1 - t) + mouth * t + swell
        outer *= width / outer.max()
        profile = [(float(r), float(h)) for r, h in zip(outer, t * height, strict=True)]
        wall = 0.005
        profile += [(profile[-1][0] - wall, height), (0.9 * profile[-3][0] - wall, 0.86 * height)]
        return g.lathe([*profile, (0.6 * mouth, 0.7 * height)], 24)


def add_basket(
    b: Builder, at: Sequence[float], half: Sequence[float], tall: float, power: float = 5.0
) -> None:
    """Add an open basket; `power` 2 is round, higher powers approach a rectangle."""
    walls = ((0.02, 0.0), (0.0, tall), (0.008, tall), (0.026, 0.012))
    rings = [g.superellipse(half[0] - dx, half[1] - dx, height, power, 28) for dx, height in walls]
    b.add(m.WICKER, g.loft(rings).moved(*at), name="basket")


class Level(NamedTuple):
    """One board of a bookshelf: rows of books, a stack, baskets, room for things between x's."""

    rows: tuple[Books, ...] = ()
    stack: tuple[LyingBook, ...] = ()
    stack_x: float = 0.0
    baskets: str = ""
    free: tuple[float, float] = (0.0, 0.0)


class Bookshelf(Spec, piece=("bookshelf", "bookshelf", "wall"), front_clearance=0.5):
    """A tall open shelf with rows and stacks of books and baskets, and room for things."""

    width: float = between(0.7, 1.1)
    height: float = between(1.75, 2.1)
    depth: float = between(0.28, 0.33)
    levels: tuple[Level, ...] = drawn(lambda draw, it: tuple(_level(draw, it, z) for z in it.zs))

    @property
    def count(self) -> int:
        return max(2, round((self.height - 0.08) / 0.34))

    @property
    def zs(self) -> list[float]:
        """Heights of the boards."""
        first = 0.06 + BOARD
        return [first + k * (self.height - 0.078) / self.count for k in range(self.count)]

    @property
    def headroom(self) -> float:
        return (self.height - 0.078) / self.count - BOARD - 0.004

    @property
    def ends(self) -> tuple[float, float]:
        """Between the sides: least and greatest x."""
        return -self.width / 2 + BOARD + 0.004, self.width / 2 - BOARD - 0.004

    def assemble(self, b: Builder) -> None:
        width, depth, height, wood = self.width, self.depth, self.height, self.style.cabinet
        b.add(wood, *carcass(width, depth + FRONT, 0.06, height))
        low = (-width / 2 + 0.019, -depth / 2 + 0.03, 0)
        b.add(wood, g.span(low, (width / 2 - 0.019, depth / 2, 0.06)))
        for z in self.zs[1:]:
            b.add(wood, shelf(width, depth + FRONT, z))
        left, right = self.ends
        for z, level in zip(self.zs, self.levels, strict=True):
            half = (min(0.17, (right - left) / 4 - 0.01), depth / 2 - 0.045)
            for share in (0.25, 0.75) if level.baskets else ():
                with b.holding(level.baskets, "box"):
                    at = (left + share * (right - left), 0.0, z)
                    add_basket(b, at, half, min(0.2, 0.7 * self.headroom))
            for row in level.rows:
                row.add_to(b)
            if level.stack:
                with b.holding("books", "books"):
                    add_stack(b, level.stack, level.stack_x, 0.0, z)
            begin, end = level.free
            if end - begin > 0.1:
                half = (0.5 * (end - begin) - 0.012, depth / 2 - 0.05)
                b.surface(0.5 * (begin + end), 0.0, z, *half, self.headroom - 0.01)
        b.surface(0, 0.01, height, width / 2 - 0.05, depth / 2 - 0.03)


def _level(draw: Draw, shelf: Bookshelf, z: float) -> Level:
    kind = draw.random()
    if z == shelf.zs[0] and kind < 0.14:
        return Level(baskets=draw.pick(("basket", "open box", "rush basket")))
    # One or two rows of books from the sides, then a stack or room for things between them.
    left, right = begin, end = shelf.ends
    rows: list[Books] = []

    def row(low: float, high: float) -> None:
        front, headroom = -shelf.depth / 2 + 0.045, shelf.headroom
        given = {"low": low, "high": high, "z": z, "front": front, "headroom": headroom}
        rows.append(Books.draw(draw, shelf.style, **given))

    if kind < 0.85:
        begin += draw.between(0.25, 0.6) * (right - left)
        row(left, begin)
    if kind > 0.55:
        end -= draw.between(0.15, 0.32) * (right - left)
        row(end, right)
    stack: tuple[LyingBook, ...] = ()
    stack_x = end - 0.14
    if end - begin > 0.3 and draw.chance(0.3):
        stack = tuple(LyingBook.draw(draw, shelf.style) for _ in range(draw.whole(2, 5)))
        end -= 0.28
    return Level(tuple(rows), stack, stack_x, free=(begin, end))


class Garment(NamedTuple):
    """A garment on a rail along x."""

    x: float
    cloth: Material
    length: float  # metres
    phase: float  # of its folds


def _garments(draw: Draw, style: Style, low: float, high: float) -> Iterator[Garment]:
    """Draw the garments that hang between two places along a rail."""
    x = low + 0.07
    while x < high - 0.06:
        cloth = draw.pick((*style.cushions, style.throw, style.bedding, style.upholstery))
        yield Garment(x, cloth, draw.between(0.65, 1.1), draw.between(0, 6.28))
        x += draw.between(0.075, 0.11)


def _add_clothes(b: Builder, width: float, rail: float, garments: Iterable[Garment]) -> None:
    """Add a rail at the height `rail` through a wardrobe, and garments on hangers."""
    ends = (-width / 2 + 0.02, 0, rail), (width / 2 - 0.02, 0, rail)
    b.add(m.CHROME, g.bar(*ends, 0.012, 12), name="rail")
    t, angle = np.linspace(0, 1, 9), 2 * np.pi * np.arange(24) / 24
    half_wide = np.interp(t, [0, 0.08, 0.2, 1], [0.05, 0.19, 0.22, 0.24])
    half_thick = np.interp(t, [0, 0.08, 1], [0.012, 0.02, 0.028])
    for x, cloth, length, phase in garments:
        rings = np.empty((9, 24, 3))
        for k in range(9):
            fold = 1 + 0.3 * t[k] * np.sin(5 * angle + phase)
            rings[k, :, 0] = half_thick[k] * np.cos(angle) * fold
            rings[k, :, 1] = half_wide[k] * np.sin(angle)
            rings[k, :, 2] = -0.07 - length * t[k]
        b.add(cloth, g.loft(rings[::-1]).moved(x, 0.0, rail), name="garment")
        b.add(m.CHROME, g.bar((x, 0, rail - 0.08), (x, 0, rail + 0.012), 0.003, 8), name="hanger")


class Wardrobe(Spec, piece=("wardrobe", "wardrobe", "wall"), front_clearance=0.7):
    """A wardrobe of two or three doors; clothes hang behind a door that is ajar."""

    width: float = between(1.0, 1.6)
    depth: float = between(0.57, 0.62)
    height: float = between(1.95, 2.2)
    drawers: float = drawn(lambda draw, spec: 0.0 if draw.chance(0.5) else 0.22)
    ajar: int = drawn(lambda draw, spec: left_open(draw, spec.style, spec.doors))
    angle: float = drawn(lambda draw, spec: draw.between(18, 65) if spec.ajar < spec.doors else 0.0)
    garments: tuple[Garment, ...] = drawn(lambda draw, spec: _behind(draw, spec))

    @property
    def doors(self) -> int:
        return 2 if self.width < 1.25 else 3

    def assemble(self, b: Builder) -> None:
        style, width, depth, height = self.style, self.width, self.depth, self.height
        finish, base = style.cabinet, 0.07
        b.add(finish, *carcass(width, depth, base, height))
        plinth = g.box((width - 0.01, depth - 0.08, base + 0.001), (0, 0.03, 0))
        top = g.box((width + 0.02, depth + 0.012, 0.025), (0, 0.0, height - 0.001), 0.004)
        b.add(finish, plinth, top)
        each, bottom = width / self.doors, base + self.drawers
        for k in range(self.doors):
            x0 = -width / 2 + k * each
            hinge = "left" if k == 0 or (self.doors == 3 and k == 1) else "right"
            angle = self.angle if k == self.ajar else 0.0
            add_door(b, style, finish, x0, x0 + each, bottom, height - 0.002, depth, hinge, angle)
            if self.drawers:
                add_drawer(b, style, finish, style.wood, x0, x0 + each, base, bottom, depth)
        if self.drawers:
            b.add(finish, shelf(width, depth, bottom + 0.001))
        if self.ajar < self.doors:
            _add_clothes(b, width, height - 0.14, self.garments)
        b.surface(0, 0, height + 0.024, width / 2 - 0.05, depth / 2 - 0.05)


def _behind(draw: Draw, spec: Wardrobe | BuiltInWardrobe) -> tuple[Garment, ...]:
    """Draw the garments behind the door of a wardrobe that is ajar."""
    if spec.ajar >= spec.doors:
        return ()
    each, left = spec.width / spec.doors, -spec.width / 2
    ends = left + spec.ajar * each, left + (spec.ajar + 1) * each
    return tuple(_garments(draw, spec.style, *ends))


class BuiltInWardrobe(Spec, piece=("built-in wardrobe", "wardrobe", "wall"), front_clearance=0.7):
    """A wardrobe from wall to wall and up to the ceiling, its upper doors above 2.05 metres."""

    width: float = between(1.5, 3.0)
    height: float = between(2.4, 2.7)
    depth: float = between(0.58, 0.64)
    finish: Material = either(0.6, "lacquer", "cabinet")
    doors: int = drawn(lambda draw, spec: max(2, round(spec.width / draw.between(0.45, 0.6))))
    ajar: int = drawn(lambda draw, spec: draw.whole(2 * spec.doors))  # from `doors` on: all closed
    angle: float = drawn(lambda draw, spec: draw.between(18, 60) if spec.ajar < spec.doors else 0.0)
    garments: tuple[Garment, ...] = drawn(lambda draw, spec: _behind(draw, spec))

    def assemble(self, b: Builder) -> None:
        style, width, depth, finish = self.style, self.width, self.depth, self.finish
        base, top = 0.07, self.height - 0.05
        split = min(2.05, top - 0.22)
        b.add(finish, *carcass(width, depth, base, top))
        b.add(
            finish,
            g.box((width - 0.01, depth - 0.08, base + 0.001), (0, 0.03, 0)),
            g.box((width - 0.002, depth - 0.04, 0.051), (0, 0.012, top - 0.001)),
            shelf(width, depth, split + 0.009),
        )
        each = width / self.doors
        for k in range(self.doors):
            x0 = -width / 2 + k * each
            door, hinge = (b, style, finish, x0, x0 + each), "left" if k % 2 == 0 else "right"
            angle = self.angle if k == self.ajar else 0.0
            add_door(*door, base, split, depth, hinge, angle)
            add_door(*door, split, top - 0.002, depth, hinge, handle_low=True)
        if self.ajar < self.doors:
            _add_clothes(b, width, split - 0.1, self.garments)


def _add_body(
    b: Builder, spec: Any, foot: float, legs: Sequence[float], top: float, over: Sequence[float]
) -> None:
    """Add feet, carcass and top of a low cabinet.

    `legs`: sizes for `feet` after their height; `top` is thick, and reaches `over` the sides and
    the front by metres.
    """
    width, depth, height, finish = spec.width, spec.depth, spec.height, spec.style.cabinet
    add_feet(b, spec.style, spec.style.wood, width, depth, foot + 0.002, *legs)
    b.add(finish, *carcass(width, depth, foot, height - top))
    size = (width + over[0], depth + over[1], top)
    b.add(finish, g.box(size, (0, 0, height - top), 0.003))


class ChestOfDrawers(Spec, piece=("chest of drawers", "chest", "wall"), front_clearance=0.6):
    """A chest of three or four drawers on feet, sometimes one pulled out."""

    width: float = between(0.75, 1.1)
    depth: float = between(0.42, 0.5)
    height: float = between(0.78, 1.05)
    pulled: tuple[float, ...] = pulled_out(lambda chest: chest.rows, 0.08, 0.22)
    linen: bool = drawn(lambda draw, spec: any(spec.pulled) and draw.chance(0.8))

    @property
    def rows(self) -> int:
        return 3 if self.height < 0.9 else 4

    def assemble(self, b: Builder) -> None:
        style, width, depth, height = self.style, self.width, self.depth, self.height
        finish, foot = style.cabinet, 0.11
        add_feet(b, style, style.wood, width, depth - FRONT, foot + 0.002, 0.045, 0.015)
        b.add(finish, *carcass(width, depth, foot, height - 0.024))
        b.add(finish, g.box((width + 0.016, depth + 0.012, 0.025), (0, 0, height - 0.025), 0.003))
        zs = np.linspace(foot, height - 0.026, self.rows + 1)
        for k, out in enumerate(self.pulled):
            add_drawers(b, style, finish, style.wood, width / 2, zs[k : k + 2], depth, (out,))
            if out and self.linen:
                cloth = style.cushions[k % len(style.cushions)]
                for x in np.arange(-width / 2 + 0.15, width / 2 - 0.13, 0.2):
                    at = (float(x), -depth / 2 - out + 0.22, float(zs[k]) + 0.035)
                    b.add(cloth, g.rounded_box((0.18, 0.3, 0.08), at, 0.03), name="linen")
        b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)


class Sideboard(Spec, piece=("sideboard", "sideboard", "wall"), front_clearance=0.5):
    """A sideboard: doors at the sides, drawers between them."""

    width: float = between(1.3, 1.9)
    depth: float = between(0.4, 0.46)
    height: float = between(0.68, 0.85)
    ajar: int = drawn(lambda draw, spec: left_open(draw, spec.style, 3))
    angle: float = drawn(lambda draw, spec: draw.between(15, 60) if spec.ajar in (0, 2) else 0.0)

    def assemble(self, b: Builder) -> None:
        style, width, depth, finish = self.style, self.width, self.depth, self.style.cabinet
        foot, third, top = 0.15, width / 3, self.height - 0.024
        _add_body(b, self, foot, (0.045, 0.05, 0.02), 0.022, (0.01, 0.006))
        for k, hinge in ((0, "left"), (2, "right")):
            x0 = -width / 2 + k * third
            angle = self.angle if self.ajar == k else 0.0
            add_door(b, style, finish, x0, x0 + third, foot, top, depth, hinge, angle)
            x = x0 + third * (k == 0)
            low = (x - 0.009, -depth / 2 + 0.03, foot + BOARD)
            b.add(finish, g.span(low, (x + 0.009, depth / 2 - 0.013, top - BOARD)))
        add_drawers(b, style, finish, style.wood, third / 2, np.linspace(foot, top, 4), depth)
        b.surface(0, 0, self.height, width / 2 - 0.05, depth / 2 - 0.05)


class TvStand(Spec, piece=("tv stand", "tv stand", "wall"), front_clearance=0.4):
    """A television stand: an open compartment with a player between two doors."""

    width: float = between(1.2, 1.8)
    depth: float = between(0.38, 0.45)
    height: float = between(0.42, 0.55)
    player: bool = chance(0.25)
    books: tuple[LyingBook, ...] = several(LyingBook, 1, 4)

    def assemble(self, b: Builder) -> None:
        width, depth, finish = self.width, self.depth, self.style.cabinet
        foot, third, top = 0.1, width / 3, self.height - 0.024
        _add_body(b, self, foot, (0.04, 0.04, 0.01), 0.022, (0.008, 0.006))
        for k, hinge in ((0, "left"), (2, "right")):
            x0 = -width / 2 + k * third
            add_door(b, self.style, finish, x0, x0 + third, foot, top, depth, hinge)
            x = x0 + third * (k == 0)
            low = (x - 0.009, -depth / 2 + 0.03, foot + BOARD)
            b.add(finish, g.span(low, (x + 0.009, depth / 2 - 0.013, top)))
        middle = foot + 0.55 * (top - foot)
        low = (-third / 2 + 0.009, -depth / 2 + 0.04, middle - 0.016)
        b.add(finish, g.span(low, (third / 2 - 0.009, depth / 2 - 0.013, middle)))
        if self.player:
            black = Material("plastic", (0.012, 0.012, 0.014), 0.3)
            case = g.box((min(0.3, third - 0.1), 0.22, 0.05), (0.02, -0.02, middle + 0.001), 0.003)
            with b.holding("player", "electronics"):
                b.add(black, case, name="player")
        with b.holding("books", "books"):
            add_stack(b, self.books, 0.0, -0.02, foot + BOARD)
        b.surface(0, 0, self.height, width / 2 - 0.05, depth / 2 - 0.05)


class NightTable(Spec, piece=("night table", "night table", "wall"), front_clearance=0.3):
    """A bedside cabinet: a drawer above an open compartment."""

    width: float = between(0.4, 0.5)
    depth: float = between(0.36, 0.42)
    height: float = between(0.46, 0.58)
    pulled: tuple[float, ...] = pulled_out(lambda table: 1, 0.05, 0.14)
    has_books: bool = chance(0.7)
    books: tuple[LyingBook, ...] = when("has_books", several(LyingBook, 2, 4), ())

    def assemble(self, b: Builder) -> None:
        style, width, depth, height = self.style, self.width, self.depth, self.height
        finish, foot, split = style.cabinet, 0.12, height - 0.022 - 0.17
        _add_body(b, self, foot, (0.035, 0.015), 0.02, (0.01, 0.006))
        b.add(finish, shelf(width, depth, split))
        drawer = (split, height - 0.022)
        add_drawers(b, style, finish, style.wood, width / 2, drawer, depth, self.pulled)
        if self.books:
            with b.holding("books", "books"):
                add_stack(b, self.books, 0, 0.0, foot + BOARD)
        b.surface(0, 0, height, width / 2 - 0.04, depth / 2 - 0.04)


class WallShelf(Spec, piece=("wall shelf", "shelf", "on_wall")):
    """A wall shelf on brackets with books and room for things, at eye height."""

    width: float = between(0.6, 1.1)
    depth: float = between(0.2, 0.25)
    mount_height: float = between(1.35, 1.6)
    filled: float = between(0.3, 0.65)
    books: Books = drawn(
        lambda draw, spec: Books.draw(
            draw,
            spec.style,
            low=spec.ends[0],
            high=spec.ends[1],
            z=0.0005,
            front=-spec.depth + 0.03,
            headroom=0.3,
            deep=spec.depth - 0.034,
        )
    )

    @property
    def ends(self) -> tuple[float, float, float]:
        """Along x: where the books begin, where they end, where the board ends."""
        low, high = -self.width / 2 + 0.03, self.width / 2 - 0.03
        return low, low + self.filled * (high - low), high

    def assemble(self, b: Builder) -> None:
        width, depth, thick = self.width, self.depth, 0.025
        b.add(self.style.wood, g.span((-width / 2, -depth, -thick), (width / 2, 0, 0), 0.002))
        for side in (-1, 1):
            x, under = side * (width / 2 - 0.12), -thick - 0.0005
            low = (x - 0.012, -depth + 0.03, -thick - 0.0045)
            b.add(
                self.style.metal,
                g.span((x - 0.012, -0.004, -0.16), (x + 0.012, 0, under)),
                g.span(low, (x + 0.012, -0.004, under)),
                g.bar((x, -0.006, -0.13), (x, -depth + 0.06, -thick - 0.003), 0.005, 8),
            )
        self.books.add_to(b)
        _, middle, high = self.ends
        half = (0.5 * (high - middle) - 0.01, depth / 2 - 0.02)
        b.surface(0.5 * (middle + high) + 0.01, -depth / 2, 0.0, *half)


class WallBoard(Spec, piece=("wall board", "shelf", "on_wall")):
    """A board on the wall with room for things, for bathrooms and kitchens."""

    width: float = between(0.4, 0.8)
    depth: float = between(0.14, 0.2)
    mount_height: float = between(1.25, 1.5)
    top: Material = either(0.6, "wood", "lacquer")

    def assemble(self, b: Builder) -> None:
        width, depth, metal = self.width, self.depth, self.style.metal
        b.add(self.top, g.span((-width / 2, -depth, -0.02), (width / 2, 0, 0), 0.002))
        for side in (-1, 1):
            x = side * (width / 2 - 0.06)
            b.add(metal, g.span((x - 0.01, -0.004, -0.1), (x + 0.01, 0, -0.0205)))
            b.add(metal, g.bar((x, -0.006, -0.08), (x, -depth + 0.03, -0.0235), 0.004, 8))
        b.surface(0, -depth / 2, 0.0, width / 2 - 0.015, depth / 2 - 0.01)


class Rack(Spec, piece=("rack", "shelf", "wall"), front_clearance=0.4):
    """A narrow open rack of three to five boards between four posts."""

    width: float = between(0.36, 0.6)
    depth: float = between(0.28, 0.34)
    height: float = between(0.9, 1.6)
    frame: Material = either(0.6, "metal", "wood")
    board: Material = either(0.7, "wood", "lacquer")

    def assemble(self, b: Builder) -> None:
        width, depth, height = self.width, self.depth, self.height
        for x, y in g.CORNERS:
            at = (x * (width / 2 - 0.011), y * (depth / 2 - 0.011), 0.0)
            b.add(self.frame, g.box((0.022, 0.022, height), at, 0.002))
        levels = np.linspace(0.12, height - 0.03, max(3, round(height / 0.36))).tolist()
        for z, above in zip(levels, [*levels[1:], 9.0], strict=True):
            low = (0.023 - width / 2, 0.002 - depth / 2, z - 0.018)
            b.add(self.board, g.span(low, (width / 2 - 0.023, depth / 2 - 0.002, z)))
            b.surface(0, 0, z, width / 2 - 0.03, depth / 2 - 0.01, above - z - 0.03)


class ShoeRack(Spec, piece=("shoe rack", "shelf", "wall"), front_clearance=0.4):
    """Two slatted boards with pairs of shoes."""

    width: float = between(0.6, 0.8)
    shoes: tuple[Shoes, ...] = drawn(lambda draw, spec: tuple(_pairs(draw, spec.width)))

    def assemble(self, b: Builder) -> None:
        half, deep, metal = self.width / 2, 0.3 / 2 - 0.01, self.style.metal
        for sx, sy in g.CORNERS:
            foot = (sx * half, sy * deep)
            b.add(metal, g.bar((*foot, 0), (*foot, 0.45), 0.009, 10))
        for z in _BOARDS:
            for side in (-1, 1):
                b.add(metal, g.bar((side * half, -deep, z), (side * half, deep, z), 0.007, 8))
            for k in range(5):
                at = (0, (k - 2) * 0.058, z + 0.005)
                b.add(self.style.wood, g.box((self.width, 0.04, 0.014), at, 0.003))
            for x, own, material in self.shoes:
                if own == z:
                    self._add_pair(b, material, x, z + 0.0195)

    def _add_pair(self, b: Builder, material: Material, x: float, z: float) -> None:
        upper, sole = _shoe()
        with b.holding("pair of shoes", "shoe"):
            for step in (0.0, 0.095):
                b.add(material, upper.moved(x + step, 0.0, z), name="shoe")
                under = m.WHITE_PLASTIC if material.kind == "fabric" else m.RUBBER
                b.add(under, sole.moved(x + step, 0.0, z), name="sole")


Shoes = tuple[float, float, Material]  # x, z of the board, material


def _pairs(draw: Draw, width: float) -> Iterator[Shoes]:
    for z in _BOARDS:
        x = -width / 2 + 0.09
        while x < width / 2 - 0.07:
            if draw.chance(0.8):
                yield x, z, draw.pick(_SHOES)
            x += 0.22


_BOARDS = (0.12, 0.36)  # metres, heights
_SHOES = (
    Material("leather", (0.05, 0.03, 0.02), 0.4),
    Material("leather", (0.02, 0.02, 0.022), 0.35),
    Material("fabric", (0.12, 0.16, 0.24), 0.9),
)


def _shoe() -> tuple[g.BodyMesh, g.BodyMesh]:
    """Upper and sole of a shoe with its sole at z = 0 and its tip towards the front (-Y)."""
    upper = (  # height, half extents, y of the middle
        *((0.018, 0.041, 0.132, 0.0), (0.03, 0.042, 0.132, 0.0), (0.045, 0.039, 0.118, 0.01)),
        *((0.056, 0.035, 0.088, 0.036), (0.068, 0.033, 0.064, 0.06), (0.078, 0.032, 0.06, 0.065)),
        *((0.078, 0.027, 0.055, 0.065), (0.03, 0.027, 0.055, 0.065)),
    )
    sole = ((0.0, 0.041, 0.133), (0.017, 0.045, 0.137), (0.02, 0.044, 0.136))
    return (
        g.loft([g.superellipse(half_x, half_y, z, 2.3, 20, y=y) for z, half_x, half_y, y in upper]),
        g.loft([g.superellipse(half_x, half_y, z, 2.3, 20) for z, half_x, half_y in sole]),
    )
