"""Swings of a layout's doors: clear of furniture, ajar or wide open where nothing is stated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.geometry.regions import buffered, covers, meets, union
from pbrnet.scenes.layout.layout import LayoutOpening
from pbrnet.scenes.procedural.plan import Opening, Plan
from pbrnet.scenes.procedural.planning import draw_angle
from pbrnet.scenes.procedural.structure import leaf_footprint
from pbrnet.scenes.seeds import Draw


def with_swings(
    rng: Draw, plan: Plan, stated: Mapping[str, LayoutOpening], solid: Sequence[BaseGeometry]
) -> Plan:
    """The plan with the angles of its doors' leaves.

    `stated` are the openings of the layout by their ids in the plan; `solid` are the areas that
    furniture fills. A leaf that would hit something swings to the other side, or is closed.
    """
    blocked = union(solid)
    openings = []
    for opening in plan.openings:
        if opening.kind == "door":
            degrees = stated[opening.id].open_degrees
            drawn = draw_angle(rng)
            angle = drawn if degrees is None else min(degrees, 110.0)
            opening = _free_swing(plan, replace(opening, angle=angle), blocked)
        openings.append(opening)
    return replace(plan, openings=tuple(openings))


def _free_swing(plan: Plan, opening: Opening, blocked: BaseGeometry) -> Opening:
    """The door with a swing that hits nothing; closed if there is none."""
    other = next(room for room in opening.rooms if room != opening.swing)
    for swing in (opening.swing, other):
        for hinge in (opening.hinge_at_start, not opening.hinge_at_start):
            turned = replace(opening, swing=swing, hinge_at_start=hinge)
            leaf = leaf_footprint(plan, turned)
            free = buffered(
                union([plan.room(swing).shape, opening.footprint]), 0.03, join_style="mitre"
            )
            if leaf is None or (covers(free, leaf) and not meets(leaf, blocked)):
                return turned
    return replace(opening, angle=0.0)
