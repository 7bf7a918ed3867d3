"""Categories of IFC elements by class and predefined type; for furniture by its names.

buildingSMART, *IFC 4.3 Specification*. A new class is a line of `classes.yaml`.
"""

from __future__ import annotations

from typing import Any

from pbrnet.scenes.files import data_beside
from pbrnet.scenes.importing.categories import category_of

_TABLE = data_beside(__file__)
_NO_ROOM = ("Building", "BuildingStorey", "ExternalSpatialElement", "Project")


def plain_class(name: str) -> str:
    """Return the name of a class without what all names share, "IfcWallStandardCase" as "Wall"."""
    return name.removeprefix("Ifc").removesuffix("StandardCase")


def is_window(name: str) -> bool:
    """Return whether elements of a class fill openings with glass."""
    return plain_class(name) == "Window"


def occupies_no_room(name: str) -> bool:
    """Return whether the shape of a class, such as a whole building, repeats those of others."""
    return plain_class(name) in _NO_ROOM


def category_of_element(element: dict[str, Any]) -> tuple[str, bool]:
    """Return the category of an element, and whether it is part of the building's structure.

    The category of a slab or covering is "slab".
    """
    kind = plain_class(element["class"])
    if kind in _TABLE["structure"]:
        category = _TABLE["structure"][kind]
        if kind in ("Slab", "Covering"):
            category = {"ROOF": "ceiling", "CEILING": "ceiling", "FLOOR": "floor",
                        "FLOORING": "floor", "BASESLAB": "floor"}.get(
                element["predefined"], "slab")  # fmt: skip
        return category, True
    stated = _TABLE["by_type"].get(element["predefined"]) or _TABLE["by_class"].get(kind)
    return stated or category_of(element["name"], *element["labels"]), False
