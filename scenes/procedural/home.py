"""Procedural homes: plan, building, furniture, outdoors and lighting from one seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Point, Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import (
    Credit,
    Light,
    Room,
    Scene,
    SceneObject,
    save_scene,
    writing_scene,
)
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.looks import HomeSettings
from pbrnet.scenes.procedural.design import Design, design_home
from pbrnet.scenes.procedural.finishes import Finishes, make_finishes
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.lighting import (
    PBRS_LAMP,
    LampState,
    Sky,
    area_emitter,
    choose_lit_lamps,
    draw_kelvin_offset,
    draw_lamp_states,
    draw_screen_states,
    draw_sky,
    in_state,
    lamp_descriptions,
    lamp_items,
    mean_radiance,
    sampling_weight,
)
from pbrnet.scenes.procedural.materials import MaterialLibrary
from pbrnet.scenes.procedural.outdoors import build_outdoors
from pbrnet.scenes.procedural.piece import CatalogueCredit, PiecePart
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.structure import build_structure
from pbrnet.scenes.procedural.surroundings.clouds import clouds
from pbrnet.scenes.procedural.use.home import leave_traces
from pbrnet.scenes.seeds import Draw

EYE_HEIGHT = 1.55  # metres; of the sensor in scene.xml
HALF_FOV = 0.5534  # radians, horizontal
_OUTSIDE_WEIGHT = 0.03  # of sampling weights of street lamps and other homes' windows
_NEW = 0.1  # wear of homes that show no traces of use
_CLOUDY = 0.6  # share of the homes in the sun that have clouds
_SENSOR_MARGIN = 0.25  # metres between the sensor and the bounds of furniture


@dataclass(frozen=True)
class Origin:
    """Record in `scene.json` of where a home came from."""

    source: Mapping[str, Any]  # the first keys of the scene's source
    plan: str
    credits: tuple[Credit, ...] = ()  # beside those of what is generated
    changes: tuple[str, ...] = ()


def make_home(folder: Path, scene_id: str, home: HomeSettings, assets: Path | None = None) -> Scene:
    """Write a procedural home as the scene folder `folder` and return its `Scene`.

    Equal arguments give equal bytes. Homes that differ only in `lighting` have the same plan and
    furniture. With `outdoors` "none" and in PBRS' light, nothing is outside. A variant keeps the
    plan and redraws the aspects in `varied`: finishes (materials and colours), furniture (pieces
    and positions), light (hour, weather, lamps), outdoors. `assets` is the folder of converted
    catalogues, used if `share` is above 0.
    """
    variant, *varied = home.varied or (0,)
    source = {"kind": "procedural", "seed": str(home.seed), "variant": variant, "varied": varied}
    origin = Origin(source, f"home-{home.seed:016x}")
    return write_home(folder, scene_id, design_home(home, assets), origin, home)


def write_home(
    folder: Path, scene_id: str, design: Design, origin: Origin, home: HomeSettings
) -> Scene:
    """Build, finish and light a designed home, and write it as the scene folder `folder`."""
    plan, style = design.plan, design.style
    kinds = {room.id: str(room.type) for room in plan.rooms}
    finishes = make_finishes(home.draw("finishes", "finishes"), style, kinds)
    building, portals = build_structure(plan, finishes)
    furniture = [item for each in design.furniture for item in each.scene_items()]
    outdoors: list[SceneItem] = []
    if home.outdoors != "none" and home.lighting != "pbrs":
        outdoors = build_outdoors(home.draw("outdoors", "outdoors"), plan)
    looks = home.draw("finishes", "textures")
    texture_seed, wear = looks.whole(1 << 62), looks.random()
    used = [*building, *furniture]
    if wear > _NEW:
        used = leave_traces(used, plan, texture_seed)
    light = _draw_light(home, plan, furniture, outdoors)
    items = [*used, *outdoors, *light.clouds]
    with writing_scene(Path(folder)) as partial:
        library = MaterialLibrary(partial, home.texture_size, seed=texture_seed, wear=wear)
        objects, lights, shapes = _write_shapes(partial, items, light.states, library)
        scene = Scene(
            scene_id=scene_id,
            source={**origin.source, **_drawn_looks(style, finishes, plan, light)},
            rooms=_rooms(plan, furniture),
            objects=tuple(objects),
            lights=(*lights, *light.sky.lights),
            portals=tuple(portals),
            credits=(*_credits(furniture), *origin.credits),
            lighting=home.lighting,
            plan=origin.plan,
            joints=tuple(joint for item in items for joint in item.joints),
            changes=origin.changes,
        )
        standing = [*furniture, *(item for item in building if item.category == "stairs")]
        text = _scene_xml(plan, standing, library, shapes, light.sky)
        (partial / "scene.xml").write_text(text, encoding="utf-8")
        save_scene(partial, scene)
    object.__setattr__(scene, "folder", Path(folder))
    return scene


@dataclass(frozen=True)
class _HomeLight:
    """Sky, clouds and the states of all lamps of a home."""

    sky: Sky
    clouds: list[SceneItem]
    states: dict[str, LampState]  # by item; lamps without one are off
    kelvin_offset: float


def _draw_light(
    home: HomeSettings,
    plan: Plan,
    furniture: Sequence[SceneItem],
    outdoors: Sequence[SceneItem],
) -> _HomeLight:
    """Draw the light of a home for a setting."""
    lighting = home.lighting
    if lighting == "pbrs":
        return _pbrs_light(home, furniture)

    def draw(name: str) -> Draw:
        return home.draw("light", name, lighting)

    windowless = [room.id for room in plan.rooms if room.id not in plan.with_window]
    lamps = lamp_descriptions(furniture)
    lit = choose_lit_lamps(draw("lamps"), lighting, lamps, windowless)
    parts = [part for item in lamp_items(furniture) if item.id in lit for part in item.parts]
    weight = sum(sampling_weight(part) for part in parts if part.lumens > 0)
    kelvin_offset = draw_kelvin_offset(draw("lamp colour"))
    sky = draw_sky(draw("sky"), lighting, weight)
    states = draw_lamp_states(draw("lamp states"), lit, kelvin_offset)
    states |= draw_screen_states(draw("screens"), lighting, furniture)
    if sky.is_dark:
        states |= {item.id: LampState(1.0, 0.0) for item in lamp_items(outdoors)}
    return _HomeLight(sky, _clouds(draw("clouds"), plan, sky), states, kelvin_offset)


def _pbrs_light(home: HomeSettings, furniture: Sequence[SceneItem]) -> _HomeLight:
    """A white sky and every lamp, as PBRS lit its houses; the same for all variants."""
    lamps = lamp_items(furniture)
    parts = [in_state(part, PBRS_LAMP) for lamp in lamps for part in lamp.parts if part.lumens > 0]
    sky = draw_sky(home.draw("light", "sky"), "pbrs", sum(map(sampling_weight, parts)))
    return _HomeLight(sky, [], {lamp.id: PBRS_LAMP for lamp in lamps}, 0.0)


def _drawn_looks(style: Style, finishes: Finishes, plan: Plan, light: _HomeLight) -> dict[str, Any]:
    """Style, finishes, shape and light of a home, as `scene.json` records them."""
    return {
        "style": style.name,
        "finishes": {
            room: {"floor": finish.floor.kind, "walls": finish.wall.kind}
            for room, finish in sorted(finishes.rooms.items())
        },
        **_shape_of(plan),
        "light": {
            **light.sky.choices,
            "clouds": len(light.clouds),
            "lamps_cooler": light.kelvin_offset,
        },
    }


def _shape_of(plan: Plan) -> dict[str, list]:
    """Sloping ceilings and niches, as `scene.json` records them."""
    found: dict[str, list] = {}
    if plan.slopes:
        found["slopes"] = [
            {"from": [*each.edge.start], "to": [*each.edge.end], "knee": each.knee, "run": each.run}
            for each in plan.slopes
        ]
    if plan.niches:
        found["niches"] = [niche.room for niche in plan.niches]
    return found


def _clouds(rng: Draw, plan: Plan, sky: Sky) -> list[SceneItem]:
    """Clouds beside the sun, in `_CLOUDY` of the homes that it shines on."""
    if not rng.chance(_CLOUDY) or sky.sun is None:
        return []
    centre = np.array(Polygon(plan.outline).centroid.coords[0])
    made = clouds(rng, centre, np.array(sky.sun), plan.ground)
    return [] if made is None else [made]


def _rooms(plan: Plan, furniture: Sequence[SceneItem]) -> tuple[Room, ...]:
    lamps = {lamp.room for lamp in lamp_items(furniture)}
    lit = lamps | plan.with_window | {room for one in plan.openings for room in one.rooms}
    names: dict[str, int] = {}
    rooms = []
    for room in plan.rooms:
        names[room.type] = names.get(room.type, 0) + 1
        number = names[room.type]
        rooms.append(
            Room(
                id=room.id,
                name=room.name or (room.type if number == 1 else f"{room.type} {number}"),
                type="other" if room.type == "hall" else room.type,
                floor=room.polygon,
                floor_z=0.0,
                ceiling_z=plan.height if room.height is None else room.height,
                has_light=room.id in lit,
            )
        )
    return tuple(rooms)


def _write_shapes(
    folder: Path,
    items: Sequence[SceneItem],
    states: Mapping[str, LampState],
    library: MaterialLibrary,
) -> tuple[list[SceneObject], list[Light], list[str]]:
    """Write the meshes; returns the objects, the lit lamps and the `<shape>` elements."""
    objects, lights, shapes = [], [], []
    for item in items:
        ids: list[str] = []
        emitting: list[str] = []
        lumens = 0.0
        state = states.get(item.id)
        for part in _merge_by_material(item.parts, state):
            shape = f"{item.id}.{len(ids)}"
            ids.append(shape)
            write_ply(folder / "meshes" / f"{shape}.ply", _mesh(part, library))
            light = ""
            if part.lumens > 0:
                emitting.append(shape)
                lumens += part.lumens
                image = ""
                if part.picture is not None:
                    image = library.display(part.picture, mean_radiance(part))
                light = area_emitter(part, _OUTSIDE_WEIGHT if item.room is None else 1.0, image)
            flat = "" if part.smooth else '<boolean name="face_normals" value="true"/>'
            shapes.append(
                f'<shape type="ply" id="{shape}"><string name="filename" '
                f'value="meshes/{shape}.ply"/>{flat}<ref id="{library.bsdf(part.material)}"/>'
                f"{light}</shape>"
            )
        low, high = np.round(item.bounds, 4).tolist()
        objects.append(
            SceneObject(
                id=item.id,
                name=item.name,
                category=item.category,
                shapes=tuple(ids),
                bbox_min=(low[0], low[1], low[2]),
                bbox_max=(high[0], high[1], high[2]),
                is_structure=item.is_structure,
                room=item.room,
            )
        )
        if emitting:
            lights.append(Light(item.id, "area", tuple(emitting), item.room, round(lumens, 1)))
    return objects, lights, shapes


def _mesh(part: PiecePart, library: MaterialLibrary) -> Mesh:
    """The mesh of a part; its uvs change from metres to periods of the material's texture."""
    if part.lumens > 0 and part.picture is not None:  # over the whole of its radiance's image
        return Mesh(part.vertices, part.faces, None, part.uvs)
    # Faceted parts have no normals; their `<shape>` sets `face_normals`.
    normals = part.normals if part.smooth else None
    uvs = library.placed(part.material, part.vertices, part.faces, normals, part.uvs)
    return Mesh(part.vertices, part.faces, normals, uvs)


def _merge_by_material(parts: Sequence[PiecePart], state: LampState | None) -> list[PiecePart]:
    """Merge parts of the same material into one mesh; without a state they emit nothing."""
    groups: dict[tuple, list[PiecePart]] = {}
    for part in parts:
        part = in_state(part, state)
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
                given_normals=_concatenate([part.given_normals for part in group]),
                lumens=sum(part.lumens for part in group),
            )
        )
    return merged


def _concatenate(arrays: Sequence[Float64Array | None]) -> Float64Array | None:
    """Concatenate the arrays; None if any of them is None."""
    present = [array for array in arrays if array is not None]
    return np.concatenate(present) if len(present) == len(arrays) else None


def _credits(items: Sequence[SceneItem]) -> tuple[Credit, ...]:
    """Credit of the generator, then one per author, licence and library of catalogue pieces."""
    names: dict[CatalogueCredit, set[str]] = {}
    for item in items:
        if item.credit is not None:
            names.setdefault(item.credit, set()).add(item.name)
    own = "everything else" if names else "everything"
    made = [Credit(own, "procedural home", "pbrnet", "CC0-1.0", "generated")]
    for credit in sorted(names, key=lambda each: (each.library, each.author, each.licence)):
        part = ", ".join(sorted(names[credit]))
        title = f"furniture of the catalogue {credit.library}"
        made.append(Credit(part, title, credit.author, credit.licence, credit.source))
    return tuple(made)


def _is_near(point: Float64Array, box: Float64Array) -> bool:
    """Return True if a point is inside a box (2, 3) or within the sensor margin of it."""
    return bool((point > box[0] - _SENSOR_MARGIN).all() and (point < box[1] + _SENSOR_MARGIN).all())


def _scene_xml(
    plan: Plan, standing: Sequence[SceneItem], library: MaterialLibrary, shapes: list[str], sky: Sky
) -> str:
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<scene version="3.0.0">',
        '<integrator type="path"><integer name="max_depth" value="11"/></integrator>',
        _sensor(plan, standing),
        sky.xml,
        *library.xml,
        *shapes,
        "</scene>",
    ]
    return "\n".join(lines) + "\n"


def _sensor(plan: Plan, standing: Sequence[SceneItem]) -> str:
    """Sensor with a view across the largest room, free of what stands there, for `mitsuba`."""
    room = max(plan.rooms, key=lambda candidate: candidate.shape.area)
    middle = room.shape.representative_point()
    boxes = [item.bounds for item in standing if item.room == room.id]
    corners = sorted(
        (edge.at(0.0) for edge in room.edges),
        key=lambda point: -math.dist(point, (middle.x, middle.y)),
    )
    x, y, ahead = middle.x, middle.y, np.array([1.0, 0.0])
    for inwards, corner in product((0.7, 1.0, 1.4), corners):
        towards = np.array([middle.x - corner[0], middle.y - corner[1]])
        towards /= np.linalg.norm(towards)
        position = np.array([*(np.array(corner) + inwards * towards), EYE_HEIGHT])
        around = buffered(Point(*position[:2]), _SENSOR_MARGIN)
        if plan.free_height(around) > EYE_HEIGHT + _SENSOR_MARGIN and not any(
            _is_near(position, box) for box in boxes
        ):
            (x, y, _), ahead = position, towards
            break
    return (
        '<sensor type="perspective" id="sensor"><string name="fov_axis" value="x"/>'
        f'<float name="fov" value="{math.degrees(2 * HALF_FOV):.6g}"/>'
        '<float name="near_clip" value="0.01"/><float name="far_clip" value="1000"/>'
        f'<transform name="to_world"><lookat origin="{x:.4f}, {y:.4f}, {EYE_HEIGHT}" '
        f'target="{x + ahead[0]:.4f}, {y + ahead[1]:.4f}, {EYE_HEIGHT - 0.2}" up="0, 0, 1"/>'
        "</transform>"
        '<sampler type="multijitter"><integer name="sample_count" value="64"/></sampler>'
        '<film type="hdrfilm"><integer name="width" value="480"/>'
        '<integer name="height" value="360"/><string name="pixel_format" value="rgb"/>'
        '<rfilter type="box"/></film></sensor>'
    )
