"""Outdoor surroundings of a home: ground, terrace, hedge, trees, houses, hills."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import Polygon

from scenes.geometry.regions import buffered
from scenes.procedural.furniture.geometry import BodyMesh, box, merge, prism, span, sphere, tube
from scenes.procedural.furniture.style import hex_color, scaled_color
from scenes.procedural.patterns import noise
from scenes.procedural.piece import Material
from scenes.procedural.plan import Plan
from scenes.procedural.scene_item import SceneItem, make_part

LAWN = 70.0  # half the side of the lawn, metres
GROUND = 2500.0  # half the side of the ground plane, metres
_ROOFS = ("#7d4436", "#5b5653", "#8a4f3b", "#4a4a4c")
_PLASTERS = ("#d9d0be", "#c9b89a", "#bfc0ba", "#d8c2a8", "#a9533c", "#cfd2d2")
# Muted greens: seen from indoors they are overexposed, and saturated ones would clip.
_LEAVES = ("#4a5936", "#586541", "#42543c", "#65694a", "#6c6b48")
_LAWNS = ("#5a6050", "#606456", "#646358")
_HAZE = ("#7d8a86", "#87918f")  # of distant woods and hills, seen through haze


def build_outdoors(rng: np.random.Generator, plan: Plan) -> list[SceneItem]:
    """Build the surroundings of a home as structure items."""
    outline = Polygon(plan.outline)
    centre = np.array(outline.centroid.coords[0])
    ground = plan.ground
    grass = Material(
        "grass",
        hex_color(_LAWNS[int(rng.integers(len(_LAWNS)))]),
        0.95,
        accent=hex_color("#4c5438"),
        variant=int(rng.integers(1 << 30)),
    )
    paving = Material(
        "tiles",
        hex_color(("#a9a49a", "#8f8c87", "#b8a88f")[int(rng.integers(3))]),
        0.8,
        accent=hex_color("#7b766d"),
        scale=1.4,
        variant=int(rng.integers(1 << 30)),
    )
    x, y = centre
    lawn = _ground(x - LAWN, y - LAWN, x + LAWN, y + LAWN, ground)
    far = _ground(x - GROUND, y - GROUND, x + GROUND, y + GROUND, ground - 0.1)
    around = buffered(outline, float(rng.uniform(0.8, 2.6)), join_style="mitre")
    terrace = prism(shapely.get_coordinates(around.exterior)[:-1], ground - 0.05, ground + 0.02)
    terrace = BodyMesh(terrace.vertices, terrace.faces, terrace.vertices[:, :2].copy())
    fields = Material("paint", hex_color("#80857a"), 0.95)
    hills = [
        make_part(
            f"hills-{k}", Material("paint", hex_color(code), 0.95), _hills(rng, centre, ground, k)
        )
        for k, code in enumerate(_HAZE)
    ]
    items = [
        _outside("ground", "ground", [make_part("lawn", grass, lawn)]),
        _outside("fields", "ground", [make_part("fields", fields, far), *hills]),
        _outside("terrace", "ground", [make_part("paving", paving, terrace)]),
    ]
    half = 0.5 * float(np.hypot(*(np.ptp(np.array(plan.outline), axis=0))))
    turn = float(rng.uniform(0, 360))
    for number in range(int(rng.integers(3, 6))):
        angle = np.radians(turn + 360 * number / 5 + float(rng.uniform(-20, 20)))
        distance = half + float(rng.uniform(9, 22))
        at = centre + distance * np.array([np.cos(angle), np.sin(angle)])
        items.append(_house(rng, f"neighbour-{number}", at, np.degrees(angle), ground))
    for number in range(int(rng.integers(4, 9))):
        angle = float(rng.uniform(0, 2 * np.pi))
        distance = half + float(rng.uniform(3.5, 9))
        at = centre + distance * np.array([np.cos(angle), np.sin(angle)])
        if outline.distance(shapely.Point(at)) > 2.5:
            items.append(_tree(rng, f"tree-{number}", at, ground))
    hedge = _hedge(rng, centre, half + float(rng.uniform(4.0, 7.0)), ground)
    leaf = _leaf(rng)
    items.append(_outside("hedge", "plant", [make_part("hedge", leaf, hedge, smooth=True)]))
    return items


def _outside(name: str, category: str, parts: list) -> SceneItem:
    return SceneItem(f"outside-{name}", name, category, tuple(parts), True, None)


def _leaf(rng: np.random.Generator) -> Material:
    color = hex_color(_LEAVES[int(rng.integers(len(_LEAVES)))])
    return Material(
        "leaf",
        color,
        0.6,
        accent=scaled_color(color, 0.5),
        scale=3.0,
        variant=int(rng.integers(1 << 30)),
    )


def _ground(x0: float, y0: float, x1: float, y1: float, z: float) -> BodyMesh:
    vertices = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    return BodyMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2].copy())


def _hills(rng: np.random.Generator, centre: np.ndarray, ground: float, ring: int) -> BodyMesh:
    """Ring of distant woods (`ring` 0) or of higher and more distant hills (1)."""
    radius, low, high = ((320.0, 6.0, 3.0), (1500.0, 30.0, 20.0))[ring]
    count = 512
    skyline = noise(rng, count, 1.1)[0]
    tops = ground + np.maximum(low + high * skyline, 2.0)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    circle = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.stack(
        [
            np.column_stack([circle, np.full(count, ground - 1.0)]),
            np.column_stack([circle, tops]),
        ]
    )
    low_ring = np.arange(count)
    after = np.roll(low_ring, -1)
    faces = np.concatenate(
        [
            np.column_stack([low_ring, after, low_ring + count]),
            np.column_stack([after, after + count, low_ring + count]),
        ]
    )
    return BodyMesh(points.reshape(-1, 3), faces, points.reshape(-1, 3)[:, [0, 2]].copy())


def _house(
    rng: np.random.Generator, name: str, at: np.ndarray, degrees: float, ground: float
) -> SceneItem:
    """Neighbouring house with a gable roof and dark windows in light frames, facing the home."""
    width, depth = float(rng.uniform(8, 14)), float(rng.uniform(7, 10))
    storeys = int(rng.integers(1, 4))
    high = 2.9 * storeys + 0.4
    eaves, ridge = 0.4, float(rng.uniform(1.5, 3.5))
    walls = span((-width / 2, -depth / 2, -0.3), (width / 2, depth / 2, high))
    roof = prism(
        [
            (-depth / 2 - eaves, 0.0),
            (depth / 2 + eaves, 0.0),
            (0.0, ridge),
        ],
        -width / 2 - eaves,
        width / 2 + eaves,
    )
    # The gable was extruded along z: permute the axes so that it runs along x with its tip up.
    vertices = np.stack([roof.vertices[:, 2], roof.vertices[:, 0], roof.vertices[:, 1]], axis=1)
    roof = BodyMesh(vertices + np.array([0, 0, high]), roof.faces, roof.uvs)
    panes, frames = [], []
    columns = max(2, int(width / 2.6))
    for storey in range(storeys):
        for column in range(columns):
            x = width * ((column + 0.5) / columns - 0.5)
            z = 0.9 + 2.9 * storey
            for side in (-1, 1):
                y = side * depth / 2
                panes.append(box((1.1, 0.06, 1.3), (x, y, z)))
                frames += [
                    box((1.3, 0.12, 0.09), (x, y, z - 0.09)),
                    box((1.3, 0.12, 0.09), (x, y, z + 1.3)),
                    box((0.09, 0.12, 1.3), (x - 0.6, y, z)),
                    box((0.09, 0.12, 1.3), (x + 0.6, y, z)),
                    box((0.06, 0.1, 1.3), (x, y, z)),
                ]
    code = _PLASTERS[int(rng.integers(len(_PLASTERS)))]
    brick = code == "#a9533c"
    wall = Material(
        "brick" if brick else "plaster",
        hex_color(code),
        0.9,
        accent=hex_color("#a8a196") if brick else None,
        variant=int(rng.integers(1 << 30)),
    )
    place = [
        (wall, walls, "walls"),
        (Material("paint", hex_color(_ROOFS[int(rng.integers(len(_ROOFS)))]), 0.8), roof, "roof"),
        (Material("plastic", hex_color("#20262c"), 0.1), merge(panes), "panes"),
        (Material("paint", hex_color("#dcdad4"), 0.5), merge(frames), "frames"),
    ]
    turn = round(float(degrees) / 15) * 15 + 90.0
    parts = [
        make_part(label, material, mesh.turned("z", turn).moved(at[0], at[1], ground))
        for material, mesh, label in place
    ]
    return _outside(name, "building", parts)


def _tree(rng: np.random.Generator, name: str, at: np.ndarray, ground: float) -> SceneItem:
    """Tree with a trunk, five branches, and a crown of many small leaf clumps."""
    height = float(rng.uniform(4.5, 9.5))
    radius = 0.018 * height
    base = np.array([at[0], at[1], ground - 0.2])
    lean = np.append(rng.normal(0, 0.25, 2), 0.0)
    top = base + lean + [0, 0, 0.72 * height]
    trunk = [
        tube(
            np.stack([base, 0.5 * (base + top) + 0.3 * lean, top]),
            [radius, 0.7 * radius, 0.3 * radius],
            8,
        )
    ]
    clumps = []
    crown = float(rng.uniform(0.22, 0.32)) * height
    middle = base + lean + [0, 0, 0.68 * height]
    ball = sphere(1.0, 9, 6)
    places, inverse = np.unique(np.round(ball.vertices, 6), axis=0, return_inverse=True)
    for k in range(int(rng.integers(60, 80))):
        offset = rng.normal(0, 1, 3)
        offset *= crown * float(rng.uniform(0.35, 1.0)) / np.linalg.norm(offset)
        offset[2] *= 1.15
        size = crown * float(rng.uniform(0.12, 0.24))
        wobble = (1 + 0.16 * rng.standard_normal(len(places)))[inverse.reshape(-1), None]
        vertices = ball.vertices * wobble * size + middle + offset
        clumps.append(BodyMesh(vertices, ball.faces, ball.uvs * size))
        if k < 5:
            start = base + lean * 0.8 + [0, 0, height * float(rng.uniform(0.35, 0.55))]
            trunk.append(
                tube(np.stack([start, middle + 0.8 * offset]), [0.5 * radius, 0.15 * radius], 6)
            )
    bark = Material("soil", hex_color("#5b4a3a"), 0.95, variant=int(rng.integers(1 << 30)))
    return _outside(
        name, "plant", [make_part("trunk", bark, *trunk), make_part("crown", _leaf(rng), *clumps)]
    )


def _hedge(rng: np.random.Generator, centre: np.ndarray, half: float, ground: float) -> BodyMesh:
    """Clipped hedge around the garden; each side is missing with probability 1/4."""
    height, thickness = float(rng.uniform(0.9, 1.9)), 0.7
    surface = noise(rng, 64, 0.9)
    runs = []
    for side in range(4):
        if rng.random() < 0.25:
            continue
        length = 2 * half - thickness
        count = max(8, int(length / 0.35))
        # Rounded cross-section, extruded along the side with a rough surface.
        profile = np.array(
            [
                [-0.5, 0],
                [-0.52, 0.5],
                [-0.45, 0.92],
                [-0.25, 1],
                [0.25, 1],
                [0.45, 0.92],
                [0.52, 0.5],
                [0.5, 0],
            ]
        )
        run = np.zeros((count, len(profile), 3))
        run[..., 0] = np.linspace(-length / 2, length / 2, count)[:, None]
        rough = 0.06 * surface[np.arange(count)[:, None] % 64, np.arange(len(profile)) + 8 * side]
        run[..., 1] = profile[:, 0] * thickness * (1 + rough)
        run[..., 2] = profile[:, 1] * height * (1 + 0.6 * rough) - 0.05
        runs.append(_extruded(run).moved(y=-half).turned("z", 90.0 * side))
    if not runs:
        runs = [box((0.5, 0.5, 0.5), (half, half, 0.0))]
    return merge(runs).moved(float(centre[0]), float(centre[1]), ground)


def _extruded(points: np.ndarray) -> BodyMesh:
    """Quads over a grid of `points` (n, m, 3), closed by the two flat ends."""
    n, m = points.shape[:2]
    index = np.arange(n * m).reshape(n, m)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )[:, ::-1]
    fan = [[0, k, k + 1] for k in range(1, m - 1)]
    last = index[-1, 0]
    ends = np.array(
        [[p, r, q] for p, q, r in fan] + [[last + p, last + q, last + r] for p, q, r in fan]
    )
    flat = points.reshape(-1, 3)
    return BodyMesh(flat, np.concatenate([faces, ends]).astype(np.int64), flat[:, [0, 2]].copy())
