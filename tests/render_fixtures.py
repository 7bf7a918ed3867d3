"""Small scene folders whose right answers are known on paper."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pipeline.views import View, as_matrix, look
from scenes.contract import (
    Credit,
    Light,
    Portal,
    Room,
    Scene,
    SceneObject,
    load_scene,
    save_scene,
    writing_scene,
)

CREDIT = Credit("everything", "test scene", "pbrnet", "CC0-1.0", "generated")


def write_scene(
    folder: Path,
    body: str,
    objects: dict[str, tuple[str, ...]] | None = None,
    portals: Iterable[Portal] = (),
    lights: Iterable[Light] = (),
    files: dict[str, bytes] | None = None,
) -> Scene:
    """A scene folder with `body` inside <scene>; `objects` maps object id -> shape ids."""
    with writing_scene(folder) as partial:
        (partial / "scene.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
        for name, content in (files or {}).items():
            (partial / name).write_bytes(content)
        save_scene(
            partial,
            Scene(
                scene_id=folder.name,
                source={"kind": "test"},
                rooms=(
                    Room("r", "room", "other", ((-2, -2), (2, -2), (2, 2), (-2, 2)), 0, 3, True),
                ),
                objects=tuple(
                    SceneObject(name, name, name, shapes, (-2, -2, 0), (2, 2, 3), False)
                    for name, shapes in (objects or {}).items()
                ),
                lights=tuple(lights),
                portals=tuple(portals),
                credits=(CREDIT,),
            ),
        )
    return load_scene(folder)


def diffuse(value: float | str = 0.5, name: str = "") -> str:
    """A two-sided diffuse material."""
    identity = f' id="{name}"' if name else ""
    return (
        f'<bsdf type="twosided"{identity}><bsdf type="diffuse">'
        f'<rgb name="reflectance" value="{value}"/></bsdf></bsdf>'
    )


def quad(
    name: str,
    centre: tuple[float, float, float],
    towards: tuple[float, float, float],
    half: tuple[float, float],
    inside: str = "",
    up: tuple[float, float, float] = (0, 0, 1),
) -> str:
    """A rectangle at `centre` whose normal is `towards`; `half` sizes along its right and up."""
    target = ",".join(str(c + t) for c, t in zip(centre, towards, strict=True))
    return (
        f'<shape type="rectangle" id="{name}"><transform name="to_world">'
        f'<scale x="{half[0]}" y="{half[1]}"/>'
        f'<lookat origin="{",".join(map(str, centre))}" target="{target}" '
        f'up="{",".join(map(str, up))}"/></transform>{inside}</shape>'
    )


def ball(name: str, centre: tuple[float, float, float], radius: float, inside: str = "") -> str:
    """A sphere."""
    x, y, z = centre
    return (
        f'<shape type="sphere" id="{name}"><point name="center" x="{x}" y="{y}" z="{z}"/>'
        f'<float name="radius" value="{radius}"/>{inside}</shape>'
    )


def glow(radiance: float | str = 1.0) -> str:
    """An area emitter on a black surface."""
    return diffuse(0) + (
        f'<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>'
    )


def room_walls(material: str, window: bool = False) -> tuple[str, tuple[str, ...]]:
    """A closed box room, x and y in [-2, 2], z in [0, 3]; its XML and its shape ids.

    With `window`, the wall y = 2 has a hole, x in [-0.5, 0.5], z in [1, 2].
    """
    flat = (0.0, 1.0, 0.0)
    parts = {
        "floor": quad("floor", (0, 0, 0), (0, 0, 1), (2, 2), material, flat),
        "ceiling": quad("ceiling", (0, 0, 3), (0, 0, -1), (2, 2), material, flat),
        "west": quad("west", (-2, 0, 1.5), (1, 0, 0), (2, 1.5), material),
        "east": quad("east", (2, 0, 1.5), (-1, 0, 0), (2, 1.5), material),
        "south": quad("south", (0, -2, 1.5), (0, 1, 0), (2, 1.5), material),
    }
    back = (0.0, -1.0, 0.0)
    if window:
        parts |= {
            "north_a": quad("north_a", (-1.25, 2, 1.5), back, (0.75, 1.5), material),
            "north_b": quad("north_b", (1.25, 2, 1.5), back, (0.75, 1.5), material),
            "north_c": quad("north_c", (0, 2, 0.5), back, (0.5, 0.5), material),
            "north_d": quad("north_d", (0, 2, 2.5), back, (0.5, 0.5), material),
        }
    else:
        parts["north"] = quad("north", (0, 2, 1.5), back, (2, 1.5), material)
    return "".join(parts.values()), tuple(parts)


WINDOW = Portal(
    "window",
    "window",
    ((-0.5, 2, 1), (0.5, 2, 1), (0.5, 2, 2), (-0.5, 2, 2)),
    (0, 1, 0),
    True,
)


def make_view(
    eye: tuple[float, float, float] = (0, 0, 1.5),
    towards: tuple[float, float, float] = (0, 1, 0),
    size: tuple[int, int] = (32, 24),
    focal: float | None = None,
    centre: tuple[float, float] | None = None,
    up: tuple[float, float, float] = (0, 0, 1),
) -> View:
    """A view of `size` (width, height); the principal point is the middle unless given."""
    width, height = size
    focal = focal or width * 0.8
    cx, cy = centre or (width / 2, height / 2)
    intrinsics = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])
    return View(
        "test", "v", width, height, as_matrix(intrinsics), as_matrix(look(eye, towards, up))
    )
