"""Conversion of own pieces: read, turned, scaled to the table's size, checked and written."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.assets.index import OWN_TABLE, Asset, index_entry
from pbrnet.scenes.assets.piece import CataloguePiece
from pbrnet.scenes.color import REC709
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import creased
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.importer import ModelReader
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.models.options import READERS
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.own_assets.checks import check_scale, check_stretch, note_unsound
from pbrnet.scenes.own_assets.finishes import finish_of, image_transform, read_image
from pbrnet.scenes.own_assets.table import OwnPiece
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.sweethome.catalogue.convert import PieceJob, counted_triangles, write_asset
from pbrnet.scenes.sweethome.catalogue.library import UnusablePiece
from pbrnet.scenes.sweethome.catalogue.pieces import convert_piece
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, area, merge_parts

_CREASE = 40.0  # degrees between faces whose edge stays sharp, where a file states no normals
_FLAT = 1e-3  # units; a model as flat as a rug has no proportion to keep
_USUAL_UP, _USUAL_LUMENS = "y", 600.0  # of files that state none


def convert_any(job: PieceJob) -> dict[str, Any]:
    """Convert a piece of any catalogue on a worker; a refusal is a result, not a failure."""
    if job.source.name != OWN_TABLE:
        return convert_piece(job)
    try:
        return {"usable": index_entry(convert_own(job))}
    except UnusablePiece as reason:
        return {"refused": str(reason)}


def convert_own(job: PieceJob) -> Asset:
    """Write a piece of a table; raises `UnusablePiece` with the reason."""
    changes, row = Changes(), job.piece
    assert isinstance(row, OwnPiece)
    with tempfile.TemporaryDirectory(prefix="pbrnet-piece-") as name:
        folder = Path(name)
        model = _model(job.source.parent / row.model, folder, changes)
        triangles = counted_triangles([shape.mesh for shape in model.shapes], job)
        frame, size = _frame(model, row, changes)
        check_scale(row.category, size, changes)
        piece = _described(row, size)
        parts = merge_parts(tuple(_parts(model, frame, row, changes)))
        if not parts:
            raise UnusablePiece("nothing of its model is visible")
        note_unsound([part.mesh for part in parts], row.elevation, changes)
        read = partial(read_image, folder)
        return write_asset(job, piece, parts, triangles, 0.0, read, changes)


def _described(row: OwnPiece, size: Float64Array) -> CataloguePiece:
    """The piece as a catalogue describes it, with the size of the converted model."""
    width, depth, height = (round(float(side), 4) for side in size)
    known = {one.name: getattr(row, one.name) for one in fields(CataloguePiece)}
    return CataloguePiece(**{**known, "size": (width, depth, height), "drop": height})


def _model(path: Path, folder: Path, changes: Changes) -> Model:
    reader: ModelReader = resolve_name(READERS[path.suffix.lower()])
    opened = OpenedFiles(path.parent)
    for name in ("textures", "unpacked"):
        (folder / name).mkdir()
    textures = TextureStore(folder / "textures", changes)
    try:
        model = reader(path, Sandbox(opened), textures, folder / "unpacked", changes)
    except InputError as error:
        raise UnusablePiece(f"its model {error}") from None
    if not model.shapes:
        raise UnusablePiece("its model has no surfaces")
    if not all(np.isfinite(shape.mesh.vertices).all() for shape in model.shapes):
        raise UnusablePiece("its model holds numbers that are not finite")
    return model


def _frame(model: Model, row: OwnPiece, changes: Changes) -> tuple[Float64Array, Float64Array]:
    """The map (4, 4) of the model to the asset's frame, and the size (3,) there, metres."""
    turn = np.eye(4)
    turn[:3, :3] = _turn(row.up or model.up or _USUAL_UP, row.front)
    turned = [shape.mesh.transformed(turn) for shape in model.shapes]
    bounds = np.array([mesh.bounds for mesh in turned])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    extent = high - low
    if (extent[:2] <= 0).any():
        raise UnusablePiece("its model has no extent on the plan")
    scale = np.ones(3)
    scale[:2] = np.array(row.size[:2]) / extent[:2]
    scale[2] = row.size[2] / extent[2] if row.size[2] and extent[2] else float(scale[:2].mean())
    check_stretch(scale[extent > _FLAT], changes)
    place = np.diag([*scale, 1.0])
    place[:3, 3] = -scale * [*(0.5 * (low + high)[:2]), low[2]]
    return place @ turn, scale * extent


def _turn(up: str, front: str) -> Float64Array:
    """The rotation (3, 3) that brings the axis `up` to +Z, and the front to -Y."""
    axes = dict(zip("xyz", np.eye(3), strict=True))
    axes |= {f"-{name}": -axis for name, axis in list(axes.items())}
    usual = {"y": "z", "z": "-y", "x": "y"}
    back = -axes[front or usual[up]]
    if abs(float(back @ axes[up])) > 0.5:
        raise UnusablePiece(f"front {front} is the axis that points up in its model")
    return np.stack([np.cross(back, axes[up]), back, axes[up]])


def _parts(model: Model, frame: Float64Array, row: OwnPiece, changes: Changes) -> list[ItemPart]:
    made = []
    for shape in model.shapes:
        finish = finish_of(shape.surface, changes)
        if finish is None:
            continue
        mesh = shape.mesh.transformed(frame)
        to_uv = image_transform(shape.surface)
        if mesh.uvs is not None and to_uv is not None:
            flat = np.c_[mesh.uvs, np.zeros(len(mesh.uvs)), np.ones(len(mesh.uvs))]
            mesh = replace(mesh, uvs=(flat @ to_uv.T)[:, :2])
        if finish.image is None or mesh.uvs is None:
            mesh, finish = replace(mesh, uvs=None), replace(finish, image=None)
        if mesh.normals is None:
            mesh = creased(mesh, _CREASE)
        made.append(ItemPart(mesh, finish, emits=shape.id in model.emissions))
    return _lit(made, row, changes)


def _lit(parts: Sequence[ItemPart], row: OwnPiece, changes: Changes) -> list[ItemPart]:
    """The parts, those of lamps that emit with the flux of the table over their whole area."""
    if row.category != "lamp":
        return [replace(part, emits=False) for part in parts]
    surface = sum(area(part.mesh) for part in parts if part.emits)
    if not surface:
        changes.note("no surface of the lamp emits light; it stays dark")
        return list(parts)
    level = (row.lumens or _USUAL_LUMENS) * LUMEN / (np.pi * surface) / sum(REC709)
    return [replace(part, radiance=(level, level, level)) if part.emits else part for part in parts]
