"""Light groups: the lights of a scene, each with an image of its own or pooled with others.

The first group is the sky, or any other environment without its sun, the second the sun. Then come
the lamps of `scene.json`, those of the camera's room first, and at last all other emitters
together. The sun's group holds all light from its disc, the sky's before it included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.irradiance import SunDisc, environment_of
from pbrnet.pipeline.pathtrace.portals import opaque_floats
from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.scenes.contract import Light

SKY, SUN, OTHERS = "sky", "sun", "others"
FIXED = 3  # groups beside those of single lamps


@dataclass(frozen=True)
class LightGroups:
    """Groups of a view: their names, "" for one without lights, and each emitter's group.

    `members` holds (emitter, index of its group) for all emitters but the environment.
    """

    names: tuple[str, ...]
    members: tuple[tuple[mi.Emitter, int], ...]
    sun: SunDisc | None = None


def group_lights(
    scene: mi.Scene,
    shapes: Sequence[mi.Shape],
    lights: Sequence[Light],
    room: str | None,
    most: int,
) -> LightGroups:
    """Return the groups of a view in `room`: `most` lamps, and `FIXED` more.

    `scene` is the Mitsuba scene, `shapes` are its shapes, `lights` those of `scene.json`.
    """
    lamps = [light for light in lights if light.kind not in ("sky", "sun", "environment")]
    lamps.sort(key=lambda light: light.room != room)  # stable: else in the scene's order
    chosen = lamps[:most]
    group_of = {light.id: 2 + number for number, light in enumerate(chosen)}
    of_shape = {shape: group_of[light.id] for light in chosen for shape in light.shapes}
    others = most + FIXED - 1
    members = [
        (shape.emitter(), of_shape.get(shape.id(), others))
        for shape in shapes
        if shape.is_emitter()
    ]
    members += [
        (emitter, group_of.get(emitter.id(), others))
        for emitter in scene.emitters()
        if not emitter.is_environment()
        and not mi.has_flag(emitter.flags(), mi.EmitterFlags.Surface)
    ]
    environment = environment_of(scene)
    sun = environment.sun if environment is not None else None
    names = [""] * (most + FIXED)
    names[0] = SKY if environment is not None else ""
    names[1] = SUN if sun is not None else ""
    names[2 : 2 + len(chosen)] = [light.id for light in chosen]
    names[others] = OTHERS if any(group == others for _, group in members) else ""
    return LightGroups(tuple(names), tuple(members), sun)


@dataclass(init=False, eq=False)
class GroupTable:
    """Group of the light that a direction sample points to, for the path tracer."""

    count: int
    group_of: mi.UInt32  #  by an emitter's registry id
    sun: list[mi.Float] = field(default_factory=list)  # direction, cosine of the radius

    def __init__(self, groups: LightGroups) -> None:
        self.count = len(groups.names)
        registry = np.zeros(0, dtype=np.int64)
        if groups.members:
            emitters = mi.EmitterPtr([emitter for emitter, _ in groups.members])
            registry = np.array(dr.reinterpret_array(mi.UInt32, emitters), dtype=np.int64)
        # The environment, which has no shape, is in the sky's group as is all that is not listed.
        table = np.zeros(registry.max(initial=0) + 1, dtype=np.uint32)
        table[registry] = [group for _, group in groups.members]
        self.group_of = column(mi.UInt32, table)
        # Without a sun no direction is within its disc.
        direction, cosine = (np.array([0.0, 0.0, 1.0]), 2.0)
        if groups.sun is not None:
            direction, cosine = groups.sun.direction, groups.sun.cosine
        self.sun = opaque_floats(np.array([*direction, cosine]))

    def group(self, ds: mi.DirectionSample3f) -> mi.UInt32:
        """Return the index of the group of `mi.DirectionSample3f`, `mi.UInt32`."""
        number = dr.reinterpret_array(mi.UInt32, ds.emitter)
        group = dr.gather(mi.UInt32, self.group_of, number, number < dr.width(self.group_of))
        x, y, z, cosine = self.sun
        sunny = dr.dot(ds.d, mi.Vector3f(x, y, z)) > cosine
        return dr.select((group == 0) & sunny, mi.UInt32(1), group)
