"""Categories of IFC elements by class and predefined type; for furniture by its names.

buildingSMART, *IFC 4.3 Specification*. A new class is a line in one of the tables.
"""

from __future__ import annotations

from typing import Any

from pbrnet.scenes.importing.categories import category_of

# Class without "Ifc" and "StandardCase" -> category of the building's structure; "slab": what the
# position says, floor or ceiling.
_STRUCTURE = {
    "Beam": "structure",
    "BuildingElementPart": "structure",
    "Chimney": "structure",
    "Column": "structure",
    "Covering": "slab",
    "CurtainWall": "wall",
    "Door": "door",
    "ElementAssembly": "structure",
    "Footing": "structure",
    "GeographicElement": "structure",
    "Member": "structure",
    "Pile": "structure",
    "Plate": "structure",
    "Railing": "railing",
    "Ramp": "stairs",
    "RampFlight": "stairs",
    "Roof": "ceiling",
    "Site": "structure",
    "Slab": "slab",
    "Stair": "stairs",
    "StairFlight": "stairs",
    "Wall": "wall",
    "WallElementedCase": "wall",
    "Window": "window",
}
_BY_TYPE = {
    "BATH": "bath",
    "BIDET": "toilet",
    "CISTERN": "toilet",
    "SHOWER": "shower",
    "SINK": "sink",
    "TOILETPAN": "toilet",
    "URINAL": "toilet",
    "WASHHANDBASIN": "wash basin",
    "DISHWASHER": "dishwasher",
    "ELECTRICCOOKER": "stove",
    "FREEZER": "fridge",
    "FRIDGE_FREEZER": "fridge",
    "REFRIGERATOR": "fridge",
    "MICROWAVE": "microwave",
    "TUMBLEDRYER": "washing machine",
    "WASHINGMACHINE": "washing machine",
    "CHAIR": "chair",
    "TABLE": "table",
    "DESK": "desk",
    "BED": "bed",
    "FILECABINET": "cabinet",
    "SHELF": "shelf",
    "SOFA": "sofa",
}
_BY_CLASS = {
    "Lamp": "lamp",
    "LightFixture": "lamp",
    "SpaceHeater": "radiator",
    "Outlet": "switch",
    "SwitchingDevice": "switch",
    "AudioVisualAppliance": "television",
}
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
    if kind in _STRUCTURE:
        category = _STRUCTURE[kind]
        if kind in ("Slab", "Covering"):
            category = {"ROOF": "ceiling", "CEILING": "ceiling", "FLOOR": "floor",
                        "FLOORING": "floor", "BASESLAB": "floor"}.get(
                element["predefined"], "slab")  # fmt: skip
        return category, True
    stated = _BY_TYPE.get(element["predefined"]) or _BY_CLASS.get(kind)
    return stated or category_of(element["name"], *element["labels"]), False
