"""Categories of objects and types of rooms from their names: one table for all scene sources.

A name is split into lower-case words without accents; neighbouring words also count as one, and
plurals also as singulars. The first category of `_CATEGORIES` that has one of the words wins.
The table knows English and words of other large European languages.

To teach the importers a word, add it to its category in `_CATEGORIES` (or to `_ROOMS` for the
name of a room): lower case, singular, without accents, and without a space if it is two words
("washbasin"). A new category is a new line; put it before categories whose words also occur in
its names ("bedside table" before "bed").
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise

_REMEMBERED = 1 << 16  # labels whose category is remembered

# (category, words) by precedence.
_CATEGORIES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("rug", ("rug", "carpet", "mat", "tapis", "teppich", "alfombra", "tappeto")),
    ("curtain", ("curtain", "drape", "blind", "shutter", "rideau", "rideaux", "vorhang", "cortina",
                 "tenda")),
    ("lamp", ("lamp", "light", "uplight", "downlight", "spotlight", "chandelier", "lantern",
              "sconce", "lampe", "lustre", "leuchte", "lampara", "lampada", "bulb")),
    ("wash basin", ("washbasin", "basin", "lavabo", "waschbecken", "lavandino", "lavatory")),
    ("toilet", ("toilet", "wc", "bidet", "toilette", "inodoro", "urinal")),
    ("shower", ("shower", "douche", "dusche", "ducha", "doccia")),
    ("towel rail", ("towelrail", "towelrack")),
    ("bath", ("bath", "bathtub", "tub", "jacuzzi", "baignoire", "badewanne", "banera", "vasca")),
    ("washing machine", ("washer", "dryer", "laundry", "washingmachine", "waschmaschine",
                         "lavadora", "lavatrice")),
    ("dishwasher", ("dishwasher", "geschirrspuler", "lavastoviglie")),
    ("microwave", ("microwave", "mikrowelle", "microonda")),
    ("stove", ("cooker", "stove", "oven", "hob", "cooktop", "cuisiniere", "herd", "backofen",
               "cocina", "horno", "forno")),
    ("extractor hood", ("hood", "hotte", "dunstabzug")),
    ("fridge", ("fridge", "refrigerator", "freezer", "frigo", "kuhlschrank", "nevera",
                "frigorifero")),
    ("sink", ("sink", "tap", "faucet", "evier", "spule", "fregadero")),
    ("night table", ("bedside", "nightstand", "nighttable", "chevet", "nachttisch", "comodino")),
    ("cushion", ("pillow", "cushion", "coussin", "oreiller", "kissen")),
    ("bed", ("bed", "bunk", "mattress", "duvet", "blanket", "headboard", "bedframe", "crib",
             "cradle", "lit", "bett", "cama", "letto")),
    ("armchair", ("armchair", "fauteuil", "sessel", "sillon", "poltrona", "recliner")),
    ("sofa", ("sofa", "couch", "settee", "loveseat", "canape", "divano", "chaise")),
    ("stool", ("stool", "pouf", "tabouret", "hocker", "ottoman", "taburete", "sgabello")),
    ("bench", ("bench", "banc", "bank", "banco")),
    ("chair", ("chair", "seat", "seating", "stuhl", "silla", "sedia", "chaises")),
    ("desk", ("desk", "workstation", "workplace", "schreibtisch", "escritorio", "scrivania")),
    ("picture", ("painting", "picture", "poster", "photo", "canvas", "artwork", "tableau",
                 "bild", "cuadro", "quadro")),
    ("mirror", ("mirror", "miroir", "spiegel", "espejo", "specchio")),
    ("tv stand", ("tvunit", "tvstand", "tvcabinet", "tvtable")),
    ("television", ("tv", "television", "fernseher", "televisor")),
    ("monitor", ("monitor", "screen", "imac")),
    ("laptop", ("laptop", "notebook", "macbook")),
    ("computer", ("computer", "keyboard", "printer", "ordinateur", "pc")),
    ("wardrobe", ("wardrobe", "closet", "armoire", "schrank", "kleiderschrank", "armario",
                  "armadio")),
    ("bookshelf", ("bookcase", "bookshelf", "bookshelve", "bibliotheque", "estanteria",
                   "libreria")),
    ("shelf", ("shelf", "shelve", "shelving", "rack", "etagere", "regal", "scaffale")),
    ("kitchen unit", ("kitchencabinet", "kitchenuppercabinet", "kitchenunit", "kitchenset",
                      "worktop", "counter", "countertop")),
    ("chest", ("chest", "drawer", "dresser", "commode", "kommode", "comoda")),
    ("sideboard", ("sideboard", "buffet", "credenza")),
    ("cabinet", ("cabinet", "cupboard", "unit")),
    ("table", ("table", "tisch", "mesa", "tavolo")),
    ("books", ("book", "magazine", "livre", "buch", "bucher", "libro")),
    ("vase", ("vase", "jarron", "vaso")),
    ("plant", ("plant", "flower", "tree", "bush", "bonsai", "cactus", "fern", "palm", "leaf",
               "leave", "branch", "stem", "soil", "dirt", "plante", "fleur", "pflanze", "blume",
               "planta", "pianta", "grass", "hedge")),
    ("fireplace", ("fireplace", "chimney", "hearth", "mantel", "cheminee", "kamin", "chimenea",
                   "camino")),
    ("radiator", ("radiator", "heater", "radiateur", "heizkorper", "radiador")),
    ("piano", ("piano", "organ", "keyboardpiano", "klavier")),
    ("stairs", ("stair", "staircase", "stairway", "ladder", "step", "escalier", "treppe",
                "escalera", "scala")),
    ("railing", ("railing", "banister", "balustrade", "fence", "rail", "handrail")),
    ("pot", ("pot", "pan")),
    ("kettle", ("kettle", "teapot")),
    ("glass", ("glass", "wineglass", "bottle", "bottlecap", "decanter", "carafe")),
    ("bowl", ("bowl",)),
    ("crockery", ("cup", "mug", "plate", "cutlery", "dish", "fork", "knife", "spoon")),
    ("clock", ("clock", "horloge", "uhr", "reloj", "orologio")),
    ("candle", ("candle", "candlestick", "bougie", "kerze")),
    ("vehicle", ("car", "bicycle", "motorcycle", "truck", "bike", "scooter")),
    ("person", ("woman", "man", "person", "mannequin", "boy", "girl", "human", "people", "child")),
    ("animal", ("dog", "cat", "bird", "horse", "fish")),
    ("toy", ("toy", "doll", "teddy", "ball", "game")),
    ("instrument", ("guitar", "violin", "drum")),
    ("bin", ("basket", "bin", "trash", "dustbin", "hamper")),
    ("box", ("box", "carton", "schachtel", "caja", "scatola")),
    ("switch", ("switch", "outlet", "socket", "plug")),
    ("door", ("door", "gate", "porte", "tur", "puerta", "porta", "garagedoor")),
    ("window", ("window", "sash", "glazing", "hatch", "fenetre", "fenster", "ventana",
                "finestra")),
)  # fmt: skip
CATEGORIES = tuple(category for category, _ in _CATEGORIES)
_CATEGORY_OF_WORD = {
    hint: (rank, category)
    for rank, (category, hints) in reversed(list(enumerate(_CATEGORIES)))
    for hint in (category.replace(" ", ""), *hints)
}
_DOORS = ("door", "doors", "gate", "porte", "tur", "puerta", "porta", "doorway", "doorframe",
          "garage")  # fmt: skip
_BUILDING = ("stairs", "railing")
_WHOLE_BUILDING = ("roof", "pillar", "column", "beam", "toit", "dach", "chimneystack")
# (type of room, words in its name) by precedence.
_ROOMS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("bathroom", ("bathroom", "bath", "toilet", "toilets", "wc", "shower", "restroom", "powder",
                  "salle de bain", "salle de bains", "sdb", "bad", "badezimmer", "bano", "bagno",
                  "banheiro", "lavatory", "ensuite", "toilettes")),
    ("kitchen", ("kitchen", "kitchenette", "cuisine", "kuche", "cocina", "cucina", "cozinha")),
    ("dining", ("dining", "diningroom", "dinning", "salle a manger", "esszimmer", "comedor",
                "sala da pranzo")),
    ("study", ("study", "office", "library", "bureau", "arbeitszimmer", "buro", "despacho",
               "oficina", "studio")),
    ("living", ("living", "livingroom", "lounge", "sitting", "salon", "sejour", "wohnzimmer",
                "sala", "soggiorno", "family", "parlor", "drawing", "saloon", "tv")),
    ("bedroom", ("bedroom", "bed", "nursery", "chambre", "schlafzimmer", "kinderzimmer",
                 "dormitorio", "habitacion", "camera", "quarto", "guest", "children", "kids")),
)  # fmt: skip
# (type of room, categories of objects that show it) by precedence.
_ROOM_FURNITURE = (
    ("bathroom", ("toilet", "bath", "shower")),
    ("bedroom", ("bed",)),
    ("kitchen", ("stove", "fridge")),
    ("living", ("sofa", "television", "armchair", "fireplace")),
    ("study", ("desk",)),
    ("dining", ("table",)),
)


def category_of(*labels: str) -> str:
    """Return the category of the first of `labels` that tells one, else "other"."""
    return next((found for found in map(_category, labels) if found), "other")


@lru_cache(_REMEMBERED)
def _category(label: str) -> str:
    """The category that one label tells, or ""."""
    ranked = [_CATEGORY_OF_WORD[word] for word in words_of(label) if word in _CATEGORY_OF_WORD]
    return min(ranked)[1] if ranked else ""


def category_of_piece(kind: str, name: str, catalog_id: str, model: str = "") -> tuple[str, bool]:
    """Return the category of a piece of a home, and whether it is part of the building.

    `kind` is the tag of its element, `catalog_id` its identifier in a catalogue, and `model` the
    name of its model file.
    """
    identifier = catalog_id.rpartition("#")[2]
    if kind == "doorOrWindow":
        words = words_of(identifier) | words_of(name)
        return ("door" if words & set(_DOORS) else "window"), True
    if kind == "light":
        return "lamp", False
    for text in (identifier, name, model):
        if words_of(text) & set(_WHOLE_BUILDING):
            return "structure", True
        category = category_of(text)
        if category != "other":
            return category, category in _BUILDING
    return "other", False


def room_type(name: str, categories: Iterable[str]) -> str:
    """Return the type of a room from its name, else from the categories of its objects."""
    plain = _plain(name)
    words = words_of(name)
    for kind, hints in _ROOMS:
        if words & set(hints) or any(" " in hint and hint in plain for hint in hints):
            return kind
    squeezed = "".join(re.findall(r"[a-z]+", plain))
    for kind, _ in _ROOMS:
        if kind in squeezed:
            return kind
    inside = set(categories)
    for kind, tells in _ROOM_FURNITURE:
        if inside & set(tells):
            return kind
    return "other"


def words_of(text: str) -> set[str]:
    """Return a text's lower-case words without accents, neighbours as one word, and singulars.

    Capitals inside a word and digits separate words, too.
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    found: set[str] = set()
    for part in (text, spaced):
        words = re.findall(r"[a-z]+", _plain(part))
        found.update(words, map("".join, pairwise(words)), ["".join(words)])
    return found | {one for word in found for one in _singulars(word)}


def _singulars(word: str) -> tuple[str, ...]:
    if len(word) < 4 or not word.endswith("s") or word.endswith("ss"):
        return ()
    return (word[:-1], word[:-2]) if word.endswith("es") else (word[:-1],)


def _plain(text: str) -> str:
    if text.isascii():
        return text.casefold()
    decomposed = unicodedata.normalize("NFKD", text.casefold())
    return "".join(char for char in decomposed if not unicodedata.combining(char))
