"""A whole home from a seed: plan, building, furniture, surroundings and light as one scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from scenes.contract import Credit, Light, Room, Scene, SceneObject, save_scene, writing_scene
from scenes.formats.ply import write_ply
from scenes.geometry.mesh import Mesh
from scenes.params import Aspect, SceneParams
from scenes.procedural.finishes import make_finishes
from scenes.procedural.furnishing.asset_sampler import Shop, open_stock
from scenes.procedural.furnishing.placement import furnish
from scenes.procedural.furniture.style import make_style
from scenes.procedural.lighting import (
    Sky,
    as_lamps,
    choose_lit,
    draw_cooler,
    draw_sky,
    emitter,
    lamps_of,
    sampling_weight,
)
from scenes.procedural.materials import MaterialLibrary
from scenes.procedural.outdoors import build_outdoors
from scenes.procedural.piece import Credit as Bought
from scenes.procedural.piece import Part
from scenes.procedural.plan import Plan, make_plan
from scenes.procedural.scene_item import Thing
from scenes.procedural.structure import build_structure
from scenes.seeds import generator

EYE = 1.55  # metres; of the sensor in scene.xml
HALF_FOV = 0.5534  # radians


def make_home(
    folder: Path,
    scene_id: str,
    params: SceneParams,
    seed: int,
    lighting: str,
    variant: int = 0,
    assets: Path | None = None,
) -> Scene:
    """Write a procedural home as the scene folder `folder` and return its `Scene`.

    Everything but the light depends on `seed` and `params` alone, so homes that differ only in
    `lighting` ("day", "evening", "night", "mixed") share their plan and furniture. Equal
    arguments give equal bytes. A `variant` above 0 keeps the plan and draws anew what
    `params.vary` names: finishes (materials and colours), furniture (pieces, places and small
    things), light (hour, weather, lamps), outdoors. `assets` is the folder of converted
    catalogues, which `params.catalogue_share` above 0 asks for.
    """

    def draws(aspect: Aspect, *names: str) -> np.random.Generator:
        anew = variant > 0 and aspect in params.vary
        return generator(seed, *names, *(("variant", variant) if anew else ()))

    plan = make_plan(generator(seed, "plan"), params.rooms_min, params.rooms_max)
    style = make_style(draws("finishes", "style"))
    kinds = {room.id: str(room.type) for room in plan.rooms}
    finishes = make_finishes(draws("finishes", "finishes"), style, kinds)
    building, portals = build_structure(plan, finishes)
    shop = None
    if params.catalogue_share > 0 and assets is not None:
        shop = Shop(draws("furniture", "catalogue"), open_stock(assets), params)
    furniture = furnish(draws("furniture", "furniture"), plan, style, shop)
    outdoors = build_outdoors(draws("outdoors", "outdoors"), plan)
    things = [*building, *furniture, *outdoors]
    bright = {
        room
        for opening in plan.openings
        if opening.is_outer
        for room in opening.rooms
        if opening.kind != "entrance"
    }
    windowless = [room.id for room in plan.rooms if room.id not in bright]
    lit = choose_lit(draws("light", "lamps", lighting), lighting, as_lamps(furniture), windowless)
    burning = [part for thing in lamps_of(furniture) if thing.id in lit for part in thing.parts]
    lamp_weight = sum(sampling_weight(part) for part in burning if part.lumens > 0)
    cooler = draw_cooler(draws("light", "lamp colour", lighting))
    sky = draw_sky(draws("light", "sky", lighting), lighting, lamp_weight)
    with writing_scene(Path(folder)) as partial:
        library = MaterialLibrary(partial, params.texture_size)
        objects, lights, shapes = _write_shapes(partial, things, lit, cooler, library)
        scene = Scene(
            scene_id=scene_id,
            source={
                "kind": "procedural",
                "seed": str(seed),
                "variant": variant,
                "varied": list(params.vary) if variant else [],
                "finishes": {
                    room: {"floor": finish.floor.kind, "walls": finish.wall.kind}
                    for room, finish in sorted(finishes.rooms.items())
                },
                "light": {**sky.choices, "lamps_cooler": cooler},
            },
            rooms=_rooms(plan, furniture),
            objects=tuple(objects),
            lights=(*lights, *sky.lights),
            portals=tuple(portals),
            credits=_credits(furniture),
            lighting=lighting,
            plan=f"home-{seed:016x}",
        )
        text = _scene_xml(plan, furniture, library, shapes, sky)
        (partial / "scene.xml").write_text(text, encoding="utf-8")
        save_scene(partial, scene)
    object.__setattr__(scene, "folder", Path(folder))
    return scene


def _rooms(plan: Plan, furniture: Sequence[Thing]) -> tuple[Room, ...]:
    lamps = {lamp.room for lamp in lamps_of(furniture)}
    lit = lamps | {room for opening in plan.openings for room in opening.rooms}
    names: dict[str, int] = {}
    rooms = []
    for room in plan.rooms:
        names[room.type] = names.get(room.type, 0) + 1
        number = names[room.type]
        rooms.append(
            Room(
                id=room.id,
                name=room.type if number == 1 else f"{room.type} {number}",
                type=room.type,
                floor=room.polygon,
                floor_z=0.0,
                ceiling_z=plan.height,
                has_light=room.id in lit,
            )
        )
    return tuple(rooms)


def _write_shapes(
    folder: Path,
    things: Sequence[Thing],
    lit: set[str],
    cooler: float,
    library: MaterialLibrary,
) -> tuple[list[SceneObject], list[Light], list[str]]:
    """Meshes to disk; the objects, the lamps that burn, and the `<shape>` elements."""
    objects, lights, shapes = [], [], []
    for thing in things:
        ids: list[str] = []
        glowing: list[str] = []
        lumens = 0.0
        for part in _merged(thing.parts, thing.id in lit):
            shape = f"{thing.id}.{len(ids)}"
            ids.append(shape)
            write_ply(folder / "meshes" / f"{shape}.ply", _mesh(part, library.tile(part.material)))
            light = ""
            if part.lumens > 0:
                glowing.append(shape)
                lumens += part.lumens
                light = emitter(part, cooler)
            flat = "" if part.smooth else '<boolean name="face_normals" value="true"/>'
            shapes.append(
                f'<shape type="ply" id="{shape}"><string name="filename" '
                f'value="meshes/{shape}.ply"/>{flat}<ref id="{library.bsdf(part.material)}"/>'
                f"{light}</shape>"
            )
        low, high = np.round(thing.bounds, 4).tolist()
        objects.append(
            SceneObject(
                id=thing.id,
                name=thing.name,
                category=thing.category,
                shapes=tuple(ids),
                bbox_min=(low[0], low[1], low[2]),
                bbox_max=(high[0], high[1], high[2]),
                is_structure=thing.is_structure,
                room=thing.room,
            )
        )
        if glowing:
            lights.append(Light(thing.id, "area", tuple(glowing), thing.room, round(lumens, 1)))
    return objects, lights, shapes


def _mesh(part: Part, tile: float) -> Mesh:
    """A part's mesh; its uvs, metres, become repeats of a texture of `tile` metres."""
    # Facetted parts carry no normals; their shape asks Mitsuba for `face_normals`.
    return Mesh(part.vertices, part.faces, part.normals if part.smooth else None, part.uvs / tile)


def _merged(parts: Sequence[Part], lit: bool) -> list[Part]:
    """Parts of one material joined to one mesh; what could burn but does not is dark."""
    groups: dict[tuple, list[Part]] = {}
    for part in parts:
        part = part if lit else replace(part, lumens=0.0)
        lamp = (part.name, part.kelvin) if part.lumens > 0 else ()
        groups.setdefault((part.material, part.smooth, lamp), []).append(part)
    merged = []
    for group in groups.values():
        starts = np.cumsum([0, *(len(part.vertices) for part in group)])
        merged.append(
            replace(
                group[0],
                vertices=np.concatenate([part.vertices for part in group]),
                faces=np.concatenate(
                    [part.faces + start for part, start in zip(group, starts, strict=False)]
                ),
                uvs=np.concatenate([part.uvs for part in group]),
                given=_joined([part.given for part in group]),
                lumens=sum(part.lumens for part in group),
            )
        )
    return merged


def _joined(tables: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """All tables in one; None unless all are there."""
    present = [table for table in tables if table is not None]
    return np.concatenate(present) if len(present) == len(tables) else None


def _credits(things: Sequence[Thing]) -> tuple[Credit, ...]:
    """The generator's own credit, then one for each author, licence and library of a catalogue."""
    names: dict[Bought, set[str]] = {}
    for thing in things:
        if thing.credit is not None:
            names.setdefault(thing.credit, set()).add(thing.name)
    own = "everything else" if names else "everything"
    made = [Credit(own, "procedural home", "pbrnet", "CC0-1.0", "generated")]
    for bought in sorted(names, key=lambda each: (each.library, each.author, each.licence)):
        part = ", ".join(sorted(names[bought]))
        title = f"furniture of the catalogue {bought.library}"
        made.append(Credit(part, title, bought.author, bought.licence, bought.source))
    return tuple(made)


def _near(spot: np.ndarray, box: np.ndarray) -> bool:
    """Whether a point is in a box (2, 3) or within a quarter of a metre of it."""
    return bool((spot > box[0] - 0.25).all() and (spot < box[1] + 0.25).all())


def _scene_xml(
    plan: Plan,
    furniture: Sequence[Thing],
    library: MaterialLibrary,
    shapes: list[str],
    sky: Sky,
) -> str:
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<scene version="3.0.0">',
        '<integrator type="path"><integer name="max_depth" value="11"/></integrator>',
        _sensor(plan, furniture),
        sky.xml,
        *library.xml,
        *shapes,
        "</scene>",
    ]
    return "\n".join(lines) + "\n"


def _sensor(plan: Plan, furniture: Sequence[Thing]) -> str:
    """A look across the largest room, for the plain `mitsuba` command and for previews."""
    room = max(plan.rooms, key=lambda candidate: candidate.shape.area)
    middle = room.shape.representative_point()
    boxes = [thing.bounds for thing in furniture if thing.room == room.id]
    corners = sorted(
        (edge.at(0.0) for edge in room.edges),
        key=lambda point: -math.dist(point, (middle.x, middle.y)),
    )
    x, y, ahead = middle.x, middle.y, np.array([1.0, 0.0])
    for inwards, corner in product((0.7, 1.0, 1.4), corners):
        towards = np.array([middle.x - corner[0], middle.y - corner[1]])
        towards /= np.linalg.norm(towards)
        spot = np.array([*(np.array(corner) + inwards * towards), EYE])
        if not any(_near(spot, box) for box in boxes):
            (x, y, _), ahead = spot, towards
            break
    return (
        '<sensor type="perspective" id="sensor"><string name="fov_axis" value="x"/>'
        f'<float name="fov" value="{math.degrees(2 * HALF_FOV):.6g}"/>'
        '<float name="near_clip" value="0.01"/><float name="far_clip" value="1000"/>'
        f'<transform name="to_world"><lookat origin="{x:.4f}, {y:.4f}, {EYE}" '
        f'target="{x + ahead[0]:.4f}, {y + ahead[1]:.4f}, {EYE - 0.2}" up="0, 0, 1"/></transform>'
        '<sampler type="multijitter"><integer name="sample_count" value="64"/></sampler>'
        '<film type="hdrfilm"><integer name="width" value="480"/>'
        '<integer name="height" value="360"/><string name="pixel_format" value="rgb"/>'
        '<rfilter type="box"/></film></sensor>'
    )
