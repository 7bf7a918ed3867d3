"""What pieces and rooms are, from their names: the categories that all scene sources share.

Names in homes are in any language; the catalogue's identifiers are mostly English, so both are
read. Words of the large European languages are known, too.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

# The first category with a word that occurs; order matters ("bedside table" before "bed").
_PIECES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("rug", ("rug", "carpet", "tapis", "teppich", "alfombra", "tappeto")),
    ("curtain", ("curtain", "curtains", "drape", "drapes", "blind", "blinds", "shutter", "rideau",
                 "rideaux", "vorhang", "cortina", "tenda")),
    ("lamp", ("lamp", "light", "uplight", "downlight", "spotlight", "chandelier", "lantern",
              "sconce", "lampe", "lustre", "leuchte", "lampara", "lampada", "bulb")),
    ("wash basin", ("washbasin", "basin", "lavabo", "waschbecken", "lavandino", "lavatory")),
    ("toilet", ("toilet", "wc", "bidet", "toilettes", "toilette", "inodoro", "urinal")),
    ("bath", ("bath", "bathtub", "tub", "jacuzzi", "baignoire", "badewanne", "banera", "vasca")),
    ("shower", ("shower", "douche", "dusche", "ducha", "doccia")),
    ("washing machine", ("washer", "dryer", "laundry", "washingmachine", "waschmaschine",
                         "lavadora", "lavatrice")),
    ("dishwasher", ("dishwasher", "geschirrspuler", "lavastoviglie")),
    ("microwave", ("microwave",)),
    ("stove", ("cooker", "stove", "oven", "hob", "cooktop", "cuisiniere", "four",
               "herd", "backofen", "cocina", "horno", "forno")),
    ("extractor hood", ("hood", "hotte", "dunstabzug")),
    ("fridge", ("fridge", "refrigerator", "freezer", "frigo", "kuhlschrank", "nevera",
                "frigorifero")),
    ("sink", ("sink", "evier", "spule", "fregadero")),
    ("night table", ("bedside", "nightstand", "nighttable", "chevet", "nachttisch", "comodino")),
    ("cushion", ("pillow", "cushion", "coussin", "oreiller", "kissen")),
    ("bed", ("bed", "bunk", "mattress", "crib", "cradle", "lit", "bett", "cama", "letto")),
    ("armchair", ("armchair", "fauteuil", "sessel", "sillon", "poltrona", "recliner")),
    ("sofa", ("sofa", "couch", "settee", "loveseat", "canape", "divano", "chaise")),
    ("stool", ("stool", "pouf", "tabouret", "hocker", "ottoman", "taburete", "sgabello")),
    ("bench", ("bench", "banc", "bank", "banco")),
    ("chair", ("chair", "chairs", "seat", "stuhl", "silla", "sedia", "chaises")),
    ("desk", ("desk", "workstation", "schreibtisch", "escritorio", "scrivania")),
    ("picture", ("painting", "picture", "poster", "frame", "photo", "canvas", "tableau",
                 "bild", "cuadro", "quadro")),
    ("mirror", ("mirror", "miroir", "spiegel", "espejo", "specchio")),
    ("tv stand", ("tvunit", "tvstand", "tvcabinet")),
    ("television", ("tv", "television", "fernseher", "televisor")),
    ("monitor", ("monitor", "screen", "imac")),
    ("laptop", ("laptop", "notebook", "macbook")),
    ("computer", ("computer", "keyboard", "printer", "ordinateur", "pc")),
    ("wardrobe", ("wardrobe", "closet", "armoire", "schrank", "kleiderschrank", "armario",
                  "armadio")),
    ("bookshelf", ("bookcase", "bookshelf", "bibliotheque", "estanteria", "libreria")),
    ("shelf", ("shelf", "shelves", "rack", "etagere", "regal", "scaffale")),
    ("kitchen unit", ("kitchencabinet", "kitchenuppercabinet", "kitchenunit", "worktop",
                      "counter", "countertop")),
    ("chest", ("chest", "drawer", "drawers", "dresser", "commode", "kommode", "comoda")),
    ("sideboard", ("sideboard", "buffet", "credenza")),
    ("cabinet", ("cabinet", "cupboard", "unit")),
    ("table", ("table", "tables", "tisch", "mesa", "tavolo")),
    ("books", ("book", "books", "magazine", "livre", "livres", "buch")),
    ("plant", ("plant", "plants", "flower", "flowers", "tree", "bush", "bonsai", "cactus", "fern",
               "palm", "plante", "fleur", "fleurs", "pflanze", "blume", "planta", "pianta",
               "grass", "hedge")),
    ("fireplace", ("fireplace", "chimney", "hearth", "cheminee", "kamin", "chimenea", "camino")),
    ("radiator", ("radiator", "heater", "radiateur", "heizkorper", "radiador")),
    ("piano", ("piano", "organ", "keyboardpiano", "klavier")),
    ("stairs", ("stairs", "staircase", "stair", "stairway", "ladder", "steps", "escalier",
                "treppe", "escalera", "scala")),
    ("railing", ("railing", "banister", "balustrade", "fence", "rail", "handrail")),
    ("vase", ("vase", "jarron", "vaso")),
    ("pot", ("pot", "pan")),
    ("kettle", ("kettle", "teapot")),
    ("glass", ("glass", "wineglass", "bottle", "carafe")),
    ("bowl", ("bowl",)),
    ("crockery", ("cup", "mug", "plate", "cutlery", "dish", "fork", "knife", "spoon")),
    ("clock", ("clock", "horloge", "uhr", "reloj", "orologio")),
    ("vehicle", ("car", "bicycle", "motorcycle", "truck", "bike", "scooter")),
    ("person", ("woman", "man", "person", "mannequin", "boy", "girl", "human", "people", "child")),
    ("animal", ("dog", "cat", "bird", "horse", "fish")),
    ("toy", ("toy", "doll", "teddy", "ball", "game")),
    ("instrument", ("guitar", "violin", "drum", "drums")),
    ("bin", ("basket", "bin", "trash", "dustbin", "hamper")),
    ("switch", ("switch", "outlet", "socket", "plug")),
    ("door", ("door", "gate", "porte", "tur", "puerta", "porta", "garagedoor")),
    ("window", ("window", "hatch", "fenetre", "fenster", "ventana", "finestra")),
)  # fmt: skip
_DOORS = ("door", "doors", "gate", "porte", "tur", "puerta", "porta", "doorway", "doorframe",
          "garage")  # fmt: skip
_BUILDING = ("stairs", "railing")
_WHOLE_BUILDING = ("roof", "pillar", "column", "beam", "toit", "dach", "chimneystack")
# Room types: words in a room's name.
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
# Things that make a room, in order of how telling they are.
_TELLING = (
    ("bathroom", ("toilet", "bath", "shower")),
    ("bedroom", ("bed",)),
    ("kitchen", ("stove", "fridge")),
    ("living", ("sofa", "television", "armchair")),
    ("study", ("desk",)),
    ("dining", ("table",)),
)


def category_of(kind: str, name: str, catalog_id: str, model: str = "") -> tuple[str, bool]:
    """The category of a piece and whether it is part of the building.

    `kind` is the element's name; `model` a file name that may tell more.
    """
    identifier = catalog_id.rpartition("#")[2]
    words = _words(identifier) | _words(name)
    if kind == "doorOrWindow":
        return ("door" if words & set(_DOORS) else "window"), True
    if kind == "light":
        return "lamp", False
    for text in (identifier, name, model):
        found = _words(text)
        if found & set(_WHOLE_BUILDING):
            return "structure", True
        for category, hints in _PIECES:
            if found & set(hints):
                return category, category in _BUILDING
    return "other", False


def room_type(name: str, things: Iterable[str]) -> str:
    """The type of a room from its name, else from the categories of what stands in it."""
    plain = _plain(name)
    words = _words(name)
    for kind, hints in _ROOMS:
        if words & set(hints) or any(" " in hint and hint in plain for hint in hints):
            return kind
    inside = set(things)
    for kind, tells in _TELLING:
        if inside & set(tells):
            return kind
    return "other"


def _words(text: str) -> set[str]:
    """Lower-case words without accents; humps and figures separate words, too."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    words = {word for part in (text, spaced) for word in re.findall(r"[a-z]+", _plain(part))}
    # "kitchen cabinet", "kitchenCabinet" and "kitchencabinet" are one word, too.
    return words | {"".join(re.findall(r"[a-z]+", _plain(text)))}


def _plain(text: str) -> str:
    decomposed = unicodedata.normalize("NFKD", text.casefold())
    return "".join(char for char in decomposed if not unicodedata.combining(char))
