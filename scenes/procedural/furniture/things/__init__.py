# ruff: noqa: E501 (a table of one line for each kind)
"""Things that people leave in rooms: kinds, and the places where they are left.

`THINGS["mug"].make(rng, style)` returns a small `FurniturePiece`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from scenes.procedural.furniture.things import packages, soft, vessels
from scenes.procedural.piece import FurniturePiece


@dataclass(frozen=True)
class Thing:
    """A kind of thing: `make(rng, style)` builds one; `places` are names of places for it."""

    name: str
    places: tuple[str, ...]
    make: Callable[..., FurniturePiece]


def _thing(
    name: str, places: str, make: Callable[..., FurniturePiece], /, **options: object
) -> Thing:
    return Thing(name.replace(" ", "_"), tuple(places.split()), partial(make, **options))


def _named(
    name: str, places: str, make: Callable[..., FurniturePiece], /, **options: object
) -> Thing:
    return _thing(name, places, make, name=name, **options)


_B, _J, _C = vessels.bottle, vessels.jar, vessels.cup
_BOX, _SLAB, _DEVICE = packages.package, packages.slab, packages.device
# Places: worktop, sink, dining, coffee, desk, bedside, shelf, dresser, bath, tub, laundry, top
# (of wardrobes and fridges), sill on surfaces; hall, floor, play, gym on the floor; wall kinds by
# their room.
_THINGS = (
    # Kitchen
    _named("wine bottle", "worktop dining shelf", _B, radius=(0.036, 0.039), height=(0.29, 0.32), body="glass", neck=0.36),
    _named("oil bottle", "worktop", _B, radius=(0.03, 0.036), height=(0.24, 0.3), body="glass"),
    _named("vinegar", "worktop", _B, radius=(0.027, 0.03), height=(0.19, 0.24), body="glass", shoulder=0.55),
    _named("water bottle", "worktop desk dining bedside coffee", _B, radius=(0.033, 0.04), height=(0.2, 0.27), body="metal", shoulder=0.8, neck=0.6, label=False),
    _named("soda bottle", "worktop dining coffee desk", _B, radius=(0.03, 0.045), height=(0.22, 0.33), body="plastic", shoulder=0.7),
    _named("beer bottle", "worktop coffee", _B, radius=(0.03, 0.031), height=(0.22, 0.24), body="glass", shoulder=0.58),
    _named("ketchup", "worktop dining", _B, radius=(0.028, 0.034), height=(0.16, 0.22), body="plastic", shoulder=0.7, neck=0.5),
    _named("dish soap", "sink", _B, radius=(0.028, 0.034), height=(0.19, 0.24), body="plastic", shoulder=0.72),
    _named("spray cleaner", "sink bath laundry", _B, radius=(0.03, 0.04), height=(0.24, 0.28), body="plastic", shoulder=0.55, neck=0.5),
    _named("spice jar", "worktop shelf", _J, radius=(0.02, 0.024), height=(0.08, 0.1)),
    _named("jam jar", "worktop dining", _J, radius=(0.032, 0.04), height=(0.08, 0.11)),
    _named("honey jar", "worktop", _J, radius=(0.035, 0.042), height=(0.1, 0.12), body="plastic"),
    _named("coffee tin", "worktop shelf", _J, radius=(0.05, 0.06), height=(0.13, 0.17), body="tin"),
    _named("tea tin", "worktop shelf", _J, radius=(0.038, 0.045), height=(0.09, 0.13), body="tin"),
    _named("flour jar", "worktop shelf", _J, radius=(0.06, 0.075), height=(0.17, 0.22), body="ceramic", label=False),
    _named("food can", "worktop", _J, radius=(0.036, 0.042), height=(0.09, 0.12), body="metal", lid=False, category="food"),
    _named("drinks can", "worktop coffee desk", _J, radius=(0.032, 0.034), height=(0.11, 0.13), body="metal", lid=False, category="bottle"),
    _named("biscuit tin", "worktop shelf coffee", _J, radius=(0.09, 0.11), height=(0.06, 0.09), body="tin"),
    _named("mug", "worktop sink desk coffee bedside dining", _C, radius=(0.038, 0.045), height=(0.085, 0.105), foot=0.9),
    _named("espresso cup", "worktop coffee dining", _C, radius=(0.03, 0.034), height=(0.055, 0.065)),
    _named("tumbler", "worktop sink dining coffee bedside", _C, radius=(0.033, 0.04), height=(0.09, 0.14), handle=False, glass=True, foot=0.85, category="glass"),
    _named("cereal bowl", "worktop sink dining coffee", _C, radius=(0.065, 0.08), height=(0.05, 0.065), handle=False, foot=0.45, category="bowl"),
    _named("salad bowl", "worktop dining", _C, radius=(0.11, 0.14), height=(0.08, 0.11), handle=False, foot=0.45, category="bowl"),
    _named("jug", "worktop dining shelf", _C, radius=(0.05, 0.06), height=(0.17, 0.22), foot=0.85),
    _named("trinket dish", "bedside dresser hall_top shelf", _C, radius=(0.045, 0.07), height=(0.02, 0.03), handle=False, foot=0.6, category="bowl"),
    _thing("wine glass", "dining worktop coffee", vessels.stemmed, name="wine glass", slim=False),
    _thing("champagne glass", "dining worktop", vessels.stemmed, name="champagne glass", slim=True),
    _thing("frying pan", "worktop", vessels.pan, name="frying pan", deep=0.045),
    _thing("saucepan", "worktop sink", vessels.pan, name="saucepan", deep=0.1),
    _thing("used plate", "sink worktop coffee dining desk", vessels.plate, name="plate", crumbs=True),
    _thing("laid plate", "dining sink", vessels.plate, name="laid plate", crumbs=False),
    _thing("teapot", "worktop dining coffee", vessels.teapot),
    _thing("pepper mill", "worktop dining", vessels.mill),
    _thing("utensils", "worktop", vessels.filled_cup, name="utensils", what="spoons"),
    _thing("kitchen roll", "worktop", vessels.roll, name="kitchen roll", radius=0.058, height=0.23, spike=True),
    _named("bread", "worktop dining", vessels.wrapped_food),
    _named("onion", "worktop", vessels.wrapped_food),
    _named("lemon", "worktop dining", vessels.wrapped_food),
    _named("pumpkin", "worktop", vessels.wrapped_food),
    _named("apple", "worktop coffee desk dining", vessels.wrapped_food),
    _named("orange", "worktop coffee dining", vessels.wrapped_food),
    _named("tomato", "worktop", vessels.wrapped_food),
    _named("avocado", "worktop", vessels.wrapped_food),
    _thing("eggs", "worktop", packages.eggs),
    _named("cereal box", "worktop top", _BOX, size=(0.19, 0.06, 0.28)),
    _named("pasta box", "worktop", _BOX, size=(0.09, 0.04, 0.2)),
    _named("tea box", "worktop", _BOX, size=(0.12, 0.07, 0.08)),
    _named("pizza box", "worktop coffee", _BOX, size=(0.3, 0.3, 0.035), look="brown"),
    _named("milk carton", "worktop dining", packages.gabled),
    _named("juice carton", "worktop", packages.gabled),
    _named("chopping board", "worktop", packages.board),
    _named("tray", "worktop coffee dining", packages.board),
    _thing("knife block", "worktop", packages.knives),
    _thing("dish rack", "sink worktop", packages.rack),
    _thing("sponge", "sink", packages.cleaner),
    _named("toaster", "worktop", _DEVICE, size=(0.28, 0.17, 0.19), detail="slots", category="appliance"),
    _named("coffee machine", "worktop", _DEVICE, size=(0.2, 0.24, 0.34), detail="spout", category="appliance"),
    _named("kitchen scales", "worktop", _DEVICE, size=(0.2, 0.22, 0.03), category="appliance"),
    _named("bread bin", "worktop", _DEVICE, size=(0.36, 0.24, 0.2), detail="display", category="appliance"),
    _thing("tea towel", "worktop sink", soft.folded, name="tea towel", size=(0.24, 0.16), layers=1, category="towel"),
    # Desk, living room, bedroom
    _thing("pens", "desk shelf", vessels.filled_cup, name="pens", what="pens"),
    _thing("brushes", "desk dresser", vessels.filled_cup, name="brushes", what="brushes"),
    _named("phone", "desk coffee bedside worktop dining hall_top", _SLAB, size=(0.073, 0.15, 0.009), screen=True),
    _named("tablet", "desk coffee bedside dining", _SLAB, size=(0.25, 0.175, 0.008), screen=True),
    _named("remote control", "coffee tv bedside", _SLAB, size=(0.045, 0.17, 0.018), keys=True),
    _named("calculator", "desk", _SLAB, size=(0.08, 0.14, 0.014), keys=True),
    _named("keyboard", "desk", _SLAB, size=(0.4, 0.13, 0.018), keys=True),
    _named("hard drive", "desk", _SLAB, size=(0.08, 0.115, 0.016)),
    _named("power bank", "desk bedside hall_top", _SLAB, size=(0.07, 0.14, 0.016), white=True),
    _named("games console", "tv", _SLAB, size=(0.3, 0.24, 0.055)),
    _named("set top box", "tv", _SLAB, size=(0.22, 0.15, 0.035)),
    _named("computer mouse", "desk", _SLAB, size=(0.06, 0.105, 0.034)),
    _named("stapler", "desk", _SLAB, size=(0.04, 0.13, 0.045)),
    _named("glasses case", "desk bedside", _SLAB, size=(0.16, 0.065, 0.04), category="clutter"),
    _named("loudspeaker", "tv shelf desk", _DEVICE, size=(0.14, 0.17, 0.24), detail="cones"),
    _named("radio", "shelf worktop dresser bedside", _DEVICE, size=(0.24, 0.09, 0.14), detail="dials"),
    _named("router", "shelf tv desk", _DEVICE, size=(0.2, 0.14, 0.035), detail="aerials"),
    _named("alarm clock", "bedside", _DEVICE, size=(0.13, 0.07, 0.075), detail="display", category="clock"),
    _named("printer", "desk", _DEVICE, size=(0.42, 0.32, 0.16), detail="paper"),
    _named("camera", "shelf desk dresser", _DEVICE, size=(0.13, 0.06, 0.085), detail="dials"),
    _thing("charger", "desk bedside coffee worktop hall_top", packages.charger),
    _thing("photo frame", "shelf dresser bedside desk hall_top tv", packages.frame),
    _thing("open book", "coffee bedside desk", packages.pages),
    _thing("letters", "hall_top desk coffee dining worktop", packages.papers, name="letters", size=(0.22, 0.11, 0.002), sheets=4),
    _thing("papers", "desk dining coffee", packages.papers, name="papers", size=(0.21, 0.297, 0.002), sheets=5),
    _thing("magazines", "coffee bedside desk shelf", packages.papers, name="magazines", size=(0.21, 0.28, 0.006), sheets=4, look="print"),
    _thing("newspaper", "coffee dining worktop", packages.papers, name="newspaper", size=(0.29, 0.2, 0.008), sheets=1, look="print"),
    _thing("notebooks", "desk bedside", packages.papers, name="notebooks", size=(0.15, 0.21, 0.014), sheets=3, look="cover"),
    _thing("ring binders", "desk shelf", packages.papers, name="ring binders", size=(0.28, 0.32, 0.055), sheets=2, look="cover"),
    _named("tissue box", "bedside coffee desk bath dresser", _BOX, size=(0.22, 0.12, 0.08)),
    _named("board game", "shelf top coffee", _BOX, size=(0.38, 0.27, 0.055)),
    _named("puzzle", "shelf coffee", _BOX, size=(0.28, 0.2, 0.05)),
    _named("medicine", "bedside bath worktop", _BOX, size=(0.09, 0.035, 0.06)),
    _named("gift box", "shelf dresser top", _BOX, size=(0.17, 0.17, 0.1), look="plain"),
    _named("shoe box", "top floor", _BOX, size=(0.34, 0.21, 0.12), look="plain", anchor="free"),
    _named("parcel", "hall_top desk dining", _BOX, size=(0.28, 0.2, 0.12), look="brown"),
    _named("moving box", "floor", _BOX, size=(0.42, 0.34, 0.33), look="brown", anchor="free"),
    _thing("hat", "dresser top hall_top", soft.hat),
    _thing("folded clothes", "dresser bed_side top", soft.folded, name="folded clothes", size=(0.3, 0.24), layers=5, category="clothing"),
    _named("perfume", "dresser bath", _B, radius=(0.02, 0.028), height=(0.08, 0.12), body="glass", shoulder=0.6, label=False),
    _named("cream jar", "bath dresser bedside", _J, radius=(0.024, 0.035), height=(0.035, 0.05), body="white", category="fitting"),
    _named("candle jar", "coffee bath shelf dresser", _J, radius=(0.035, 0.045), height=(0.07, 0.1), body="ceramic", lid=False, category="candle"),
    # Bathroom
    _named("shampoo", "bath tub", _B, radius=(0.026, 0.034), height=(0.17, 0.23), body="plastic", shoulder=0.78, neck=0.5, category="fitting"),
    _named("soap dispenser", "bath sink", _B, radius=(0.032, 0.038), height=(0.15, 0.19), body="plastic", shoulder=0.66, label=False, category="fitting"),
    _named("mouthwash", "bath", _B, radius=(0.034, 0.04), height=(0.18, 0.22), body="plastic", shoulder=0.62, category="fitting"),
    _named("deodorant", "bath dresser", _J, radius=(0.024, 0.028), height=(0.12, 0.16), body="tin", category="fitting"),
    _named("pill tube", "bath bedside", _J, radius=(0.017, 0.022), height=(0.07, 0.1), body="white", category="fitting"),
    _thing("toothbrushes", "bath", vessels.filled_cup, name="toothbrushes", what="toothbrushes"),
    _thing("toilet roll", "bath toilet_top", vessels.roll, name="toilet roll", radius=0.055, height=0.1, spike=False),
    _thing("towels", "bath laundry tub", soft.folded, name="towels", size=(0.3, 0.2), layers=4, category="towel"),
    _named("hair dryer case", "bath dresser", _SLAB, size=(0.2, 0.12, 0.07), category="appliance"),
    _named("detergent", "laundry", _B, radius=(0.06, 0.07), height=(0.26, 0.3), body="plastic", shoulder=0.7, neck=0.5),
    _named("washing powder", "laundry", _BOX, size=(0.2, 0.12, 0.24)),
    # Floor
    _thing("shoes", "hall floor", soft.shoes, name="shoes"),
    _thing("sneakers", "hall floor", soft.shoes, name="sneakers"),
    _thing("slippers", "floor", soft.shoes, name="slippers"),
    _thing("boots", "hall", soft.shoes, name="boots"),
    _thing("backpack", "hall floor", soft.bag, name="backpack", size=(0.3, 0.18, 0.42)),
    _thing("handbag", "hall floor", soft.bag, name="handbag", size=(0.32, 0.13, 0.24)),
    _thing("tote bag", "hall floor", soft.bag, name="tote bag", size=(0.34, 0.12, 0.34)),
    _thing("paper bag", "hall kitchen_floor", soft.bag, name="paper bag", size=(0.28, 0.16, 0.34)),
    _thing("suitcase", "hall bed_floor", soft.suitcase),
    _thing("umbrella", "hall", soft.umbrella),
    _thing("garment", "bed_floor", soft.sheet, name="garment", size=(60, 54), gather=42, category="clothing"),
    _thing("trousers", "bed_floor", soft.sheet, name="trousers", size=(90, 36), gather=48, category="clothing"),
    _thing("dropped towel", "bath_floor", soft.sheet, name="dropped towel", size=(66, 48), gather=38, category="towel"),
    _thing("throw", "play", soft.sheet, name="throw", size=(100, 72), gather=35, category="textile"),
    _named("laundry basket", "bath_floor bed_floor", vessels.bucket, size=0.2),
    _named("bucket", "bath_floor kitchen_floor", vessels.bucket, size=0.14),
    _named("planter", "floor", vessels.bucket, size=0.13, category="pot"),
    _thing("power strip", "study_floor tv_floor", packages.power_strip),
    _thing("building bricks", "play", packages.bricks),
    _named("toy car", "shelf desk", packages.car),
    _named("toy train", "shelf", packages.car),
    _thing("teddy", "shelf dresser top", packages.teddy),
    _named("football", "play hall", packages.ball, radius=0.108),
    _named("small ball", "play", packages.ball, radius=0.05),
    _named("exercise ball", "gym", packages.ball, radius=0.3),
    _thing("dumbbells", "gym", packages.dumbbells),
    _thing("rolled mat", "gym", soft.mat),
    # Walls and ceilings
    _named("socket", "wall", packages.fixture, size=(0.085, 0.01, 0.085), height=0.28, holes=1),
    _thing("double socket", "wall", packages.fixture, name="socket", size=(0.155, 0.01, 0.085), height=0.28, holes=2),
    _named("switch", "door", packages.fixture, size=(0.083, 0.009, 0.083), height=1.05, holes=1),
    _thing("double switch", "door", packages.fixture, name="switch", size=(0.085, 0.009, 0.085), height=1.05, holes=2),
    _named("thermostat", "door", packages.fixture, size=(0.09, 0.025, 0.09), height=1.45, holes=0),
    _named("vent", "wet", packages.fixture, size=(0.16, 0.015, 0.16), height=2.12, holes=0),
    _named("intercom", "entrance", packages.fixture, size=(0.1, 0.035, 0.2), height=1.4, holes=0),
    _thing("smoke detector", "ceiling", packages.detector),
)  # fmt: skip
THINGS: dict[str, Thing] = {thing.name: thing for thing in _THINGS}
BY_PLACE: dict[str, tuple[str, ...]] = {
    place: tuple(thing.name for thing in _THINGS if place in thing.places)
    for place in sorted({place for thing in _THINGS for place in thing.places})
}
