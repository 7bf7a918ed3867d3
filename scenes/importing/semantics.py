"""Numbers of object categories, and the classes of NYU40 and of its 13-class map.

A category's number is its place in `CATEGORY_LABELS`, which only grows at its end, so that labels
of older datasets keep their meaning; 0 is no object. NYU40 are the forty classes of Gupta et al.
2013 for the NYU Depth dataset (Silberman et al. 2012); the 13 classes are those of Couprie et al.
2013, by the map that is published with NYUv2's meta data.
"""

from __future__ import annotations

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
# (category, NYU40 class); a category's number is its place here. Append only.
_LABELS: tuple[tuple[str, str], ...] = (
    ("", ""),
    ("wall", "wall"),
    ("floor", "floor"),
    ("ceiling", "ceiling"),
    ("door", "door"),
    ("window", "window"),
    ("structure", "other structure"),
    ("skirting", "other structure"),
    ("slab", "other structure"),
    ("stairs", "other structure"),
    ("railing", "other structure"),
    ("fireplace", "other structure"),
    ("splashback", "wall"),
    ("ground", "other structure"),
    ("building", "other structure"),
    ("rug", "floor mat"),
    ("curtain", "curtain"),
    ("lamp", "lamp"),
    ("wash basin", "sink"),
    ("toilet", "toilet"),
    ("shower", "other structure"),
    ("towel rail", "other prop"),
    ("bath", "bathtub"),
    ("washing machine", "other furniture"),
    ("dishwasher", "other furniture"),
    ("microwave", "other prop"),
    ("stove", "other furniture"),
    ("extractor hood", "other structure"),
    ("fridge", "refrigerator"),
    ("sink", "sink"),
    ("night table", "night stand"),
    ("cushion", "pillow"),
    ("bed", "bed"),
    ("armchair", "chair"),
    ("sofa", "sofa"),
    ("stool", "chair"),
    ("bench", "other furniture"),
    ("chair", "chair"),
    ("desk", "desk"),
    ("picture", "picture"),
    ("mirror", "mirror"),
    ("tv stand", "other furniture"),
    ("television", "television"),
    ("monitor", "other prop"),
    ("laptop", "other prop"),
    ("computer", "other prop"),
    ("wardrobe", "other furniture"),
    ("bookshelf", "bookshelf"),
    ("shelf", "shelves"),
    ("kitchen unit", "cabinet"),
    ("chest", "dresser"),
    ("sideboard", "cabinet"),
    ("cabinet", "cabinet"),
    ("table", "table"),
    ("books", "books"),
    ("vase", "other prop"),
    ("plant", "other prop"),
    ("radiator", "other furniture"),
    ("piano", "other furniture"),
    ("pot", "other prop"),
    ("kettle", "other prop"),
    ("glass", "other prop"),
    ("bowl", "other prop"),
    ("crockery", "other prop"),
    ("clock", "other prop"),
    ("candle", "other prop"),
    ("vehicle", "other prop"),
    ("person", "person"),
    ("animal", "other prop"),
    ("toy", "other prop"),
    ("instrument", "other prop"),
    ("bin", "other furniture"),
    ("box", "box"),
    ("switch", "other prop"),
    ("furniture", "other furniture"),
    ("textile", "other prop"),
    ("fitting", "other prop"),
    ("clutter", "other prop"),
    ("other", "other prop"),
    ("bottle", "other prop"),
    ("paper", "paper"),
    ("towel", "towel"),
    ("clothing", "clothes"),
    ("shoe", "other prop"),
    ("bag", "bag"),
    ("cable", "other prop"),
    ("electronics", "other prop"),
    ("appliance", "other prop"),
    ("food", "other prop"),
    ("cloud", "other structure"),
)
CATEGORY_LABELS = tuple(category for category, _ in _LABELS)
# NYU40 class of each category number
NYU40_OF_CATEGORY = tuple(NYU40_NAMES.index(name) for _, name in _LABELS)


def category_number(category: str) -> int:
    """Return the number of a category, that of "other" for one that has none of its own."""
    known = category if category in CATEGORY_LABELS[1:] else "other"
    return CATEGORY_LABELS.index(known)
