"""Cupboards and shelves with their contents: books, vases, baskets, clothes, shoes."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    FRONT,
    add_door,
    add_drawer,
    carcass,
    feet,
    left_open,
    leg_material,
    shelf,
)
from pbrnet.scenes.procedural.furniture.geometry import (
    BodyMesh,
    bar,
    box,
    lathe,
    loft,
    merge,
    rounded_box,
    span,
    superellipse,
)
from pbrnet.scenes.procedural.furniture.style import (
    CHROME,
    PAGES,
    RUBBER,
    WHITE_PLASTIC,
    WICKER,
    Style,
)
from pbrnet.scenes.procedural.piece import FurniturePiece, Material


def add_books(
    b: Builder,
    rng: np.random.Generator,
    style: Style,
    low: float,
    high: float,
    z: float,
    front: float,
    headroom: float,
    fill: float = 0.8,
    depth: float = 0.2,
) -> None:
    """Add a row of books on a shelf from x = low to high at z, spines near y = front.

    Books differ in size and colour and are at most `depth` deep; one in twelve leans. The row is
    an object of its own.
    """
    bindings = [style.books[int(k)] for k in rng.permutation(len(style.books))[:_BINDINGS]]
    x = low + 0.004
    stop = low + fill * (high - low)
    row = Builder("", "", "free")
    while True:
        thickness = float(rng.uniform(0.014, 0.045))
        height = min(float(rng.normal(0.22, 0.03)), headroom - 0.015)
        deep = min(0.16, max(0.11, 0.68 * height), depth - 0.018)
        lean = float(rng.uniform(6, 16)) if rng.random() < 0.08 else 0.0
        sine, cosine = np.sin(np.radians(lean)), np.cos(np.radians(lean))
        need = thickness * cosine + height * sine
        if x + need > stop or height < 0.1:
            break
        y = front + float(rng.uniform(0.0, 0.018))
        cover, pages = _book(thickness, height, deep)
        # A leaning book touches the shelf with its lower right corner.
        at = (x + float(height * sine), y, z + float(thickness * sine))
        binding = bindings[int(rng.integers(len(bindings)))]
        row.add(binding, cover.turned("y", -lean).moved(*at), name="books")
        row.add(PAGES, pages.turned("y", -lean).moved(*at), name="pages")
        x += float(need) + 0.0008
    with b.holding("books", "books"):
        b.add_from(row)


_BINDINGS = 4  # colours of the books in a row


def _book(thickness: float, height: float, depth: float) -> tuple[BodyMesh, BodyMesh]:
    """Binding and pages of a book: spine at y = 0, bottom at z = 0, left cover at x = 0."""
    board = 0.0022
    cover = merge(
        [
            span((0, 0.0, 0), (thickness, board, height)),
            span((0, board, 0), (board, depth, height)),
            span((thickness - board, board, 0), (thickness, depth, height)),
        ]
    )
    pages = span((board, board, 0.003), (thickness - board, depth - 0.004, height - 0.004))
    return cover, pages


def add_stack(
    b: Builder,
    rng: np.random.Generator,
    style: Style,
    x: float,
    y: float,
    z: float,
    count: int,
    turn: float = 0.0,
) -> float:
    """Add a stack of books at (x, y, z); returns the height of its top."""
    for _ in range(count):
        thickness, height = float(rng.uniform(0.015, 0.035)), float(rng.uniform(0.19, 0.26))
        cover, pages = _book(thickness, height, 0.7 * height)
        angle = turn + float(rng.uniform(-8, 8))
        binding = style.books[int(rng.integers(len(style.books)))]
        for material, mesh, name in ((binding, cover, "books"), (PAGES, pages, "pages")):
            lying = mesh.moved(-thickness / 2, -0.35 * height, -height / 2).turned("y", 90)
            b.add(material, lying.turned("z", 90 + angle).moved(x, y, z + thickness / 2), name=name)
        z += thickness + 0.0004
    return z


def add_vase(
    b: Builder,
    rng: np.random.Generator,
    material: Material,
    x: float,
    y: float,
    z: float,
    height: float,
) -> None:
    """Add a vase with an open mouth."""
    width = float(rng.uniform(0.28, 0.42)) * height
    mouth = float(rng.uniform(0.35, 0.75)) * width
    t = np.linspace(0, 1, 17)
    belly = float(rng.uniform(0.8, 1.5))
    outer = (
        0.55 * width * (1 - t) + mouth * t + (width - 0.5 * mouth) * np.sin(np.pi * t**belly) * 0.6
    )
    outer *= width / outer.max()
    profile = [(float(r), float(h)) for r, h in zip(outer, t * height, strict=True)]
    wall = 0.005
    profile += [(profile[-1][0] - wall, height), (0.9 * profile[-3][0] - wall, 0.86 * height)]
    profile += [(0.6 * mouth, 0.7 * height)]
    b.add(material, lathe(profile, 24).moved(x, y, z), name="vase")


def add_basket(
    b: Builder,
    x: float,
    y: float,
    z: float,
    half: tuple[float, float],
    tall: float,
    power: float = 5.0,
) -> None:
    """Add an open basket; `power` 2 is round, higher powers approach a rectangle."""
    rings = []
    for inset, height in ((0.02, 0.0), (0.0, tall), (0.008, tall), (0.026, 0.012)):
        rings.append(superellipse(half[0] - inset, half[1] - inset, height, power, 28))
    b.add(WICKER, loft(np.stack(rings)).moved(x, y, z), name="basket")


def bookshelf(
    rng: np.random.Generator,
    style: Style,
    width: float | None = None,
    height: float | None = None,
) -> FurniturePiece:
    """A tall open shelf with rows and stacks of books and baskets, and room for things."""
    width = float(rng.uniform(0.7, 1.1)) if width is None else width
    height = float(rng.uniform(1.75, 2.1)) if height is None else height
    depth = rng.uniform(0.28, 0.33)
    b = Builder("bookshelf", "bookshelf", "wall", front_clearance=0.5)
    wood = style.cabinet
    b.add(wood, *carcass(width, depth + FRONT, 0.06, height))
    b.add(
        wood, span((-width / 2 + 0.019, -depth / 2 + 0.03, 0), (width / 2 - 0.019, depth / 2, 0.06))
    )
    levels = max(2, round((height - 0.08) / 0.34))
    zs = [0.06 + BOARD + k * (height - 0.078) / levels for k in range(levels)]
    zs[0] = 0.06 + BOARD
    for z in zs[1:]:
        b.add(wood, shelf(width, depth + FRONT, z))
    room = (height - 0.078) / levels - BOARD - 0.004
    left, right = -width / 2 + BOARD + 0.004, width / 2 - BOARD - 0.004
    front = -depth / 2 + 0.045
    for level, z in enumerate(zs):
        kind = rng.random()
        if level == 0 and kind < 0.14:
            half = (min(0.17, (right - left) / 4 - 0.01), depth / 2 - 0.045)
            what = ("basket", "open box", "rush basket")[int(rng.integers(3))]
            for x in (left + 0.25 * (right - left), left + 0.75 * (right - left)):
                with b.holding(what, "box"):
                    add_basket(b, x, 0.0, z, half, min(0.2, 0.7 * room))
            continue
        # One or two rows of books from the sides, then a stack or room for things between them.
        begin, end = left, right
        if kind < 0.85:
            begin += float(rng.uniform(0.25, 0.6)) * (right - left)
            add_books(b, rng, style, left, begin, z, front, room, 1.0)
        if kind > 0.55:
            end -= float(rng.uniform(0.15, 0.32)) * (right - left)
            add_books(b, rng, style, end, right, z, front, room, 1.0)
        if end - begin > 0.3 and rng.random() < 0.3:
            with b.holding("books", "books"):
                add_stack(b, rng, style, end - 0.14, 0.0, z, int(rng.integers(2, 5)))
            end -= 0.28
        if end - begin > 0.1:
            half = (0.5 * (end - begin) - 0.012, depth / 2 - 0.05)
            b.surface(0.5 * (begin + end), 0.0, z, *half, room - 0.01)
    b.surface(0, 0.01, height, width / 2 - 0.05, depth / 2 - 0.03)
    return b.piece()


def add_garment(
    b: Builder, rng: np.random.Generator, material: Material, x: float, rail: float, length: float
) -> None:
    """Add a garment on a hanger below a rail along x at height `rail`, `length` metres long."""
    n, m = 25, 9
    t = np.linspace(0, 1, m)
    angle = 2 * np.pi * np.arange(n - 1) / (n - 1)
    half_wide = np.interp(t, [0, 0.08, 0.2, 1], [0.05, 0.19, 0.22, 0.24])
    half_thick = np.interp(t, [0, 0.08, 1], [0.012, 0.02, 0.028])
    phase = float(rng.uniform(0, 6.28))
    rings = np.empty((m, n - 1, 3))
    for k in range(m):
        fold = 1 + 0.3 * t[k] * np.sin(5 * angle + phase)
        rings[k, :, 0] = half_thick[k] * np.cos(angle) * fold
        rings[k, :, 1] = half_wide[k] * np.sin(angle)
        rings[k, :, 2] = -0.07 - length * t[k]
    b.add(material, loft(rings[::-1]).moved(x, 0.0, rail), name="garment")
    b.add(CHROME, bar((x, 0, rail - 0.08), (x, 0, rail + 0.012), 0.003, 8), name="hanger")


def wardrobe(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A wardrobe of two or three doors; clothes hang behind a door that is ajar."""
    width = float(rng.uniform(1.0, 1.6)) if width is None else width
    depth, height = rng.uniform(0.57, 0.62), rng.uniform(1.95, 2.2)
    b = Builder("wardrobe", "wardrobe", "wall", front_clearance=0.7)
    finish = style.cabinet
    base = 0.07
    b.add(finish, *carcass(width, depth, base, height))
    b.add(
        finish,
        box((width - 0.01, depth - 0.08, base + 0.001), (0, 0.03, 0)),
        box((width + 0.02, depth + 0.012, 0.025), (0, 0.0, height - 0.001), 0.004),
    )
    doors = 2 if width < 1.25 else 3
    each = width / doors
    drawers = 0.0 if rng.random() < 0.5 else 0.22
    bottom = base + drawers
    ajar = left_open(rng, style, doors)
    for k in range(doors):
        x0 = -width / 2 + k * each
        hinge = "left" if k == 0 else "right"
        if doors == 3 and k == 1:
            hinge = "left"
        angle = float(rng.uniform(18, 65)) if k == ajar else 0.0
        add_door(b, style, finish, x0, x0 + each, bottom, height - 0.002, depth, hinge, angle)
        if drawers:
            add_drawer(b, style, finish, style.wood, x0, x0 + each, base, bottom, depth)
    if drawers:
        b.add(finish, shelf(width, depth, bottom + 0.001))
    if ajar < doors:
        rail = height - 0.14
        b.add(
            CHROME,
            bar((-width / 2 + 0.02, 0, rail), (width / 2 - 0.02, 0, rail), 0.012, 12),
            name="rail",
        )
        x = -width / 2 + ajar * each + 0.07
        while x < -width / 2 + (ajar + 1) * each - 0.06:
            cloth = (*style.cushions, style.throw, style.bedding, style.upholstery)
            material = cloth[int(rng.integers(len(cloth)))]
            add_garment(b, rng, material, x, rail, float(rng.uniform(0.65, 1.1)))
            x += float(rng.uniform(0.075, 0.11))
    b.surface(0, 0, height + 0.024, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def built_in_wardrobe(
    rng: np.random.Generator, style: Style, width: float | None = None, height: float | None = None
) -> FurniturePiece:
    """A wardrobe from wall to wall and up to the ceiling, its upper doors above 2.05 metres."""
    width = float(rng.uniform(1.5, 3.0)) if width is None else width
    height = float(rng.uniform(2.4, 2.7)) if height is None else height
    depth = float(rng.uniform(0.58, 0.64))
    b = Builder("built-in wardrobe", "wardrobe", "wall", front_clearance=0.7)
    finish = style.lacquer if rng.random() < 0.6 else style.cabinet
    base, top = 0.07, height - 0.05
    split = min(2.05, top - 0.22)
    b.add(finish, *carcass(width, depth, base, top))
    b.add(
        finish,
        box((width - 0.01, depth - 0.08, base + 0.001), (0, 0.03, 0)),
        box((width - 0.002, depth - 0.04, 0.051), (0, 0.012, top - 0.001)),
        shelf(width, depth, split + 0.009),
    )
    doors = max(2, round(width / float(rng.uniform(0.45, 0.6))))
    each = width / doors
    ajar = int(rng.integers(2 * doors))  # from `doors` on: all closed
    for k in range(doors):
        x0 = -width / 2 + k * each
        hinge = "left" if k % 2 == 0 else "right"
        angle = float(rng.uniform(18, 60)) if k == ajar else 0.0
        add_door(b, style, finish, x0, x0 + each, base, split, depth, hinge, angle)
        add_door(b, style, finish, x0, x0 + each, split, top - 0.002, depth, hinge, handle_low=True)
    if ajar < doors:
        rail = split - 0.1
        ends = (-width / 2 + 0.02, 0, rail), (width / 2 - 0.02, 0, rail)
        b.add(CHROME, bar(*ends, 0.012, 12), name="rail")
        x = -width / 2 + ajar * each + 0.07
        while x < -width / 2 + (ajar + 1) * each - 0.06:
            cloth = (*style.cushions, style.throw, style.bedding, style.upholstery)
            material = cloth[int(rng.integers(len(cloth)))]
            add_garment(b, rng, material, x, rail, float(rng.uniform(0.65, 1.1)))
            x += float(rng.uniform(0.075, 0.11))
    return b.piece()


def chest_of_drawers(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A chest of three or four drawers on feet, sometimes one pulled out."""
    width = float(rng.uniform(0.75, 1.1)) if width is None else width
    depth, height = rng.uniform(0.42, 0.5), rng.uniform(0.78, 1.05)
    b = Builder("chest of drawers", "chest", "wall", front_clearance=0.6)
    finish, foot = style.cabinet, 0.11
    b.add(
        leg_material(style, style.wood),
        *feet(style, width, depth - FRONT, foot + 0.002, 0.045, 0.015),
    )
    b.add(finish, *carcass(width, depth, foot, height - 0.024))
    b.add(finish, box((width + 0.016, depth + 0.012, 0.025), (0, 0, height - 0.025), 0.003))
    rows = 3 if height < 0.9 else 4
    zs = np.linspace(foot, height - 0.026, rows + 1)
    pulled = left_open(rng, style, rows)
    for k in range(rows):
        out = float(rng.uniform(0.08, 0.22)) if k == pulled else 0.0
        add_drawer(
            b,
            style,
            finish,
            style.wood,
            -width / 2,
            width / 2,
            float(zs[k]),
            float(zs[k + 1]),
            depth,
            out,
        )
        if out and rng.random() < 0.8:
            z = float(zs[k]) + 0.035
            cloth = style.cushions[k % len(style.cushions)]
            for x in np.arange(-width / 2 + 0.15, width / 2 - 0.13, 0.2):
                b.add(
                    cloth,
                    rounded_box((0.18, 0.3, 0.08), (float(x), -depth / 2 - out + 0.22, z), 0.03),
                    name="linen",
                )
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def sideboard(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A sideboard: doors at the sides, drawers between them."""
    width = float(rng.uniform(1.3, 1.9)) if width is None else width
    depth, height = rng.uniform(0.4, 0.46), rng.uniform(0.68, 0.85)
    b = Builder("sideboard", "sideboard", "wall", front_clearance=0.5)
    finish, foot = style.cabinet, 0.15
    b.add(
        leg_material(style, style.wood), *feet(style, width, depth, foot + 0.002, 0.045, 0.05, 0.02)
    )
    b.add(finish, *carcass(width, depth, foot, height - 0.022))
    b.add(finish, box((width + 0.01, depth + 0.006, 0.022), (0, 0, height - 0.022), 0.003))
    third = width / 3
    top = height - 0.024
    ajar = left_open(rng, style, 3)
    for k, hinge in ((0, "left"), (2, "right")):
        x0 = -width / 2 + k * third
        angle = float(rng.uniform(15, 60)) if ajar == k else 0.0
        add_door(b, style, finish, x0, x0 + third, foot, top, depth, hinge, angle)
        b.add(
            finish,
            span(
                (x0 + third * (k == 0) - 0.009, -depth / 2 + 0.03, foot + BOARD),
                (x0 + third * (k == 0) + 0.009, depth / 2 - 0.013, top - BOARD),
            ),
        )
    zs = np.linspace(foot, top, 4)
    for k in range(3):
        add_drawer(
            b,
            style,
            finish,
            style.wood,
            -third / 2,
            third / 2,
            float(zs[k]),
            float(zs[k + 1]),
            depth,
        )
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def tv_stand(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A television stand: an open compartment with a player between two doors."""
    width = float(rng.uniform(1.2, 1.8)) if width is None else width
    depth, height = rng.uniform(0.38, 0.45), rng.uniform(0.42, 0.55)
    b = Builder("tv stand", "tv stand", "wall", front_clearance=0.4)
    finish, foot = style.cabinet, 0.1
    b.add(
        leg_material(style, style.wood), *feet(style, width, depth, foot + 0.002, 0.04, 0.04, 0.01)
    )
    b.add(finish, *carcass(width, depth, foot, height - 0.022))
    b.add(finish, box((width + 0.008, depth + 0.006, 0.022), (0, 0, height - 0.022), 0.003))
    third = width / 3
    top = height - 0.024
    for k, hinge in ((0, "left"), (2, "right")):
        x0 = -width / 2 + k * third
        add_door(b, style, finish, x0, x0 + third, foot, top, depth, hinge)
        x = x0 + third * (k == 0)
        b.add(
            finish,
            span((x - 0.009, -depth / 2 + 0.03, foot + BOARD), (x + 0.009, depth / 2 - 0.013, top)),
        )
    middle = foot + 0.55 * (top - foot)
    b.add(
        finish,
        span(
            (-third / 2 + 0.009, -depth / 2 + 0.04, middle - 0.016),
            (third / 2 - 0.009, depth / 2 - 0.013, middle),
        ),
    )
    black = Material("plastic", (0.012, 0.012, 0.014), 0.3)
    wide = min(0.3, third - 0.1)
    if rng.random() < 0.25:
        with b.holding("player", "electronics"):
            b.add(
                black, box((wide, 0.22, 0.05), (0.02, -0.02, middle + 0.001), 0.003), name="player"
            )
    with b.holding("books", "books"):
        add_stack(b, rng, style, 0.0, -0.02, foot + BOARD, int(rng.integers(1, 4)))
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def night_table(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A bedside cabinet: a drawer above an open compartment."""
    width, depth = rng.uniform(0.4, 0.5), rng.uniform(0.36, 0.42)
    height = rng.uniform(0.46, 0.58)
    b = Builder("night table", "night table", "wall", front_clearance=0.3)
    finish, foot = style.cabinet, 0.12
    b.add(leg_material(style, style.wood), *feet(style, width, depth, foot + 0.002, 0.035, 0.015))
    b.add(finish, *carcass(width, depth, foot, height - 0.02))
    b.add(finish, box((width + 0.01, depth + 0.006, 0.02), (0, 0, height - 0.02), 0.003))
    split = height - 0.022 - 0.17
    b.add(finish, shelf(width, depth, split))
    out = float(rng.uniform(0.05, 0.14)) if left_open(rng, style, 1) == 0 else 0.0
    add_drawer(
        b, style, finish, style.wood, -width / 2, width / 2, split, height - 0.022, depth, out
    )
    if rng.random() < 0.7:
        with b.holding("books", "books"):
            add_stack(b, rng, style, 0, 0.0, foot + BOARD, int(rng.integers(2, 4)))
    b.surface(0, 0, height, width / 2 - 0.04, depth / 2 - 0.04)
    return b.piece()


def wall_shelf(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A wall shelf on brackets with books and room for things, at eye height."""
    width = float(rng.uniform(0.6, 1.1)) if width is None else width
    depth, thickness = rng.uniform(0.2, 0.25), 0.025
    b = Builder("wall shelf", "shelf", "on_wall", mount_height=float(rng.uniform(1.35, 1.6)))
    b.add(style.wood, span((-width / 2, -depth, -thickness), (width / 2, 0, 0), 0.002))
    for side in (-1, 1):
        x = side * (width / 2 - 0.12)
        b.add(
            style.metal,
            span((x - 0.012, -0.004, -0.16), (x + 0.012, 0, -thickness - 0.0005)),
            span(
                (x - 0.012, -depth + 0.03, -thickness - 0.0045),
                (x + 0.012, -0.004, -thickness - 0.0005),
            ),
            bar((x, -0.006, -0.13), (x, -depth + 0.06, -thickness - 0.003), 0.005, 8),
        )
    low, high = -width / 2 + 0.03, width / 2 - 0.03
    middle = low + float(rng.uniform(0.3, 0.65)) * (high - low)
    add_books(b, rng, style, low, middle, 0.0005, -depth + 0.03, 0.3, 1.0, depth - 0.034)
    b.surface(
        0.5 * (middle + high) + 0.01,
        -depth / 2,
        0.0,
        0.5 * (high - middle) - 0.01,
        depth / 2 - 0.02,
    )
    return b.piece()


def wall_board(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A board on the wall with room for things, for bathrooms and kitchens."""
    width, depth = float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.14, 0.2))
    b = Builder("wall board", "shelf", "on_wall", mount_height=float(rng.uniform(1.25, 1.5)))
    top = style.wood if rng.random() < 0.6 else style.lacquer
    b.add(top, span((-width / 2, -depth, -0.02), (width / 2, 0, 0), 0.002))
    for side in (-1, 1):
        x = side * (width / 2 - 0.06)
        b.add(style.metal, span((x - 0.01, -0.004, -0.1), (x + 0.01, 0, -0.0205)))
        b.add(style.metal, bar((x, -0.006, -0.08), (x, -depth + 0.03, -0.0235), 0.004, 8))
    b.surface(0, -depth / 2, 0.0, width / 2 - 0.015, depth / 2 - 0.01)
    return b.piece()


def rack(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A narrow open rack of three to five boards between four posts."""
    width, depth = float(rng.uniform(0.36, 0.6)), float(rng.uniform(0.28, 0.34))
    height = float(rng.uniform(0.9, 1.6))
    b = Builder("rack", "shelf", "wall", front_clearance=0.4)
    frame = style.metal if rng.random() < 0.6 else style.wood
    board = style.wood if rng.random() < 0.7 else style.lacquer
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (width / 2 - 0.011), y * (depth / 2 - 0.011), 0.0)
            b.add(frame, box((0.022, 0.022, height), at, 0.002))
    levels = np.linspace(0.12, height - 0.03, max(3, round(height / 0.36)))
    for low, high in zip(levels, [*levels[1:], 9.0], strict=True):
        z = float(low)
        low_corner = (0.023 - width / 2, 0.002 - depth / 2, z - 0.018)
        b.add(board, span(low_corner, (width / 2 - 0.023, depth / 2 - 0.002, z)))
        half = (width / 2 - 0.03, depth / 2 - 0.01)
        b.surface(0, 0, z, *half, float(high) - z - 0.03)
    return b.piece()


def shoe_rack(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """Two slatted boards with pairs of shoes."""
    width, depth = rng.uniform(0.6, 0.8), 0.3
    b = Builder("shoe rack", "shelf", "wall", front_clearance=0.4)
    for side in (-1, 1):
        for sy in (-1, 1):
            b.add(
                style.metal,
                bar(
                    (side * width / 2, sy * (depth / 2 - 0.01), 0),
                    (side * width / 2, sy * (depth / 2 - 0.01), 0.45),
                    0.009,
                    10,
                ),
            )
    for z in (0.12, 0.36):
        for side in (-1, 1):
            b.add(
                style.metal,
                bar(
                    (side * width / 2, -depth / 2 + 0.01, z),
                    (side * width / 2, depth / 2 - 0.01, z),
                    0.007,
                    8,
                ),
            )
        for k in range(5):
            b.add(
                style.wood,
                box((width, 0.04, 0.014), (0, (k - 2) * 0.058, z + 0.005), 0.003),
            )
        x = -width / 2 + 0.09
        while x < width / 2 - 0.07:
            if rng.random() < 0.8:
                material = _SHOES[int(rng.integers(len(_SHOES)))]
                sole = WHITE_PLASTIC if material.kind == "fabric" else RUBBER
                with b.holding("pair of shoes", "shoe"):
                    for step in (0.0, 0.095):
                        upper, under = _shoe()
                        b.add(material, upper.moved(x + step, 0.0, z + 0.0195), name="shoe")
                        b.add(sole, under.moved(x + step, 0.0, z + 0.0195), name="sole")
            x += 0.22
    return b.piece()


_SHOES = (
    Material("leather", (0.05, 0.03, 0.02), 0.4),
    Material("leather", (0.02, 0.02, 0.022), 0.35),
    Material("fabric", (0.12, 0.16, 0.24), 0.9),
)


def _shoe() -> tuple[BodyMesh, BodyMesh]:
    """Upper and sole of a shoe with its sole at z = 0 and its tip towards the front (-Y)."""
    upper = [
        superellipse(half_x, half_y, height, 2.3, 20, y=y)
        for height, half_x, half_y, y in (
            (0.018, 0.041, 0.132, 0.0),
            (0.03, 0.042, 0.132, 0.0),
            (0.045, 0.039, 0.118, 0.01),
            (0.056, 0.035, 0.088, 0.036),
            (0.068, 0.033, 0.064, 0.06),
            (0.078, 0.032, 0.06, 0.065),
            (0.078, 0.027, 0.055, 0.065),
            (0.03, 0.027, 0.055, 0.065),
        )
    ]
    sole = [
        superellipse(half_x, half_y, height, 2.3, 20)
        for height, half_x, half_y in (
            (0.0, 0.041, 0.133),
            (0.017, 0.045, 0.137),
            (0.02, 0.044, 0.136),
        )
    ]
    return loft(np.stack(upper)), loft(np.stack(sole))
