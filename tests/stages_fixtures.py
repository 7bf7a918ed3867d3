"""Small hand-made scenes: a box room with blocks in it, every one at a known place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes.contract import Credit, Light, Room, Scene, SceneObject, save_scene, writing_scene


@dataclass(frozen=True)
class Block:
    """An axis-aligned block of furniture, metres."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    color: tuple[float, float, float] = (0.6, 0.3, 0.2)
    is_structure: bool = False


LIVING = (
    Block("sofa", (0.1, 0.1, 0.0), (2.0, 0.9, 0.8)),
    Block("table", (1.2, 1.5, 0.0), (2.2, 2.1, 0.5), (0.3, 0.5, 0.2)),
    Block("shelf", (3.6, 0.2, 0.0), (3.95, 1.6, 1.9), (0.5, 0.4, 0.3)),
    Block("chair", (2.6, 2.2, 0.0), (3.1, 2.7, 0.9), (0.2, 0.2, 0.6)),
    Block("chest", (0.1, 2.3, 0.0), (0.9, 2.9, 0.7), (0.7, 0.6, 0.2)),
)


def write_room(
    folder: Path,
    blocks: Sequence[Block] = LIVING,
    size: tuple[float, float, float] = (4.0, 3.0, 2.6),
    has_light: bool = True,
    source: dict[str, Any] | None = None,
    lamp: float = 10.0,
) -> Scene:
    """Write a room [0, size] with a square lamp under its ceiling as a complete scene folder."""
    folder = Path(folder)
    width, depth, height = size
    shell = [
        Block("floor", (0, 0, -0.1), (width, depth, 0), (0.5, 0.5, 0.5), True),
        Block("ceiling", (0, 0, height), (width, depth, height + 0.1), (0.8, 0.8, 0.8), True),
        Block("wall-w", (-0.1, 0, 0), (0, depth, height), (0.7, 0.7, 0.7), True),
        Block("wall-e", (width, 0, 0), (width + 0.1, depth, height), (0.7, 0.7, 0.7), True),
        Block("wall-s", (0, -0.1, 0), (width, 0, height), (0.7, 0.7, 0.7), True),
        Block("wall-n", (0, depth, 0), (width, depth + 0.1, height), (0.7, 0.7, 0.7), True),
    ]
    lamp_low = (width / 2 - 0.2, depth / 2 - 0.2, height - 0.06)
    bulb = Block("lamp", lamp_low, (width / 2 + 0.2, depth / 2 + 0.2, height - 0.02))
    everything = [*shell, *blocks, bulb]
    shapes = "\n".join(_shape(block, lamp if block is bulb else 0.0) for block in everything)
    scene = Scene(
        scene_id=folder.name,
        source={"kind": "test", **(source or {})},
        rooms=(
            Room(
                "living",
                "Living room",
                "living",
                ((0, 0), (width, 0), (width, depth), (0, depth)),
                0.0,
                height,
                has_light,
            ),
        ),
        objects=tuple(
            SceneObject(b.name, b.name, b.name, (b.name,), b.low, b.high, b.is_structure, "living")
            for b in everything
        ),
        lights=(Light("lamp", "area", ("lamp",), "living"),),
        portals=(),
        credits=(Credit("everything", "Test room", "nobody", "CC0-1.0", "generated"),),
        lighting="night",
        plan=folder.name,
    )
    with writing_scene(folder) as partial:
        (partial / "scene.xml").write_text(
            f'<scene version="3.0.0">\n<integrator type="path"/>\n{shapes}\n</scene>\n'
        )
        save_scene(partial, scene)
    return scene


def _shape(block: Block, radiance: float) -> str:
    centre = [(a + b) / 2 for a, b in zip(block.low, block.high, strict=True)]
    half = [(b - a) / 2 for a, b in zip(block.low, block.high, strict=True)]
    glow = (
        f'<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>'
        if radiance
        else ""
    )
    return (
        f'<shape type="cube" id="{block.name}"><transform name="to_world">'
        f'<scale x="{half[0]}" y="{half[1]}" z="{half[2]}"/>'
        f'<translate x="{centre[0]}" y="{centre[1]}" z="{centre[2]}"/></transform>'
        f'<bsdf type="diffuse"><rgb name="reflectance" value="{" ".join(map(str, block.color))}"/>'
        f"</bsdf>{glow}</shape>"
    )
