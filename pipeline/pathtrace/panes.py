"""Window panes that reflect for the camera and let all other light pass straight.

A pane of glass would stop shadow rays, so clear panes are portals and no shapes: light enters a
room as if they were open. What the camera sees in them counts, however: a part R of the room and
1 - R of the outdoors, by day mostly the outdoors, at night the room. So a camera ray that meets a
pane before any surface is reflected or passes with probability 1/2 each, weighted with 2 R or
2 (1 - R). The weights sum to 1 in expectation: no energy is created. Colour and neutral twin get
the same ray and weight, because glass has no colour.

Left out: panes behind the first one, panes in mirrors and behind other glass, the offset between
the images of the sheets of one pane, tint and dirt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.portals import portal_rectangles
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Portal

GLASS = 1.5  # relative index of refraction
_SLOTS = 8  # panes in a scene are padded to a multiple, so that scenes can share kernels
_FAR = 1e9  # metres; nothing is as far
_MIRRORED = 0.5  # probability of the mirrored direction


class PaneMirror(NamedTuple):
    """Panes as camera rays meet them."""

    met: mi.Bool  # which rays meet a pane before any surface
    reflected: mi.Float  # share of light that the pane reflects
    ray: mi.Ray3f  # mirrored


@dataclass(init=False, eq=False)
class Panes:
    """The panes of a scene; a dataclass because Dr.Jit finds the arrays of a frozen kernel so."""

    panes: list[_Pane]

    def __init__(self, portals: Sequence[Portal]) -> None:
        """Panes in the rectangles around the portals' polygons."""
        rectangles = portal_rectangles(tuple(portals))
        rows = len(rectangles.area)
        figures = np.zeros((-(-rows // _SLOTS) * _SLOTS, 13))
        figures[:, :3], figures[:, 3:6] = _FAR, (0, 0, 1)
        first, second = rectangles.edges
        figures[:rows, :3] = rectangles.centre
        figures[:rows, 3:6] = rectangles.normal
        figures[:rows, 6:9] = 2 * first / (first**2).sum(axis=1, keepdims=True)
        figures[:rows, 9:12] = 2 * second / (second**2).sum(axis=1, keepdims=True)
        figures[:rows, 12] = [portal.panes for portal in portals]
        self.panes = [_Pane(row) for row in figures]

    def meet(
        self, scene: mi.Scene, ray: mi.Ray3f, random: mi.Float, active: mi.Bool
    ) -> tuple[mi.Ray3f, mi.Float, mi.Bool]:
        """Reflect camera rays in the first pane before any surface, or let them pass.

        Returns the rays, their weights, and which are mirrored. `random` is in [0, 1).
        """
        met, reflected, mirror = self.mirror(scene, ray, active)
        mirrored = met & (random < _MIRRORED)
        share = dr.select(mirrored, reflected / _MIRRORED, (1 - reflected) / (1 - _MIRRORED))
        return dr.select(mirrored, mirror, ray), dr.select(met, share, 1), mirrored

    def mirror(self, scene: mi.Scene, ray: mi.Ray3f, active: mi.Bool) -> PaneMirror:
        """Find the first pane that camera rays meet before any surface."""
        nearest, normal, sheets = mi.Float(_FAR), mi.Vector3f(0), mi.Float(0)
        for pane in self.panes:
            distance = pane.distance(ray)
            nearer = distance < nearest
            nearest = dr.select(nearer, distance, nearest)
            normal = dr.select(nearer, pane.normal, normal)
            sheets = dr.select(nearer, pane.sheets, sheets)
        met = active & (nearest < _FAR)
        before = mi.Ray3f(ray)
        before.maxt = nearest
        met &= ~scene.ray_test(before, met)
        cosine = dr.dot(ray.d, normal)
        # Off the pane by a hair, on the camera's side.
        start = ray.o + nearest * ray.d - dr.mulsign(normal, cosine) * 1e-5
        mirror = mi.Ray3f(start, ray.d - 2 * cosine * normal, ray.time, ray.wavelengths)
        return PaneMirror(met, reflectance(dr.abs(cosine), sheets), mirror)


@dataclass(init=False, eq=False)
class _Pane:
    """One pane; an empty one cannot be met."""

    centre: mi.Vector3f
    normal: mi.Vector3f
    across: mi.Vector3f  # an edge divided by half its squared length
    along: mi.Vector3f  # the other edge, likewise
    sheets: mi.Float  # number of sheets of glass

    def __init__(self, figures: Float64Array) -> None:
        numbers = [dr.opaque(mi.Float, float(value)) for value in figures]
        self.centre, self.normal, self.across, self.along = (
            mi.Vector3f(*numbers[k : k + 3]) for k in range(0, 12, 3)
        )
        self.sheets = numbers[12]

    def distance(self, ray: mi.Ray3f) -> mi.Float:
        """Return the distance along a ray, metres; `_FAR` beside the pane."""
        offset = self.centre - mi.Vector3f(ray.o)
        distance = dr.dot(offset, self.normal) / dr.dot(ray.d, self.normal)
        position = distance * ray.d - offset  # of the intersection, from the centre
        inside = (distance > 1e-4) & (dr.abs(dr.dot(position, self.across)) <= 1)
        inside &= dr.abs(dr.dot(position, self.along)) <= 1
        return dr.select(inside, distance, _FAR)


def panes_of(portals: Sequence[Portal]) -> Panes | None:
    """Return the panes in a scene's portals; None if there are none."""
    glazed = [each for each in portals if each.panes and len(portal_rectangles((each,)).area)]
    return Panes(glazed) if glazed else None


def reflectance(cosine: mi.Float, sheets: mi.Float) -> mi.Float:
    """Return the share of unpolarised light that parallel sheets of clear glass reflect.

    `cosine` is that of the angle of incidence, `sheets` their number, 1 or more. All reflections
    between the surfaces count (Stokes 1862): m surfaces that reflect r each together reflect
    m r / (1 + (m - 1) r), for each polarisation by Fresnel's equations.
    """
    inside = dr.sqrt(1 - (1 - cosine * cosine) / GLASS**2)  # cosine within the glass
    surfaces = 2 * sheets
    total = 0.0
    for first, second in ((cosine, GLASS * inside), (GLASS * cosine, inside)):
        ratio = (first - second) / (first + second)
        once = ratio * ratio
        total = total + surfaces * once / (1 + (surfaces - 1) * once)
    return 0.5 * total


def with_panes(integrator: mi.Integrator, portals: Sequence[Portal]) -> mi.SamplingIntegrator:
    """Return an integrator that traces camera rays by `integrator` after their first pane."""
    panes = panes_of(portals)
    return integrator if panes is None else _integrator_class()(integrator, panes)


def _integrator_class() -> type[mi.SamplingIntegrator]:
    """Return the integrator class; its base class needs a Mitsuba variant."""

    class PaneIntegrator(mi.SamplingIntegrator):  # type: ignore[misc]
        def __init__(self, inner: mi.SamplingIntegrator, panes: Panes) -> None:
            super().__init__(mi.Properties())
            self.inner, self.panes = inner, panes

        def sample(
            self,
            scene: mi.Scene,
            sampler: mi.Sampler,
            ray: mi.RayDifferential3f,
            medium: mi.Medium | None = None,
            active: mi.Bool = True,
        ) -> tuple[mi.Color3f, mi.Bool, list[mi.Float]]:
            ray, weight, _ = self.panes.meet(scene, mi.Ray3f(ray), sampler.next_1d(active), active)
            differential = mi.RayDifferential3f(ray)
            color, valid, aovs = self.inner.sample(scene, sampler, differential, medium, active)
            return color * weight, valid, aovs

    return PaneIntegrator
