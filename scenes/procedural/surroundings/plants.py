"""Plants outside the windows: trees of single leaves, hedges and shrubs."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture.materials import hex_color, scaled_color
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, box, grid, merge, tube
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part, outdoor_item
from pbrnet.scenes.procedural.textures.fields import Spectrum, noise
from pbrnet.scenes.seeds import Draw

_LEAVES = ("#3f5230", "#4c5c36", "#38492f", "#59603a", "#5f5f36")
_BARK = "#4d4136"


def leaf_material(rng: Draw) -> Material:
    """Return a material of leaves in a muted green."""
    color = hex_color(rng.pick(_LEAVES))
    accent = scaled_color(color, 0.5)
    return Material("leaf", color, 0.6, accent=accent, scale=3.0, variant=rng.variant())


def tree(rng: Draw, name: str, at: Float64Array, ground: float, leaves: int = 2600) -> SceneItem:
    """Return a tree: trunk, branches, and folded leaves around the ends of its twigs."""
    height = rng.between(4.5, 9.5)
    radius = 0.018 * height
    base = np.array([at[0], at[1], ground - 0.2])
    lean = np.append(rng.normal(0, 0.2, 2), 0.0)
    top = base + lean + [0, 0, 0.8 * height]
    trunk = np.stack([base, 0.5 * (base + top) + 0.3 * lean, top])
    wood = [tube(trunk, [radius, 0.7 * radius, 0.2 * radius], 8)]
    middle = base + lean + [0, 0, 0.66 * height]
    crown = np.array([1.0, 1.0, rng.between(1.0, 1.4)]) * height * rng.uniform(0.2, 0.28)
    tips = []
    for k in range(26):
        direction = rng.normal(0, 1, 3)
        direction /= np.linalg.norm(direction)
        tip = middle + crown * direction * rng.between(0.55, 0.95)
        start = base + lean * 0.8 + [0, 0, height * rng.between(0.3, 0.6)]
        if k < 12:
            bend = 0.5 * (start + tip) + rng.normal(0, 0.05 * height, 3)
            radii = [0.4 * radius, 0.25 * radius, 0.08 * radius]
            wood.append(tube(np.stack([start, bend, tip]), radii, 6))
        tips.append(tip)
    chosen = np.array(tips)[rng.integers(len(tips), size=leaves)]
    scatter = rng.normal(0, 1, (leaves, 3)) * 0.27 * crown
    bark = Material("soil", hex_color(_BARK), 0.95, variant=rng.variant(), family="bark")
    crowns = np.array_split(_leaves(rng, chosen + scatter, 0.08 + 0.011 * height), 2)
    parts = [make_part("trunk", bark, *wood)]
    parts += [
        make_part(f"crown-{k}", leaf_material(rng), _mesh(quads)) for k, quads in enumerate(crowns)
    ]
    return outdoor_item(name, "plant", *parts)


def shrubs(rng: Draw, name: str, places: Float64Array, ground: float) -> SceneItem:
    """Return low round shrubs at `places` (N, 2)."""
    centres = []
    for place in places:
        size = rng.between(0.35, 0.8)
        offset = rng.normal(0, 1, (420, 3))
        away = size * (0.6 + 0.4 * rng.random((420, 1)))
        offset *= away / np.linalg.norm(offset, axis=1, keepdims=True)
        offset[:, 2] = np.abs(offset[:, 2]) * 0.9
        centres.append(np.array([place[0], place[1], ground]) + offset)
    mesh = _mesh(_leaves(rng, np.concatenate(centres), 0.07))
    return outdoor_item(name, "plant", make_part("leaves", leaf_material(rng), mesh))


def hedge(rng: Draw, centre: Float64Array, half: float, ground: float) -> SceneItem:
    """Return a clipped hedge around a garden; each side is missing with probability 1/4."""
    height, thickness = rng.between(0.9, 1.9), 0.7
    surface = noise(rng, 64, Spectrum(0.9))
    runs = []
    tufts = []
    for side in range(4):
        if rng.chance(0.25):
            continue
        length = 2 * half - thickness
        count = max(8, int(length / 0.35))
        # Rounded cross-section, extruded along the side with a rough surface.
        right = np.array([[0.25, 1], [0.45, 0.92], [0.52, 0.5], [0.5, 0]])
        profile = np.concatenate([right[::-1] * [-1, 1], right])
        run = np.zeros((count, len(profile), 3))
        run[..., 0] = np.linspace(-length / 2, length / 2, count)[:, None]
        rough = 0.06 * surface[np.arange(count)[:, None] % 64, np.arange(len(profile)) + 8 * side]
        run[..., 1] = profile[:, 0] * thickness * (1 + rough)
        run[..., 2] = profile[:, 1] * height * (1 + 0.6 * rough) - 0.05
        runs.append(_extruded(run).moved(y=-half).turned("z", 90.0 * side))
        x = rng.uniform(-length / 2, length / 2, 2400)
        y = -half + 0.5 * thickness * np.where(rng.random(2400) < 0.5, 1.02, -1.02)
        spots = np.stack([x, y, rng.uniform(0.05, height, 2400)], axis=1)
        spots[::3, 1] = -half + rng.uniform(-0.4, 0.4, 800) * thickness
        spots[::3, 2] = height
        tufts.append(_mesh(_leaves(rng, spots, 0.045)).turned("z", 90.0 * side))
    if not runs:
        runs = [box((0.5, 0.5, 0.5), (half, half, 0.0))]
        tufts = runs
    move = (float(centre[0]), float(centre[1]), ground)
    return outdoor_item(
        "hedge",
        "plant",
        make_part("hedge", leaf_material(rng), merge(runs).moved(*move), smooth=True),
        make_part("leaves", leaf_material(rng), merge(tufts).moved(*move)),
    )


def _leaves(rng: Draw, centres: Float64Array, size: float) -> Float64Array:
    """Return corners (N, 4, 3) of leaves of about `size` metres, folded along the midrib."""
    count = len(centres)
    along = rng.normal(0, 1, (count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, rng.normal(0, 1, (count, 3)))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    fold = 0.3 * np.cross(along, across)
    half = size * rng.uniform(0.6, 1.3, (count, 1))
    return np.stack(
        [
            centres - half * along,
            centres + 0.55 * half * (across + fold),
            centres + half * along,
            centres + 0.55 * half * (fold - across),
        ],
        axis=1,
    )


def _mesh(quads: Float64Array) -> BodyMesh:
    """Return the mesh of folded quadrilaterals (N, 4, 3): two triangles each."""
    first = 4 * np.arange(len(quads))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    vertices = quads.reshape(-1, 3)
    return BodyMesh(vertices, faces, vertices[:, [0, 2]].copy(), smooth=False)


def _extruded(points: Float64Array) -> BodyMesh:
    """Quads over a grid of `points` (n, m, 3), closed by the two flat ends."""
    side = grid(points.swapaxes(0, 1))
    ends = [
        BodyMesh(
            ring, np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)]), ring[:, 1:].copy()
        )
        for ring in (points[0, ::-1], points[-1])
    ]
    return merge([side, *ends])
