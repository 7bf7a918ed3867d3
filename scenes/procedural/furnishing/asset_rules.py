"""Rules that match catalogue assets to furniture kinds by words and size.

A catalogue describes a piece by name, tags and size. Words alone mislead ("bar chair", "armchair
ottoman"), so every rule also bounds the size. All sizes in metres.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from pbrnet.scenes.assets.index import IndexEntry
from pbrnet.scenes.procedural.piece import Anchor

Range = tuple[float, float]
ANY_SIZE: Range = (0.0, 1e9)
# Outdoor furniture, vehicles, people, animals and parts of the building.
_EXCLUDED = re.compile(
    r"\b(outdoor|garden|patio|exterior|beach|deck|park|street|vehicle|human|people|animal|"
    r"staircase|doors? and windows?|characters|urinal|hospital|christmas|snow|broken)\b"
)


@dataclass(frozen=True)
class AssetRule:
    """Conditions on a catalogue entry, and the attributes of the furniture made from it.

    `words` is a regular expression over "[group] name, tags, identifier" in lower case; `exclude`
    is one over group and name. `lumens` bounds the flux of all light sources of a piece; (0, 0)
    excludes pieces with light sources.
    """

    kind: str
    words: str
    category: str
    anchor: Anchor
    width: Range = ANY_SIZE
    depth: Range = ANY_SIZE
    height: Range = ANY_SIZE
    exclude: str = ""
    top: Range = ANY_SIZE  # height of the upper end above the floor: elevation plus height
    elevation: Range = (0.0, 0.01)
    front_clearance: float = 0.0  # metres of free floor in front
    lumens: Range = (0.0, 0.0)

    def matches(self, entry: IndexEntry) -> bool:
        """Return True if a catalogue entry meets all conditions."""
        if entry.opening or bool(entry.lumens) != (self.lumens[1] > 0):
            return False
        # Tags are imprecise ("Outdoor" for a potted plant): exclusions look at the name alone.
        name = f"[{entry.group}] {entry.name}".lower()
        text = f"[{entry.group}] {entry.words}".lower()
        if _EXCLUDED.search(name) or not re.search(rf"\b(?:{self.words})\b", text):
            return False
        if self.exclude and re.search(rf"\b(?:{self.exclude})\b", name):
            return False
        measured = (*entry.size, entry.elevation, entry.elevation + entry.size[2])
        ranges = (self.width, self.depth, self.height, self.elevation, self.top)
        return all(
            low <= value <= high for value, (low, high) in zip(measured, ranges, strict=True)
        )


_PLANTS = (
    "plants?|ficus|yucca|bamboo|spathiphyllum|bonsai|palm|tulips?|lily|orchids?|cactus|flowers|fern"
)
_KITCHENWARE = "cup|mug|plates?|glass|tray|bowl|cutlery|teapot|creamer|pottery"
_ON_FLOOR = "carpet|rug|bathmat|doormat"

ASSET_RULES: tuple[AssetRule, ...] = (
    # seats
    AssetRule("dining_chair", "chair", "chair", "free", (0.36, 0.67), (0.38, 0.66), (0.72, 1.2),
              front_clearance=0.5,
              exclude="armchair|office|desk|high chair|child|children|kids?|baby|relax|bar|"
              "ryokan|class|lounge|wheelchair|stool"),
    AssetRule("armchair", "armchair", "armchair", "free", (0.55, 1.15), (0.5, 1.0), (0.65, 1.15),
              front_clearance=0.45, exclude="office|ottoman"),
    AssetRule("sofa", "sofa|couch|settee", "sofa", "wall", (1.3, 2.6), (0.6, 1.1), (0.6, 1.1),
              front_clearance=0.45, exclude="corner|opened|bed"),
    AssetRule("stool", "stool", "stool", "free", (0.28, 0.55), (0.28, 0.55), (0.35, 0.82),
              exclude="bar"),
    AssetRule("office_chair", r"office\] .*chair|desk chair|office chair", "chair", "free",
              (0.45, 0.7), (0.45, 0.7), (0.8, 1.2), front_clearance=0.4, exclude="class"),
    AssetRule("pouf", "puff|pouf|ottoman", "stool", "free", (0.3, 1.0), (0.3, 1.0), (0.25, 0.65),
              exclude="armchair|chair"),
    AssetRule("bench", "bench", "bench", "wall", (0.6, 1.6), (0.25, 0.6), (0.35, 0.6),
              front_clearance=0.4, exclude="abdominal|fitness|work"),
    # tables
    AssetRule("dining_table", "table", "table", "centre", (1.0, 2.1), (0.6, 1.25), (0.68, 0.82),
              front_clearance=0.6,
              exclude="coffee|side|bedside|changing|dressing|bar|tennis|football|pool|"
              "technical|child|children|kids?|desk|round|oak"),
    AssetRule("round_table", "round table|oak table|tablecloth", "table", "centre", (0.6, 1.3),
              (0.6, 1.3), (0.68, 0.82), front_clearance=0.6),
    AssetRule("coffee_table", r"coffee table|low table|living room\] table", "table", "centre",
              (0.7, 1.5), (0.4, 0.95), (0.3, 0.56), front_clearance=0.3),
    AssetRule("side_table", "table", "table", "free", (0.3, 0.68), (0.3, 0.68), (0.4, 0.76),
              exclude="bedside|nightstand|child|children|lamp|fan|tennis|night"),
    AssetRule("desk", "desk", "desk", "wall", (0.9, 1.7), (0.45, 0.9), (0.68, 1.1),
              front_clearance=0.75, exclude="chair|lamp"),
    # storage
    AssetRule("bookshelf", "bookcase|bookshelf|shelves", "bookshelf", "wall", (0.4, 1.8),
              (0.2, 0.5), (1.0, 2.3), front_clearance=0.5, exclude="kitchen|upper"),
    AssetRule("wardrobe", "wardrobe|armoire", "wardrobe", "wall", (0.8, 2.2), (0.45, 0.75),
              (1.6, 2.4), front_clearance=0.7),
    AssetRule("chest_of_drawers", "chest|dresser|drawers|commode", "chest", "wall", (0.5, 1.65),
              (0.35, 0.6), (0.6, 1.2), front_clearance=0.6, exclude="kitchen|freezer|bed"),
    AssetRule("sideboard", "sideboard|buffet|dresser with drawers|credenza", "sideboard", "wall",
              (0.9, 2.0), (0.3, 0.6), (0.6, 1.1), front_clearance=0.5),
    AssetRule("tv_stand", "tv stand|television stand|television cabinet", "tv stand", "wall",
              (0.8, 2.0), (0.3, 0.6), (0.3, 0.7), front_clearance=0.4),
    AssetRule("night_table", "bedside|nightstand|night table", "night table", "wall", (0.3, 0.6),
              (0.3, 0.55), (0.35, 0.7), front_clearance=0.3, exclude="lamp"),
    AssetRule("storage_box", "box|crate|basket|suitcase|trunk|trunck", "box", "free", (0.25, 0.65),
              (0.2, 0.6), (0.15, 0.7),
              exclude="penbox|medicine|bread|letters?|mail|ammo|toilet|shopping"),
    AssetRule("waste_bin", "dustbin|trash can|waste|bin", "bin", "free", (0.15, 0.42),
              (0.15, 0.42), (0.2, 0.76), exclude="recycling"),
    # beds
    AssetRule("double_bed", "bed", "bed", "wall", (1.3, 2.1), (1.9, 2.35), (0.4, 1.25),
              front_clearance=0.5,
              exclude="bunk|mezzanine|child|baby|crib|sleeping|air|sofa|futon"),
    AssetRule("single_bed", "bed", "bed", "wall", (0.8, 1.1), (1.9, 2.2), (0.4, 1.2),
              front_clearance=0.5, exclude="bunk|mezzanine|baby|crib|sleeping|air|day|sofa"),
    # kitchen and bath
    AssetRule("fridge", "fridge|refrigerator", "fridge", "wall", (0.5, 0.95), (0.5, 0.97),
              (1.1, 2.0), front_clearance=0.9),
    AssetRule("kettle", "kettle|boiler|teapot", "kettle", "on_top", (0.08, 0.3), (0.06, 0.25),
              (0.1, 0.32)),
    AssetRule("cooking_pot", "pan|cooking pot|casserole|deep fryer", "pot", "on_top", (0.12, 0.45),
              (0.12, 0.6), (0.05, 0.35)),
    AssetRule("microwave", "microwave|small oven", "microwave", "on_top", (0.35, 0.6), (0.25, 0.5),
              (0.2, 0.4)),
    AssetRule("bath_tub", "bath|bathtub", "bath", "wall", (1.4, 1.9), (0.6, 0.95), (0.4, 0.8),
              front_clearance=0.5, exclude="mat|corner"),
    AssetRule("wash_basin", "washbasin|wash basin|vanity", "wash basin", "wall", (0.4, 1.1),
              (0.35, 0.72), (0.75, 1.2), front_clearance=0.7),
    AssetRule("toilet", "toilets? unit|toilet|wc", "toilet", "wall", (0.3, 0.5), (0.45, 0.86),
              (0.35, 0.95), front_clearance=0.6, exclude="brush|paper|dispenser"),
    AssetRule("shower", "shower stall|shower cabin", "shower", "corner", (0.7, 1.1), (0.7, 1.15),
              (1.8, 2.25), front_clearance=0.6),
    AssetRule("washing_machine", "washing machine|dryer machine|washer", "washing machine", "wall",
              (0.55, 0.65), (0.5, 0.65), (0.65, 0.95), front_clearance=0.7),
    AssetRule("towel_rail", "towel rack|towel rail|towel", "towel rail", "on_wall", (0.3, 0.8),
              (0.05, 0.2), (0.05, 1.7), elevation=(0.2, 1.5), exclude="dispenser"),
    AssetRule("toiletries", r"bathroom\] .*(?:bottle|soap|cosmetics?|flacon|lip|medicine|sponge|"
              r"comb|towel)", "toiletries", "on_top", (0.01, 0.24), (0.01, 0.24), (0.02, 0.26),
              exclude="rack|toilets?"),
    # lamps
    AssetRule("pendant_lamp", "lamp|light|lantern|chandelier", anchor="ceiling", width=(0.1, 0.9),
              depth=(0.1, 0.9), height=(0.3, 1.0), top=(2.3, 3.2), elevation=ANY_SIZE,
              lumens=(700, 1800), category="lamp"),
    AssetRule("ceiling_lamp", "lamp|light|fluorescent", anchor="ceiling", width=(0.15, 1.2),
              depth=(0.1, 0.8), height=(0.03, 0.3), top=(2.3, 3.2), elevation=ANY_SIZE,
              lumens=(1200, 2600), category="lamp"),
    AssetRule("floor_lamp", "lamp|light", anchor="corner", width=(0.15, 0.7), depth=(0.15, 0.7),
              height=(1.2, 1.95), lumens=(600, 1000), exclude="porch|lamppost", category="lamp"),
    AssetRule("table_lamp", "lamp|lantern", anchor="on_top", width=(0.1, 0.46), depth=(0.1, 0.46),
              height=(0.25, 0.85), lumens=(350, 600), exclude="desk|camping|candle",
              category="lamp"),
    AssetRule("desk_lamp", "desk lamp", anchor="on_top", width=(0.08, 0.45), depth=(0.1, 0.45),
              height=(0.25, 0.6), lumens=(300, 500), category="lamp"),
    AssetRule("wall_lamp", "wall lamp|wall light|wall spotlight|sconce", anchor="on_wall",
              width=(0.05, 0.4), depth=(0.05, 0.4), height=(0.08, 0.6), elevation=(1.2, 2.1),
              lumens=(300, 600), category="lamp"),
    # textiles, plants, small objects
    AssetRule("rug", _ON_FLOOR, "rug", "centre", (0.4, 3.2), (0.3, 3.2), (0.001, 0.03)),
    AssetRule("folded_blanket", "folded clothes|blanket", "textile", "on_top", (0.2, 0.5),
              (0.2, 0.5), (0.03, 0.2)),
    AssetRule("plant", _PLANTS, "plant", "corner", (0.2, 0.9), (0.2, 0.9), (0.55, 1.95),
              exclude="vase"),
    AssetRule("small_plant", _PLANTS, "plant", "on_top", (0.06, 0.46), (0.06, 0.46), (0.08, 0.62)),
    AssetRule("vase", "vase|jar", "vase", "on_top", (0.06, 0.36), (0.06, 0.36), (0.08, 0.56)),
    AssetRule("television", "tv|television", "television", "on_top", (0.45, 1.4), (0.05, 0.4),
              (0.35, 0.9), exclude="remote|stand|cabinet|wall"),
    AssetRule("monitor", "imac|computer|monitor", "monitor", "on_top", (0.35, 0.6), (0.1, 0.52),
              (0.3, 0.56)),
    AssetRule("laptop", "laptop|ibook|notebook", "laptop", "on_top", (0.25, 0.42), (0.2, 0.35),
              (0.01, 0.3)),
    AssetRule("books_stack", "book|newspaper|magazine|letter tray", "books", "on_top", (0.15, 0.4),
              (0.12, 0.42), (0.01, 0.14)),
    AssetRule("fruit_bowl", "fruits?|apples|bowl|salad|bread|cake", "bowl", "on_top", (0.12, 0.46),
              (0.12, 0.46), (0.03, 0.24), exclude="box|plate|maker|cup"),
    AssetRule("crockery", _KITCHENWARE, "crockery", "on_top", (0.05, 0.45), (0.05, 0.45),
              (0.02, 0.24), exclude="salad|fruits?|plastic|bathroom|medicine|table|tv|letter"),
    AssetRule("bottle", "bottle|oil servers|milk", "glass", "on_top", (0.05, 0.2), (0.05, 0.2),
              (0.15, 0.37), exclude="spray|baby|medicine|bathroom|flacon"),
    AssetRule("candle", "candle", "candle", "on_top", (0.05, 0.2), (0.05, 0.2), (0.08, 0.46),
              lumens=(10, 40)),
    AssetRule("wall_clock", "cuckoo clock|wall clock", "clock", "on_wall", (0.15, 0.6),
              (0.02, 0.25), (0.15, 0.8), elevation=(0.8, 2.0)),
    AssetRule("radiator", "radiator", "radiator", "on_wall", (0.4, 1.5), (0.05, 0.25), (0.3, 0.66),
              elevation=(0.0, 0.3), exclude="towels?"),
    # kinds that only catalogues have
    AssetRule("desk_thing", r"office\] .*(?:calendar|pen ?box|stapler|scissors|phone|tape|tray|"
              r"marker)|tablet|headphones|glasses|phone|camera|calculator|mobile|mp3|"
              r"clock",
              "clutter", "on_top", (0.02, 0.4), (0.02, 0.4), (0.01, 0.3),
              exclude="sunglasses|cctv|plates?|wine|kitchen|table|surveillance|wall|cuckoo"),
    AssetRule("living_thing", "remote control|joystick|frame|chess|chessboard|deer|radio|glasses|"
              "tablet|dvd player|playstation|game|speaker|mini stereo", "clutter", "on_top",
              (0.02, 0.5), (0.02, 0.42), (0.005, 0.42),
              exclude="plates?|wine|kitchen|table|children|dart|basketball|ball"),
    AssetRule("kitchen_thing",
              r"kitchen\] .*(?:toaster|coffee|blender|mixer|scale|knife stand|bread|"
              r"chopping|spice|sugar|salt|utensils|towel holder|squeezer|sandwich|jar|"
              r"microwave)",
              "clutter", "on_top", (0.03, 0.6), (0.03, 0.45), (0.02, 0.45),
              exclude="knife$|machine$"),
    AssetRule("bedroom_thing",
              r"bedroom\] .*(?:clock|teddy|doll|toy|biplane|puzzle|cube|handbag|cap|"
              r"hat|watch|cards?|xylophone|car)|tissue", "clutter", "on_top", (0.02, 0.42),
              (0.02, 0.42), (0.005, 0.36), exclude="house|changing|wardrobe|rack"),
    AssetRule("bedroom_floor",
              r"bedroom\] .*(?:slippers|sneakers|shoes|teddy|rocking horse|doll house|"
              r"handbag|toy|helmet)|backpack|suitcase|basketball|soccer ball", "clutter", "free",
              (0.15, 1.0), (0.1, 0.7), (0.05, 0.9)),
    AssetRule("living_floor", "guitar|speaker|basket|piano bench|umbrella|rigged fan", "clutter",
              "free", (0.1, 0.7), (0.1, 0.7), (0.25, 1.2), exclude="shopping|clothes|basketball"),
    AssetRule("living_wall", "upright piano|fireplace|aquarium|console", "furniture", "wall",
              (0.6, 1.6), (0.25, 0.6), (0.5, 1.5), front_clearance=0.6),
    AssetRule("study_floor", "filing cabinet|safe|backpack|printer|briefcase|speaker", "furniture",
              "free", (0.2, 0.6), (0.1, 0.6), (0.2, 0.9)),
    AssetRule("kitchen_floor", "trash can|water cooler|dustbin|broom", "furniture", "free",
              (0.2, 0.5), (0.05, 0.5), (0.3, 1.6)),
    AssetRule("bathroom_floor", "clothes basket|potty|laundry|toilet brush|hamper", "furniture",
              "free", (0.09, 0.6), (0.09, 0.6), (0.15, 0.75)),
    AssetRule("wall_switch", "switch|dimmer", "switch", "on_wall", (0.05, 0.2), (0.004, 0.05),
              (0.05, 0.2), elevation=(0.9, 1.3)),
    AssetRule("wall_socket", "plug|socket", "switch", "on_wall", (0.05, 0.2), (0.004, 0.05),
              (0.05, 0.2), elevation=(0.2, 0.5)),
    AssetRule("paper_holder", "toilet paper dispenser", "fitting", "on_wall", (0.08, 0.3),
              (0.05, 0.25), (0.08, 0.3), elevation=(0.4, 1.0)),
)  # fmt: skip
