"""Chairs, armchairs, sofas, stools."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import feet, leg_material
from pbrnet.scenes.procedural.furniture.cloth import stuffed
from pbrnet.scenes.procedural.furniture.geometry import (
    bar,
    box,
    cylinder,
    lathe,
    loft,
    post,
    rounded_box,
    sphere,
    superellipse,
    thick_sheet,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import BLACK_PLASTIC, CHROME, RUBBER, Style
from pbrnet.scenes.procedural.piece import FurniturePiece


def dining_chair(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A wooden chair with a back of slats, rails, spindles or a pad, or a moulded shell on legs."""
    back = style.shape(rng, "chair", ("slats", "rails", "pad", "spindles", "shell"))
    if back == "shell":
        return _shell_chair(rng, style)
    width, depth = rng.uniform(0.42, 0.47), rng.uniform(0.42, 0.46)
    seat, top = rng.uniform(0.44, 0.47), rng.uniform(0.84, 0.98)
    wood = style.wood if rng.random() < 0.75 else style.lacquer
    padded = back == "pad" or rng.random() < 0.5
    b = Builder("dining chair", "chair", "free", front_clearance=0.5)
    thickness = 0.036
    x, front, rear = width / 2 - thickness / 2, -depth / 2 + 0.03, depth / 2 - 0.05
    lean = rng.uniform(0.06, 0.1)
    under = seat - 0.03
    for side in (-1, 1):
        b.add(
            wood,
            post(
                [(side * x, front, 0), (side * x, front, under + 0.002)],
                [(0.7 * thickness, 0.7 * thickness), (thickness, thickness)],
            ),
            post(
                [
                    (side * x, rear + 0.045, 0),
                    (side * x, rear, 0.5 * seat),
                    (side * x, rear, seat),
                    (side * x, rear + 0.4 * lean, 0.6 * top + 0.4 * seat),
                    (side * x, rear + lean, top),
                ],
                [
                    (0.028, 0.03),
                    (0.03, thickness),
                    (0.03, thickness),
                    (0.028, 0.028),
                    (0.026, 0.022),
                ],
            ),
            # Rails below the seat and a stretcher between the legs.
            box((0.018, rear - front - 0.03, 0.05), (side * x, (front + rear) / 2, under - 0.05)),
            box((0.016, rear - front, 0.024), (side * x, (front + rear) / 2 + 0.01, 0.16)),
        )
    b.add(
        wood,
        box((2 * x - 0.034, 0.018, 0.05), (0, front, under - 0.05)),
        box((2 * x - 0.028, 0.018, 0.05), (0, rear, under - 0.05)),
        box((2 * x - 0.014, 0.016, 0.022), (0, (front + rear) / 2, 0.161)),
    )
    seat_depth = rear - front + 0.05
    seat_y = (front + rear) / 2 - 0.025
    if padded:
        b.add(wood, box((width - 0.02, seat_depth - 0.02, 0.012), (0, seat_y, under)))
        b.add(
            style.second_upholstery,
            rounded_box((width, seat_depth, 0.045), (0, seat_y, under + 0.01), 0.02, (0, 0, 0.012)),
        )
    else:
        b.add(wood, box((width, seat_depth, 0.028), (0, seat_y, under), bevel=0.008, grain="y"))

    def on_back(z: float) -> float:
        share = (z - seat) / (top - seat)
        return float(rear + lean * np.interp(share, [0, 0.6, 1], [0, 0.4, 1]))

    inner = 2 * x - 0.02
    high = top - 0.05
    if back == "slats":
        low = seat + 0.1
        for z in (low, high):
            b.add(wood, box((inner, 0.02, 0.05), (0, on_back(z + 0.025), z), bevel=0.004))
        count = int(rng.integers(4, 7))
        for k in range(count):
            sx = (k - (count - 1) / 2) * inner / count
            zs = np.linspace(low + 0.03, high + 0.02, 4)
            b.add(
                wood,
                post([(sx, on_back(z), z) for z in zs], [(0.5 * inner / count, 0.01)] * len(zs)),
            )
    elif back == "spindles":
        b.add(wood, box((inner + 0.03, 0.024, 0.045), (0, on_back(high), high), bevel=0.008))
        count = int(rng.integers(6, 9))
        for k in range(count):
            share = (k - (count - 1) / 2) / (count - 1)
            foot = (0.72 * inner * share, on_back(seat + 0.02) - 0.012, seat - 0.008)
            tip = (0.88 * inner * share, on_back(high) + 0.002, high + 0.01)
            b.add(wood, bar(foot, tip, 0.0065, 8))
    elif back == "rails":
        for k in range(int(rng.integers(3, 5))):
            z = high - k * 0.105
            if z > seat + 0.08:
                b.add(wood, box((inner, 0.016, 0.055), (0, on_back(z + 0.03), z), bevel=0.005))
    else:
        b.add(
            style.second_upholstery,
            rounded_box((inner + 0.01, 0.05, top - seat - 0.13), (0, 0, 0), 0.022, (0, 0.012, 0))
            .turned("x", -float(np.degrees(np.arctan2(lean, top - seat))))
            .moved(y=on_back(seat + 0.12) + 0.002, z=seat + 0.11),
        )
    return b.piece()


def _shell_chair(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A chair with seat and back of one moulded shell, on four splayed legs."""
    b = Builder("dining chair", "chair", "free", front_clearance=0.5)
    width, seat = float(rng.uniform(0.43, 0.47)), float(rng.uniform(0.44, 0.47))
    top = float(rng.uniform(0.79, 0.86))
    # Profile of the shell from the front edge of the seat to the top of the back: y, z.
    profile = np.array(
        [
            (-0.215, seat - 0.025), (-0.2, seat - 0.006), (-0.13, seat), (-0.02, seat - 0.012),
            (0.08, seat - 0.008), (0.135, seat + 0.022), (0.158, seat + 0.075),
            (0.17, seat + 0.16), (0.195, 0.5 * (seat + top) + 0.08), (0.212, top),
        ]
    )  # fmt: skip
    half = 0.5 * width * np.array([0.8, 0.92, 1.0, 1.0, 0.97, 0.93, 0.92, 0.96, 0.9, 0.62])
    across = np.linspace(-1, 1, 11)
    cup = np.array([0.004, 0.008, 0.016, 0.02, 0.022, 0.03, 0.035, 0.03, 0.02, 0.008])
    points = np.empty((len(across), len(profile), 3))
    points[..., 0] = across[:, None] * half
    # The sides of the seat curve up, those of the back forwards.
    lying = np.clip((0.17 - profile[:, 0]) / 0.1, 0, 1) * (profile[:, 1] < seat + 0.05)
    points[..., 1] = profile[:, 0] - (1 - lying) * cup * across[:, None] ** 2
    points[..., 2] = profile[:, 1] + lying * cup * across[:, None] ** 2
    shell = style.lacquer if rng.random() < 0.5 else style.accents[int(rng.integers(5))]
    if rng.random() < 0.35:
        shell = style.wood
    b.add(shell, thick_sheet(points, 0.008), name="shell")
    frame = leg_material(style, style.wood)
    thick = 0.018 if frame.kind == "metal" else 0.032
    under = seat - 0.03
    b.add(frame, box((0.24, 0.2, 0.014), (0, -0.02, under - 0.012), 0.002))
    for sx in (-1, 1):
        for y, foot in ((-0.1, -0.2), (0.06, 0.19)):
            ends = [(sx * 0.2, foot, 0), (sx * 0.1, y, under - 0.004)]
            b.add(frame, post(ends, [(0.6 * thick, 0.6 * thick), (thick, thick)]))
    return b.piece()


def armchair(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """An upholstered armchair."""
    return _couch(rng, style, "armchair", rng.uniform(0.78, 0.92), 1)


def sofa(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A sofa of two or three seats with loose cushions; `width` includes the arms, metres."""
    width = float(rng.uniform(1.6, 2.35)) if width is None else width
    return _couch(rng, style, "sofa", width, 3 if width > 1.95 else 2)


def _couch(
    rng: np.random.Generator, style: Style, name: str, width: float, seats: int
) -> FurniturePiece:
    depth, seat_z = rng.uniform(0.84, 0.96), rng.uniform(0.41, 0.46)
    back_z, arm_z = rng.uniform(0.76, 0.9), rng.uniform(0.56, 0.66)
    arm = rng.uniform(0.12, 0.2)
    foot = rng.uniform(0.08, 0.16)
    build = style.shape(rng, "sofa", ("block", "slim", "low", "rolled"))
    if build == "slim":  # thin arms and high legs
        arm, foot, arm_z = 0.55 * arm, foot + 0.06, arm_z + 0.01
    elif build == "low":  # broad arms as high as the back, close to the floor
        arm, foot, arm_z, back_z = arm + 0.04, 0.035, arm_z + 0.03, back_z - 0.05
        back_z = max(back_z, 0.78)
    arm_z = min(arm_z, 0.84 * back_z - (0.055 if build == "rolled" else 0.0))
    cloth = (
        style.second_upholstery if name == "armchair" and rng.random() < 0.6 else style.upholstery
    )
    b = Builder(name, name, "wall" if name == "sofa" else "free", front_clearance=0.45)
    b.add(
        leg_material(style, style.dark_wood if rng.random() < 0.4 else style.wood),
        *feet(style, width, depth, foot + 0.02, 0.045, 0.03),
    )
    back = 0.17
    inner = width - 2 * arm
    cushion = 0.15
    b.add(
        cloth,
        rounded_box(
            (width - 0.03, depth - 0.05, seat_z - cushion - foot), (0, 0, foot), 0.02, inner=2
        ),
        rounded_box(
            (width - 0.04, back, back_z - foot - 0.03), (0, depth / 2 - back / 2, foot + 0.01), 0.05
        ),
    )
    for side in (-1, 1):
        b.add(
            cloth,
            rounded_box(
                (arm, depth - 0.01, arm_z - foot),
                (side * (width / 2 - arm / 2), -0.005, foot),
                min(0.035 if arm < 0.16 else 0.06, 0.45 * arm),
                (0.008, 0, 0.01),
            ),
        )
        if build == "rolled":
            roll = cylinder(0.085, 0, depth - 0.02, 28, bevel=0.02).turned("x", 90)
            b.add(cloth, roll.moved(side * (width / 2 - arm / 2), depth / 2 - 0.012, arm_z - 0.03))
    each = inner / seats
    seat_depth = depth - back - 0.01
    for k in range(seats):
        x = -inner / 2 + (k + 0.5) * each
        b.add(
            cloth,
            rounded_box(
                (each - 0.006, seat_depth, cushion),
                (x, -depth / 2 + seat_depth / 2 - 0.005, seat_z - cushion - 0.002),
                0.04,
                (0, 0.005, 0.022),
                inner=4,
            ),
            rounded_box(
                (each - 0.012, 0.17, back_z - seat_z + 0.06),
                (0, 0, 0),
                0.06,
                (0, 0.03, 0.015),
                inner=4,
            )
            .turned("x", -rng.uniform(9, 14))
            .moved(x, depth / 2 - back - 0.115, seat_z + 0.025),
        )
    loose = int(rng.integers(0, 2)) if seats == 1 else int(rng.integers(2, 4))
    for k in range(loose):
        size = rng.uniform(0.38, 0.46)
        end = (-1, 1, 0)[k]
        x = end * (inner / 2 - size / 2 - rng.uniform(0.0, 0.06))
        askew = 2 + 7 * style.disorder
        loose_one = (
            stuffed((size, size, 0.15), int(rng.integers(5)), turned=rng.random() < 0.5)
            .moved(z=-0.075)
            .turned("z", float(rng.normal(0, askew)))
            .turned("x", 90 - rng.uniform(20, 28))
            .turned("z", -end * rng.uniform(5, 22))
        )
        lowest = float(loose_one.vertices[:, 2].min()) + 0.012  # it sinks in
        with b.holding("cushion", "cushion"):
            b.add(
                style.cushions[int(rng.integers(len(style.cushions)))],
                loose_one.moved(x, depth / 2 - back - 0.29, seat_z - lowest),
                name="cushion",
            )
    if name == "sofa" and loose == 2:  # between the cushions at its ends
        b.surface(0, -depth / 2 + 0.22, seat_z + 0.008, inner / 2 - 0.62, 0.17)
    return b.piece()


def stool(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A round stool, low or of bar height."""
    height = bool(rng.random() < 0.35)
    seat = rng.uniform(0.62, 0.68) if height else rng.uniform(0.43, 0.48)
    radius = rng.uniform(0.15, 0.19)
    b = Builder("bar stool" if height else "stool", "stool", "free")
    wood = style.wood
    frame = leg_material(style, wood)
    spread = radius * (1.15 if height else 1.05)
    ring = 0.35 * seat
    for k in range(4):
        angle = np.pi / 4 + k * np.pi / 2
        c, s = float(np.cos(angle)), float(np.sin(angle))
        size = 0.024 if style.legs == "metal" else 0.034
        b.add(
            frame,
            post(
                [(spread * c, spread * s, 0), (0.62 * radius * c, 0.62 * radius * s, seat - 0.02)],
                [(0.8 * size, 0.8 * size), (size, size)],
            ),
        )
    at_ring = spread + (0.62 * radius - spread) * ring / (seat - 0.02)
    turn = np.pi / 4 + np.arange(4) * np.pi / 2
    corners = np.stack([at_ring * np.cos(turn), at_ring * np.sin(turn), np.full(4, ring)], 1)
    for k in range(4):
        b.add(frame, bar(corners[k], corners[(k + 1) % 4], 0.009, 8))
    if rng.random() < 0.5:
        b.add(wood, cylinder(radius, seat - 0.035, seat, 32, bevel=0.008))
    else:
        b.add(wood, cylinder(radius - 0.01, seat - 0.045, seat - 0.028, 32))
        b.add(
            style.second_upholstery,
            lathe(
                [
                    (radius - 0.012, seat - 0.03),
                    (radius - 0.003, seat - 0.022),
                    (radius, seat - 0.01),
                    (radius - 0.003, seat + 0.002),
                    (radius - 0.014, seat + 0.011),
                    (0.75 * radius, seat + 0.019),
                    (0, seat + 0.024),
                ],
                32,
            ),
        )
    return b.piece()


def office_chair(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A swivel chair on a five-armed base with castors."""
    seat = rng.uniform(0.45, 0.51)
    b = Builder("office chair", "chair", "free", front_clearance=0.4)
    base = CHROME if rng.random() < 0.4 else BLACK_PLASTIC
    cloth = style.second_upholstery if rng.random() < 0.5 else style.upholstery
    start = rng.uniform(0, 72)
    for k in range(5):
        arm = loft(
            np.stack(
                [
                    np.array([[x, -w, z - t], [x, w, z - t], [x, w, z + t], [x, -w, z + t]])
                    for x, w, z, t in ((0.02, 0.026, 0.115, 0.02), (0.31, 0.015, 0.078, 0.009))
                ]
            )
        )
        b.add(base, arm.turned("z", start + 72 * k))
        wheel = cylinder(0.028, -0.009, 0.009, 16, bevel=0.003).turned("x", 90)
        turn = rng.uniform(0, 360)
        for side in (-1, 1):
            b.add(
                RUBBER,
                wheel.moved(y=0.014 * side)
                .turned("z", turn)
                .moved(0.295, 0, 0.028)
                .turned("z", start + 72 * k),
            )
        b.add(RUBBER, cylinder(0.008, 0.028, 0.072, 8).moved(x=0.295).turned("z", start + 72 * k))
    b.add(base, cylinder(0.035, 0.085, 0.14, 20), cylinder(0.026, 0.13, 0.28, 20))
    b.add(CHROME, cylinder(0.016, 0.27, seat - 0.09, 16))
    b.add(
        BLACK_PLASTIC,
        box((0.2, 0.24, 0.03), (0, 0, seat - 0.1), bevel=0.006),
        rounded_box((0.46, 0.46, 0.03), (0, 0, seat - 0.075), 0.012),
    )
    b.add(cloth, rounded_box((0.49, 0.48, 0.075), (0, -0.01, seat - 0.055), 0.035, (0, 0, 0.012)))
    height = rng.uniform(0.46, 0.64)
    back = rounded_box((0.46, 0.065, height), (0, 0, 0), 0.03, (0, 0.01, 0))
    back.vertices[:, 1] -= 0.5 * back.vertices[:, 0] ** 2  # concave towards the seat
    b.add(cloth, back.turned("x", -8).moved(y=0.235, z=seat + 0.1))
    b.add(
        BLACK_PLASTIC,
        tube(
            [(0, 0.1, seat - 0.08), (0, 0.25, seat - 0.07), (0, 0.3, seat), (0, 0.3, seat + 0.3)],
            [0.018, 0.02, 0.02, 0.016],
            10,
        ),
    )
    if rng.random() < 0.75:
        for side in (-1, 1):
            b.add(
                BLACK_PLASTIC,
                tube(
                    [
                        (side * 0.16, 0.03, seat - 0.07),
                        (side * 0.27, 0.03, seat - 0.06),
                        (side * 0.29, 0.03, seat + 0.0),
                        (side * 0.29, 0.03, seat + 0.19),
                    ],
                    0.014,
                    10,
                ),
                rounded_box((0.075, 0.25, 0.03), (side * 0.29, -0.01, seat + 0.18), 0.013),
            )
    return b.piece()


def pouf(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A round upholstered footstool."""
    radius, height = rng.uniform(0.22, 0.3), rng.uniform(0.34, 0.42)
    b = Builder("pouf", "stool", "free")
    cloth = style.second_upholstery
    rings = []
    for z, share in (
        (0.0, 0.86),
        (0.02, 0.94),
        (0.3 * height, 1.0),
        (0.48 * height, 0.985),
        (0.5 * height, 0.965),
        (0.52 * height, 0.985),
        (0.7 * height, 1.0),
        (0.93 * height, 0.92),
        (0.985 * height, 0.75),
        (height, 0.4),
        (1.004 * height, 0.05),
    ):
        rings.append(superellipse(radius * share, radius * share, z, 2.0, 36))
    b.add(cloth, loft(np.stack(rings)))
    b.add(style.dark_wood, sphere(0.014, 12, 6).scaled(z=0.5).moved(z=1.004 * height))
    b.surface(0, 0, height, 0.6 * radius, 0.6 * radius)
    return b.piece()


def bench(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A plain wooden bench, for the hall or along a table."""
    width = float(rng.uniform(0.95, 1.5)) if width is None else width
    depth, height = rng.uniform(0.32, 0.38), rng.uniform(0.43, 0.47)
    b = Builder("bench", "bench", "wall", front_clearance=0.4)
    wood = style.wood
    b.add(
        leg_material(style, wood),
        *feet(style, width, depth, height - 0.03, 0.045, 0.04, splay=0.01),
    )
    for k in range(3):
        each = depth / 3
        b.add(
            wood,
            box(
                (width, each - 0.006, 0.032), (0, (k - 1) * each, height - 0.032), 0.004, grain="x"
            ),
        )
    for sx in (-1, 1):
        b.add(wood, box((0.03, depth - 0.1, 0.04), (sx * (width / 2 - 0.12), 0, height - 0.071)))
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.03)
    return b.piece()
