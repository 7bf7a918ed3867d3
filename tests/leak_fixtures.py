"""Buildings of bare quads, for tests of what closes them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from gltf_fixtures import Builder

from pipeline.render import raycast
from pipeline.render.scene import RenderScene, open_scene
from scenes.registry import import_scene

Corner = tuple[float, float, float]
Quad = tuple[Corner, Corner, Corner, Corner]
ROOM = (5.0, 4.0, 2.7)  # metres; its outer wall with the fault is that at x = 0


def box_quads(low: Corner, high: Corner, without: str = "") -> list[Quad]:
    """The sides of a box but those named: w, e (x), s, n (y), b, t (z)."""
    (x, y, z), (u, v, w) = low, high
    sides: dict[str, Quad] = {
        "w": ((x, y, z), (x, v, z), (x, v, w), (x, y, w)),
        "e": ((u, y, z), (u, v, z), (u, v, w), (u, y, w)),
        "s": ((x, y, z), (u, y, z), (u, y, w), (x, y, w)),
        "n": ((x, v, z), (u, v, z), (u, v, w), (x, v, w)),
        "b": ((x, y, z), (u, y, z), (u, v, z), (x, v, z)),
        "t": ((x, y, w), (u, y, w), (u, v, w), (x, v, w)),
    }
    return [quad for name, quad in sides.items() if name not in without]


def west(x: float, y: tuple[float, float], z: tuple[float, float], size: Corner) -> list[Quad]:
    """The wall at x of a room of `size`, around a hole."""
    strips = [((0.0, y[0]), (0.0, size[2])), ((y[1], size[1]), (0.0, size[2])),
              (y, (0.0, z[0])), (y, (z[1], size[2]))]  # fmt: skip
    return [
        ((x, a, c), (x, b, c), (x, b, d), (x, a, d)) for (a, b), (c, d) in strips if b > a and d > c
    ]


def built(folder: Path, quads: Sequence[Quad]) -> RenderScene:
    """A glTF model of these quads, each two-sided, imported."""
    corners = np.array(quads).reshape(-1, 3)
    points = np.column_stack([corners[:, 0], corners[:, 2], -corners[:, 1]])  # Y up
    faces = [4 * number + k for number in range(len(quads)) for k in (0, 1, 2, 0, 2, 3)]
    made = Builder()
    paint = made.add("materials", {"doubleSided": True})
    made.node(mesh=made.mesh(points, faces, material=paint), name="house")
    return open_scene(import_scene(made.save(folder / "made.glb"), folder / "made"))


def slit(size: Corner) -> list[Quad]:
    """The wall at x = 0 with a slit of 6 mm below the ceiling and one of 5 mm from the floor up."""
    _, depth, height = size
    top = height - 0.006
    return [
        ((0.0, 0.0, 0.0), (0.0, 1.5, 0.0), (0.0, 1.5, top), (0.0, 0.0, top)),
        ((0.0, 1.505, 0.0), (0.0, depth, 0.0), (0.0, depth, top), (0.0, 1.505, top)),
    ]


def seen_share(scene: RenderScene, name: str, eye: Corner, count: int = 50_000) -> float:
    """Of looks around from `eye` the share that meets the shape `name`."""
    ways = raycast.unit(np.random.default_rng(0).normal(size=(count, 3)))
    shape, _ = raycast.nearest(scene.target, eye, ways)
    number = [made.id() for made in scene.target.shapes].index(name)
    return float(np.mean(shape == number))


def points_of(scene: RenderScene, name: str) -> np.ndarray:
    """Corners (N, 3) of what an import added."""
    (part,) = (thing for thing in scene.scene.objects if thing.name == name)
    assert part.is_structure
    mesh = trimesh.load(scene.scene.folder / "meshes" / f"{name}.ply", process=False)
    return np.asarray(mesh.vertices)
