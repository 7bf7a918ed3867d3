"""Parts of the light in a joint trace's colour: direct light, and what is reflected diffusely.

Each is a sum over some of the contributions that make colour, times a share in [0, 1], so it has
the same samples, roulette and emitter sampling, and is unbiased as colour is:

* direct: light that was scattered at most once between emitter and camera. Mirror images, those in
  window panes too, and what clear glass lets through count as what they show; light that a mirror
  throws onto a surface is indirect.
* diffuse: light that the first visible surface reflected by a diffuse lobe. That surface is the one
  of the inputs: behind clear glass, but not in a mirror. Each contribution counts with the share
  of the diffuse lobes in the BSDF's value.
* irradiance: the same light over the reflectance of that surface, band by band: the radiance that
  a white diffuse surface would have there. 0 where the reflectance is 0.

* light groups: light from each of the emitters' groups, if they are asked for. They add up to
  colour.

The rest of colour (indirect, specular, residual) is what these leave.

The first light group is the sky, or any other environment without its sun, the second the sun.
Then come the lamps of `scene.json`, those of the camera's room first, and at last all other
emitters together. The sun's group holds all light from its disc, the sky's before it included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.irradiance import SunDisc, environment_of
from pbrnet.pipeline.pathtrace.portals import opaque_floats
from pbrnet.pipeline.pathtrace.scattering import Scattering, diffuse_lobes, share
from pbrnet.pipeline.render.drjit_arrays import column, partner, partner_table
from pbrnet.pipeline.render.material_sets import Lobes
from pbrnet.scenes.contract import Light

_BLACK = 1e-4  # reflectance below which irradiance is not determined
SKY, SUN, OTHERS = "sky", "sun", "others"
FIXED = 3  # groups beside those of single lamps


@dataclass
class NoParts:
    """Nothing beside colour: costs nothing. Both the choice of parts and the state of a path."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the images."""
        return ()

    def start(self) -> NoParts:
        """Return the state of a path at the camera."""
        return self

    def begin(self, mirrored: mi.Bool, where: mi.Bool) -> None:
        """Begin other paths in some lanes."""

    def add_emission(self, *contribution: object) -> None:
        """Add emission that BSDF sampling found."""

    def add_emitter_sample(self, *vertex: object) -> None:
        """Add an emitter sample, and go on to the next vertex."""

    def images(self) -> tuple[mi.Color3f, ...]:
        """Return the images, `mi.Color3f` each."""
        return ()


@dataclass(init=False, eq=False)
class LightParts:
    """Direct, diffuse and irradiance of a scene with these `RenderScene.lobes`, light groups."""

    lobes: mi.BSDFPtr  # table of each BSDF's diffuse lobe
    reflectances: mi.BSDFPtr  # table of each BSDF's reflectance twin
    groups: GroupTable | None

    def __init__(self, lobes: Lobes, groups: LightGroups | None = None) -> None:
        self.groups = None if groups is None else GroupTable(groups)
        self.lobes = partner_table([(own, lobe) for own, lobe, _ in lobes])
        self.reflectances = partner_table([(own, reflectance) for own, _, reflectance in lobes])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the images."""
        return ("direct", "diffuse", "irradiance", *group_names(self._count))

    @property
    def _count(self) -> int:
        return 0 if self.groups is None else self.groups.count

    def start(self) -> PathParts:
        """Return the state of a path at the camera."""
        return PathParts(
            direct=mi.Color3f(0),
            diffuse=mi.Color3f(0),
            irradiance=mi.Color3f(0),
            share=mi.Color3f(0),
            white=mi.Color3f(0),
            before=mi.Bool(True),
            scattered=mi.UInt32(0),
            lights=[mi.Color3f(0) for _ in range(self._count)],
        )

    def shares(
        self,
        own: mi.BSDFPtr,
        si: mi.SurfaceInteraction3f,
        light: mi.Vector3f,
        of_colour: Scattering,
        active: mi.Bool,
    ) -> tuple[mi.Color3f, mi.Color3f, mi.Color3f]:
        """Return shares of the diffuse lobes in the BSDF, `mi.Color3f` each, and the reflectance.

        First towards the emitter sample in world direction `light`, then along the sampled
        direction.
        """
        context, diffuse = mi.BSDFContext(), diffuse_lobes()
        lobe = partner(self.lobes, own, active)
        towards = lobe.eval(diffuse, si, si.to_local(light), active)
        along = lobe.eval(diffuse, si, of_colour.sample.wo, active)
        whole = own.eval(context, si, of_colour.sample.wo, active)
        delta = mi.has_flag(of_colour.sample.sampled_type, mi.BSDFFlags.Delta)
        twin = partner(self.reflectances, own, active)
        reflectance = dr.clip(twin.eval_diffuse_reflectance(si, active), 0, 1)
        return (
            share(towards, of_colour.value),
            dr.select(delta, 0, share(along, whole)),
            reflectance,
        )


@dataclass
class PathParts:
    """State of a path: the parts so far, and how its further contributions count."""

    direct: mi.Color3f
    diffuse: mi.Color3f
    irradiance: mi.Color3f
    share: mi.Color3f  # of contributions to colour in `diffuse`; 0 before the first surface
    white: mi.Color3f  # of contributions to colour in `irradiance`
    before: mi.Bool  # True up to the first visible surface
    scattered: mi.UInt32  # how often the path was scattered, for `direct`
    lights: list[mi.Color3f]  # of each light group

    def begin(self, mirrored: mi.Bool, where: mi.Bool) -> None:
        """Begin other paths in some lanes.

        Those that are `mirrored`, mirror images in a window pane, have no light of the first
        surface.
        """
        for name in ("direct", "diffuse", "irradiance", "share", "white"):
            setattr(self, name, dr.select(where, 0, getattr(self, name)))
        self.lights = [dr.select(where, 0, light) for light in self.lights]
        self.before = dr.select(where, ~mirrored, self.before)
        self.scattered = dr.select(where, mi.UInt32(0), self.scattered)

    def add_emission(
        self, parts: Any, ds: mi.DirectionSample3f, throughput: mi.Color3f, arriving: mi.Color3f
    ) -> None:
        """Add emission that BSDF sampling found: `arriving` is radiance times MIS weight.

        `parts` are the path tracer's `LightParts`, `ds` is the `mi.DirectionSample3f`.
        Products are formed anew, not shared with those of colour, so that its rounding stays.
        """
        self.direct += dr.select(self.scattered <= 1, throughput, 0) * arriving
        self.diffuse += self.share * throughput * arriving
        self.irradiance += self.white * throughput * arriving
        self.add_to_group(parts, ds, throughput, arriving)

    def add_emitter_sample(
        self,
        parts: Any,
        own: mi.BSDFPtr,
        si: mi.SurfaceInteraction3f,
        ds: mi.DirectionSample3f,
        of_colour: Scattering,
        throughput: mi.Color3f,
        arriving: mi.Color3f,
        active: mi.Bool,
    ) -> None:
        """Add an emitter sample, and go on to the next vertex.

        `of_colour` is the scattering by the BSDF `own`, `arriving` the sample's radiance over
        density, times BSDF, cosine and MIS weight.
        """
        kind = of_colour.sample.sampled_type
        through = mi.has_flag(kind, mi.BSDFFlags.DeltaTransmission)
        through |= mi.has_flag(kind, mi.BSDFFlags.Null)
        mirrored = mi.has_flag(kind, mi.BSDFFlags.DeltaReflection)

        first = active & self.before
        towards, along, reflectance = parts.shares(own, si, ds.d, of_colour, first)
        bright = reflectance > _BLACK
        white = dr.select(bright, dr.rcp(reflectance), 0)
        self.direct += dr.select(self.scattered == 0, throughput, 0) * arriving
        self.diffuse += dr.select(first, towards, self.share) * throughput * arriving
        self.irradiance += dr.select(first, towards * white, self.white) * throughput * arriving
        self.add_to_group(parts, ds, throughput, arriving)

        surface = first & ~through
        self.share = dr.select(surface, along, self.share)
        self.white = dr.select(surface, along * white, self.white)
        self.before &= through
        same = through | (mirrored & (self.scattered == 0))
        self.scattered += dr.select(same, mi.UInt32(0), mi.UInt32(1))

    def add_to_group(
        self, parts: Any, ds: mi.DirectionSample3f, throughput: mi.Color3f, arriving: mi.Color3f
    ) -> None:
        """Add a contribution to the group of its light."""
        if parts.groups is not None:
            group = parts.groups.group(ds)
            self.lights = [
                light + dr.select(group == number, throughput, 0) * arriving
                for number, light in enumerate(self.lights)
            ]

    def images(self) -> tuple[mi.Color3f, ...]:
        """Return the images, `mi.Color3f` each."""
        return self.direct, self.diffuse, self.irradiance, *self.lights


def group_names(count: int) -> tuple[str, ...]:
    """Return the names of the images of this number of light groups."""
    return tuple(f"light{number:02d}" for number in range(count))


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
