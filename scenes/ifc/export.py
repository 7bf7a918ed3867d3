"""Export of an IFC building to plain arrays and JSON, in the child process that holds IfcOpenShell.

`export` writes `building.json` and `points.npy` (F, 3, 3), triangles in metres, Z up, which
`importer.py` reads.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.geom
import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES, MAX_SHAPES

# Classes whose shapes are no surfaces of the building.
_LEFT_OUT = ("IfcAnnotation", "IfcGrid", "IfcVirtualElement", "IfcPort", "IfcStructuralItem",
             "IfcStructuralActivity", "IfcFeatureElementSubtraction")  # fmt: skip
_FAR = 1000.0  # metres from the origin from which a building is moved there
_END, _TAIL = b"END-ISO-10303-21", 4096  # last word of a file, within so many bytes
_MOST_STEPS = 64  # of elements that contain each other
_NO_STOREY = ""


def export(path: str, out: str) -> None:
    """Write the building in the file at `path` to the folder `out`."""
    with Path(path).open("rb") as stream:
        stream.seek(max(0, Path(path).stat().st_size - _TAIL))
        if _END not in stream.read():
            raise InputError(f"{path}: damaged IFC file (it ends without {_END.decode()})")
    try:
        file = ifcopenshell.open(path)
    except Exception as error:  # the parser raises its own types
        raise InputError(f"{path}: damaged IFC file ({_one_line(error)})") from None
    if not isinstance(file, ifcopenshell.file) or not file.by_type("IfcProject"):
        raise InputError(f"{path}: damaged IFC file, or one without a project")
    _complete(file)
    products = {one.id(): one for one in file.by_type("IfcProduct") if one.Representation}
    chosen = [one for one in products.values() if not any(_is_a(one, name) for name in _LEFT_OUT)]
    elements: list[dict[str, Any]] = []
    pieces: list[Float64Array] = []
    triangles = 0
    materials: dict[tuple[Any, ...], int] = {}
    seen = set()
    for shape in _shapes(file, chosen):
        seen.add(shape.id)
        product = products[shape.id]
        corners, numbers, styles = _triangles(shape)
        if not len(corners):
            continue
        ranges = []
        for number in np.unique(numbers).tolist():
            chosen_faces = corners[numbers == number]
            key = _style(styles[number]) if 0 <= number < len(styles) else None
            material = -1 if key is None else materials.setdefault(key, len(materials))
            ranges.append((triangles, triangles + len(chosen_faces), material))
            pieces.append(chosen_faces)
            triangles += len(chosen_faces)
        if triangles > MAX_SCENE_TRIANGLES or len(elements) >= MAX_SHAPES:
            raise InputError(
                f"{path}: the file has more than the limit of {MAX_SCENE_TRIANGLES:,} triangles "
                f"or {MAX_SHAPES:,} elements"
            )
        elements.append({**_description(product), "ranges": ranges})
    points = np.concatenate(pieces) if pieces else np.zeros((0, 3, 3))
    shift = _shift(points)
    np.save(Path(out) / "points.npy", points + shift)
    openings = [one for one in products.values() if one.is_a("IfcOpeningElement")]
    seen |= {shape.id for shape in _shapes(file, openings)}
    lost = Counter(one.is_a() for one in (*chosen, *openings) if one.id() not in seen)
    result = {
        "schema": str(file.schema),
        "elements": elements,
        "materials": [list(key) for key in materials],
        "shift": shift.tolist(),
        "lost": dict(sorted(lost.items())),
        "author": _author(file),
    }
    (Path(out) / "building.json").write_text(json.dumps(result, allow_nan=False))


def _complete(file: Any) -> None:
    """Give shapes without a context that of the model: the kernel passes others over, unsaid."""
    context = next(
        (one for one in file.by_type("IfcGeometricRepresentationContext")
         if not one.is_a("IfcGeometricRepresentationSubContext")), None,
    )  # fmt: skip
    for shape in file.by_type("IfcShapeRepresentation") if context is not None else ():
        if shape.ContextOfItems is None:
            shape.ContextOfItems = context


def _shapes(file: Any, products: list[Any]) -> Any:
    """Yield the shapes of products in the order of their numbers, in metres and the world's axes.

    Openings are cut out of walls. What the kernel cannot make is left out.
    """
    if not products:
        return
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    iterator = ifcopenshell.geom.iterator(settings, file, 1, include=products)
    made = []
    if iterator.initialize():
        while True:
            made.append(iterator.get())
            if not iterator.next():
                break
    yield from sorted(made, key=lambda shape: int(shape.id))


def _triangles(shape: Any) -> tuple[Float64Array, Int64Array, list[Any]]:
    """Corners (F, 3, 3), the number of the style of each face (F,), and the styles."""
    geometry = shape.geometry
    vertices = np.array(geometry.verts, dtype=np.float64).reshape(-1, 3)
    faces = np.array(geometry.faces, dtype=np.int64).reshape(-1, 3)
    numbers = np.array(geometry.material_ids, dtype=np.int64)
    if len(numbers) != len(faces):
        numbers = np.full(len(faces), -1, dtype=np.int64)
    if len(faces) and (not np.isfinite(vertices).all() or faces.max() >= len(vertices)):
        return np.zeros((0, 3, 3)), numbers[:0], []
    return vertices[faces], numbers, list(geometry.materials)


def _style(style: Any) -> tuple[Any, ...] | None:
    """Name, colour (sRGB) and transparency of a style; None for one without a colour."""
    shown = style.get_color()
    color = [float(shown.r()), float(shown.g()), float(shown.b())]
    if not all(0 <= value <= 1 for value in color):
        return None
    opaque = not style.has_transparency() or not 0 <= style.transparency <= 1
    name = str(style.name)
    return (name[:100], *color, 0.0 if opaque else float(style.transparency))


def _description(product: Any) -> dict[str, Any]:
    kind = next((one.RelatingType for one in getattr(product, "IsTypedBy", ()) or ()), None)
    return {
        "class": product.is_a(),
        "guid": str(product.GlobalId),
        "name": _text(product, "Name"),
        "long_name": _text(product, "LongName"),
        "labels": [_text(product, "ObjectType"), _text(kind, "Name")],
        "predefined": _text(product, "PredefinedType") or _text(kind, "PredefinedType"),
        "storey": _storey(product),
        "part_of": _whole(product),
    }


def _text(item: Any, name: str) -> str:
    value = getattr(item, name, None)
    return str(value)[:200] if value else ""


def _storey(product: Any) -> str:
    """Name of the storey that contains a product, directly or through what it is a part of."""
    at = product
    for _ in range(_MOST_STEPS):
        if at is None:
            break
        if at.is_a("IfcBuildingStorey"):
            return _text(at, "Name") or f"storey {at.id()}"
        at = _above(at)
    return _NO_STOREY


def _above(item: Any) -> Any:
    for relations, attribute in (
        ("ContainedInStructure", "RelatingStructure"),
        ("Decomposes", "RelatingObject"),
        ("FillsVoids", "RelatingOpeningElement"),
        ("VoidsElements", "RelatingBuildingElement"),
    ):
        for relation in getattr(item, relations, ()) or ():
            return getattr(relation, attribute, None)
    return None


def _whole(product: Any) -> str:
    """Id of the element that a product is a part of, such as the stairs of a flight; else ""."""
    for relation in getattr(product, "Decomposes", ()) or ():
        whole = getattr(relation, "RelatingObject", None)
        if whole is not None and whole.is_a("IfcElement"):
            return str(whole.GlobalId)
    return ""


def _is_a(product: Any, name: str) -> bool:
    try:
        return bool(product.is_a(name))
    except RuntimeError:  # a class of another schema
        return False


def _shift(points: Float64Array) -> Float64Array:
    """Whole metres (3,) that bring a far building near the origin; zero for others."""
    if not len(points):
        return np.zeros(3)
    middle = np.median(points.reshape(-1, 3), axis=0)
    return np.where(np.abs(middle) > _FAR, -np.round(middle), 0.0)


def _author(file: Any) -> str:
    authors = [str(name) for name in (file.header.file_name.author or ()) if name]
    return ", ".join(authors)[:200]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
