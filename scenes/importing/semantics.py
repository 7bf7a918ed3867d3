"""Numbers of object categories, and the classes of NYU40 and of its 13-class map.

A category's number is its place in `semantics.yaml`, which only grows at its end, so that labels
of older datasets keep their meaning; 0 is no object. NYU40 are the forty classes of Gupta et al.
2013 for the NYU Depth dataset (Silberman et al. 2012); the 13 classes are those of Couprie et al.
2013, by the map that is published with NYUv2's meta data.
"""

from __future__ import annotations

from pbrnet.scenes.files import data_beside

NYU40_NAMES = (
    *("", "wall", "floor", "cabinet", "bed", "chair", "sofa", "table", "door", "window"),
    *("bookshelf", "picture", "counter", "blinds", "desk", "shelves", "curtain", "dresser"),
    *("pillow", "mirror", "floor mat", "clothes", "ceiling", "books", "refrigerator"),
    *("television", "paper", "towel", "shower curtain", "box", "whiteboard", "person"),
    *("night stand", "toilet", "sink", "lamp", "bathtub", "bag", "other structure"),
    *("other furniture", "other prop"),
)
NYU13_NAMES = (
    *("", "bed", "books", "ceiling", "chair", "floor", "furniture", "objects", "picture"),
    *("sofa", "table", "television", "wall", "window"),
)
# NYU13 class of each NYU40 class
NYU13_OF_NYU40 = (
    *(0, 12, 5, 6, 1, 4, 9, 10, 12, 13, 6, 8, 6, 13, 10, 6, 13, 6, 7, 7, 5),
    *(7, 3, 2, 6, 11, 7, 7, 7, 7, 7, 7, 6, 7, 7, 7, 7, 7, 7, 6, 7),
)
_TABLE: dict[str, str] = {"": "", **data_beside(__file__)}
CATEGORY_LABELS = tuple(_TABLE)
# NYU40 class of each category number
NYU40_OF_CATEGORY = tuple(NYU40_NAMES.index(text.partition(", ")[0]) for text in _TABLE.values())
# Categories that furnish a room
FURNITURE = frozenset(name for name, text in _TABLE.items() if text.endswith(", furniture"))


def category_number(category: str) -> int:
    """Return the number of a category, that of "other" for one that has none of its own."""
    known = category if category in CATEGORY_LABELS[1:] else "other"
    return CATEGORY_LABELS.index(known)
