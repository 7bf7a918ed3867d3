"""Light of an import's rooms: emitted lumens per square metre of floor, and whether to add a sky.

Screens, glowing windows, pictures and LED strips shine without lighting a room. So the decision is
photometric: only emitters that can light a room count, and only a room that they give at least
`LEAST_LIT` lumens per square metre of floor has light of its own. (EN 12464-1 asks for 100 lux in
corridors; of 30 lumens per square metre, about half arrives.)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import REC709
from pbrnet.scenes.contract import Room, Scene, SceneObject
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.light.daylight import daylight
from pbrnet.scenes.importing.materials.textures import read_radiance
from pbrnet.scenes.importing.options import FreeAxesOptions
from pbrnet.scenes.importing.shape import Emitter, Shape
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.rooms import FoundRoom

LEAST_LIT = 30.0  # lumens per square metre of floor
OUTDOORS = ("sun", "sky", "environment", "directional")  # kinds of light that come from outside
_FROM_ALL_SIDES = ("sun", "sky", "environment")
_MARGIN = 0.15  # metres outside a room's outline or height at which a lamp still belongs to it
_DISPLAYS = ("television", "monitor", "picture", "window")
_UPRIGHT = 0.5  # cosine to the horizontal: an emitter with an image that faces sideways is a screen


@dataclass(frozen=True)
class RoomLight:
    """Lumens per square metre of a room's floor, from lamps and from what merely glows."""

    lamps: float
    glow: float

    @property
    def is_lit(self) -> bool:
        """True if the room has light of its own."""
        return self.lamps >= LEAST_LIT

    @property
    def is_dark(self) -> bool:
        """True if the room is too dark to be seen by its own light."""
        return self.lamps + self.glow < LEAST_LIT


@dataclass(frozen=True)
class LightPlan:
    """The light of a scene: of each closed room, and of all its lamps together in lumens."""

    rooms: tuple[RoomLight, ...]
    lamps: float
    glow: float
    from_outdoors: bool  # from all sides; a directional light may miss every window
    has_directional: bool = False

    @property
    def needs_sky(self) -> bool:
        """True if no light comes from outdoors and no room has its own.

        Without closed rooms, any lamp is light enough.
        """
        if self.from_outdoors:
            return False
        return not any(room.is_lit for room in self.rooms) if self.rooms else self.lamps == 0


def light_plan(
    folder: Path,
    shapes: list[Shape],
    area: Mapping[str, Element],
    emitters: list[Emitter],
    objects: tuple[SceneObject, ...],
    rooms: list[FoundRoom],
) -> LightPlan:
    """The light of a scene and of each closed one of its `rooms`.

    `area` holds area emitters by shape id, whose images lie in the scene's `folder`. An emitter in
    no room counts for the scene only.
    """
    categories = {name: each.category for each in objects for name in each.shapes}
    rooms = [room for room in rooms if not room.guessed]
    # The last entry holds what belongs to no room.
    lamps, glow = np.zeros(len(rooms) + 1), np.zeros(len(rooms) + 1)
    for shape in shapes:
        if shape.id not in area:
            continue
        centre = shape.mesh.bounds.mean(axis=0)
        is_display = categories.get(shape.id) in _DISPLAYS or _is_screen(shape, area[shape.id])
        flux = _area_lumens(shape, area[shape.id], folder)
        (glow if is_display else lamps)[_number_of_room(centre, rooms)] += flux
    for emitter in emitters:
        if emitter.position is not None:
            number = _number_of_room(np.array(emitter.position), rooms)
            lamps[number] += _point_lumens(emitter.element)
    floors = [max(room.floor.area, 1e-6) for room in rooms]
    by_room = zip(lamps[:-1] / floors, glow[:-1] / floors, strict=True)
    return LightPlan(
        tuple(RoomLight(float(own), float(display)) for own, display in by_room),
        float(lamps.sum()),
        float(glow.sum()),
        any(kind in _FROM_ALL_SIDES for emitter in emitters for kind in emitter.kinds),
        any(kind == "directional" for emitter in emitters for kind in emitter.kinds),
    )


def _number_of_room(point: Float64Array, rooms: list[FoundRoom]) -> int:
    """Number of the room that contains a point (3,); -1 if none does."""
    return next((k for k, room in enumerate(rooms) if room.contains(point, _MARGIN)), -1)


def sky_for(
    path: Path,
    has_area_lights: bool,
    emitters: list[Emitter],
    options: FreeAxesOptions,
    changes: Changes,
) -> list[Emitter]:
    """Sun and sky for the scene at `path` if it has no light or `--sky` asks for them.

    For scenes whose units of light are arbitrary, so that the power of lamps says nothing. Nothing
    is added if something shines outdoors. Raises `InputError` for a scene without any light if
    the options, `--lamps home`, leave it dark.
    """
    if not (has_area_lights or emitters):
        if options.sky or options.lamps == "auto":
            changes.note("the scene has no light; sun and sky were added")
            return [daylight()]
        if options.lamps == "fill":
            return []
        raise InputError(
            f"{path}: the scene has no light; add sun and sky with --sky, or lamps with "
            "--lamps fill"
        )
    if not options.sky or any(kind in OUTDOORS for made in emitters for kind in made.kinds):
        return []
    changes.note("sun and sky were added to the scene's lamps")
    return [daylight()]


def note_sky(plan: LightPlan, changes: Changes) -> None:
    """Record that sun and sky were added, and why."""
    if plan.lamps == plan.glow == 0 and not plan.has_directional:
        changes.note("the file has no light; sun, sky and a ground plane were added")
        return
    brightest = max((room.lamps for room in plan.rooms), default=0.0)
    parts = []
    if plan.lamps > 0:
        parts.append(f"lamps give no room more than {brightest:.2g} lm per square metre of floor")
    if plan.glow > 0:
        parts.append(f"screens and other displays ({plan.glow:.2g} lm) light no room")
    if plan.has_directional:
        parts.append("directional lights alone may miss every window")
    changes.note(
        f"sun, sky and a ground plane were added: {', and '.join(parts)}; a lit room has "
        f"{LEAST_LIT:g} or more"
    )


def note_filled(rooms: Iterable[Room], changes: Changes) -> None:
    """Record the rooms that got ceiling lamps."""
    for room in rooms:
        changes.note("rooms without light got plain ceiling lamps: {}", f"{room.id} ({room.name})")


def note_without_light(rooms: Iterable[Room], changes: Changes) -> None:
    """Record the rooms that no light reaches, with the remedy."""
    for room in rooms:
        changes.note(
            "rooms without enough light from lamps, windows and open doors get no views; "
            "--lamps fill hangs lamps there: {}",
            f"{room.id} ({room.name})",
        )


def note_dark_rooms(scene: Scene, changes: Changes) -> None:
    """Record the rooms that no light reaches, and those where light may be missing outdoors."""
    with_lamp = {light.room for light in scene.lights if light.kind not in OUTDOORS}
    with_portal = {portal.room for portal in scene.portals}
    note_without_light([room for room in scene.rooms if not room.has_light], changes)
    if None in with_lamp or any(light.kind in OUTDOORS for light in scene.lights):
        return
    for room in scene.rooms:
        if room.has_light and room.id in with_portal - with_lamp:
            changes.note(
                "rooms without a lamp may be black, because nothing shines outdoors; add sun and "
                "sky with --sky, or lamps with --lamps fill: {}",
                f"{room.id} ({room.name})",
            )


def _area_lumens(shape: Shape, emitter: Element, folder: Path) -> float:
    """Luminous flux of a Lambertian emitter, one side of its surface."""
    radiance = emitter.find("*[@name='radiance']")
    if radiance is None:
        return 0.0
    area = float(face_areas(shape.mesh.corners)[0].sum())
    return math.pi * area * _luminance(radiance, folder) / LUMEN


def _luminance(value: Element, folder: Path) -> float:
    """Luminance, in our radiance units, of a colour or the mean of an image; 0 if unknown."""
    image = value.find("string[@name='filename']")
    if image is not None:
        pixels = read_radiance(folder / image.attrib["value"])
        return float(pixels.reshape(-1, 3).mean(axis=0, dtype=np.float64) @ REC709)
    try:
        rgb = [float(part) for part in value.attrib.get("value", "").replace(",", " ").split()]
    except ValueError:
        return 0.0
    if len(rgb) not in (1, 3):
        return 0.0
    return float(np.broadcast_to(rgb, 3) @ REC709)


def _point_lumens(emitter: Element) -> float:
    """Luminous flux of a point or spot light from its radiant intensity."""
    intensity = emitter.find("*[@name='intensity']")
    if intensity is None:
        return 0.0
    solid_angle = 4 * math.pi
    cutoff = emitter.find("float[@name='cutoff_angle']")
    if cutoff is not None:
        solid_angle = 2 * math.pi * (1 - math.cos(math.radians(float(cutoff.attrib["value"]))))
    return solid_angle * _luminance(intensity, Path()) / LUMEN


def _is_screen(shape: Shape, emitter: Element) -> bool:
    """Return whether an emitter shows an image and faces sideways."""
    if emitter.find("*[@name='radiance']/string[@name='filename']") is None:
        return False
    areas, normals = face_areas(shape.mesh.corners)
    level = float((areas * (np.abs(normals[:, 2]) < _UPRIGHT)).sum())
    return level > 0.5 * float(areas.sum())
