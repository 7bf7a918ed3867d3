"""Conversion of a catalogue piece to an asset: meshes, textures, measures and checks.

Model, sizes and finishes follow the rules of the application, as in the importer of homes; here
a single piece is placed at the origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.assets import preview
from pbrnet.scenes.assets.free_space import SupportSurface, covering_boxes, support_surfaces
from pbrnet.scenes.assets.index import (
    PREVIEW,
    Asset,
    AssetPart,
    Checks,
    Point3,
    Provenance,
    save_asset,
)
from pbrnet.scenes.assets.piece import CataloguePiece, LightSource
from pbrnet.scenes.color import REC709, encode_srgb
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_directory, digest_bytes
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.model_parts import Model, UnreadableModel
from pbrnet.scenes.formats.ply import read_ply, write_ply
from pbrnet.scenes.geometry.mesh import Mesh, creased
from pbrnet.scenes.image_files import eight_bits, open_image
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.photometry import LUMEN, color_temperature
from pbrnet.scenes.sweethome import home
from pbrnet.scenes.sweethome.catalogue.library import UnusablePiece
from pbrnet.scenes.sweethome.furnishing import furniture
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, SurfaceFinish, area, merge_parts
from pbrnet.scenes.sweethome.furnishing.lamps import lit_parts
from pbrnet.scenes.sweethome.furnishing.models import read_model

_MAX_IMAGE = 64 * 2**20  # bytes
_SIZE_TOLERANCE = 0.01  # of a side
_THINNEST = 0.001  # metres; flat things are no thicker than their own description says
_POWER = 0.5  # of a lamp, the application's usual one
_FROSTED_WHITE = SurfaceFinish(color=(0.8, 0.79, 0.76))


@dataclass(frozen=True)
class PieceJob:
    """A piece of a catalogue file that is to be converted to the folder `out`.

    `texture_size` bounds the longer side of its images, in pixels.
    """

    source: Path
    piece: CataloguePiece
    out: Path
    provenance: Provenance
    fingerprint: str
    max_triangles: int
    texture_size: int


def convert(job: PieceJob) -> Asset:
    """Write a piece of a `.sh3f`; raises `UnusablePiece` with the reason."""
    changes, piece = Changes(), job.piece
    with HomeArchive(job.source) as archive:
        model = _model(archive, piece, changes)
        triangles = counted_triangles([part.mesh for part in model.parts], job)
        parts = _standing(piece, model, changes)
        error = _checked(piece, parts)
        read = partial(archive.read, limit=_MAX_IMAGE)
        return write_asset(job, piece, parts, triangles, error, read, changes)


def counted_triangles(meshes: Sequence[Mesh], job: PieceJob) -> int:
    """Return the triangles of meshes; raises `UnusablePiece` above the job's limit."""
    triangles = sum(len(mesh.faces) for mesh in meshes)
    if triangles > job.max_triangles:
        most = job.max_triangles
        raise UnusablePiece(f"{triangles:,} triangles; assets.max_triangles is {most:,}")
    return triangles


def write_asset(
    job: PieceJob,
    piece: CataloguePiece,
    parts: Sequence[ItemPart],
    triangles: int,
    size_error: float,
    read_image: Callable[[str], bytes],
    changes: Changes,
) -> Asset:
    """Write the folder of a converted piece, and return its description.

    `parts` are in the asset's frame (`assets/index.py`); `triangles` are those of the model,
    `size_error` is in metres, and `read_image` returns the file of a finish's image.
    """
    with atomic_directory(job.out) as folder:
        (folder / "meshes").mkdir()
        (folder / "textures").mkdir()
        images = _Images(read_image, folder, job.texture_size, changes)
        made = [_write(folder, number, part, images) for number, part in enumerate(parts)]
        corners = np.concatenate([_mesh(part).corners for part in parts])
        asset = Asset(
            piece=piece,
            parts=tuple(made),
            boxes=tuple((_point(low), _point(high)) for low, high in covering_boxes(corners)),
            levels=_levels(piece, corners),
            checks=Checks(
                triangles=sum(part.triangles for part in made),
                dropped=max(0, triangles - sum(len(part.mesh.faces) for part in parts)),
                size_error=round(size_error, 5),
                textures=images.count,
                notes=changes.sentences(),
            ),
            provenance=job.provenance,
            fingerprint=job.fingerprint,
        )
        _draw(folder, asset)
        save_asset(folder, asset)
    return asset


def _draw(folder: Path, asset: Asset) -> None:
    """The piece's picture, from the files just written."""
    parts = []
    for part in asset.parts:
        texture = None
        if part.texture:
            small = open_image(folder / part.texture).convert("RGB")
            small.thumbnail((preview.SIZE, preview.SIZE), Image.Resampling.BOX)
            texture = np.asarray(small)
        linear = np.array(part.color)
        parts.append((read_ply(folder / part.mesh), encode_srgb(linear), texture))
    Image.fromarray(preview.draw_preview(parts)).save(folder / PREVIEW, compress_level=6)


def _model(archive: HomeArchive, piece: CataloguePiece, changes: Changes) -> Model:
    """Return the model of a piece: a file in the catalogue, or in a zip inside it."""
    try:
        return read_model(archive, piece.model, changes)
    except (UnreadableModel, InputError) as error:
        raise UnusablePiece(f"its model {piece.model}: {error}") from None


def _standing(piece: CataloguePiece, model: Model, changes: Changes) -> list[ItemPart]:
    """Return the parts in the local frame, merged by finish; those of lamps emit light."""
    width, depth, height = (100 * side for side in piece.size)
    described = home.HomePiece(
        id=piece.key,
        kind="light" if piece.lights else "doorOrWindow" if piece.opening else "pieceOfFurniture",
        name=piece.name,
        catalog_id=piece.id,
        creator=piece.creator,
        level=None,
        model=piece.model,
        x=0.0,
        y=0.0,
        elevation=0.0,
        width=width,
        depth=depth,
        height=height,
        angle=0.0,
        rotation=piece.rotation,
        power=_POWER if piece.lights else 0.0,
        bulbs=_bulbs(piece),
    )
    stood = furniture.place_piece(described, model, 0.0, changes)
    if not stood.parts:
        raise UnusablePiece("nothing of its model is visible")
    if not piece.lights:
        return merge_parts(stood.parts)
    lit, _ = lit_parts(described, stood.parts, stood.to_world, Changes())
    if not lit or np.abs(_extent(lit) - _extent(stood.parts)).max() > _THINNEST:
        # `lit_parts` leaves out clear glass around a bulb. Make the shade frosted to keep it.
        opal = [
            replace(part, finish=_FROSTED_WHITE) if part.finish.kind in ("glass", "sheer") else part
            for part in stood.parts
        ]
        changes.note("the clear shade of a lamp became opal glass")
        stood = replace(stood, parts=tuple(opal))
    lit, _ = lit_parts(described, stood.parts, stood.to_world, changes)
    return merge_parts(lit)


def _extent(parts: Sequence[ItemPart]) -> Float64Array:
    """Return the size (3,) of the bounds of all parts."""
    bounds = np.array([part.mesh.bounds for part in parts if part.sphere is None])
    return np.asarray(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0))


def _bulbs(piece: CataloguePiece) -> tuple[LightSource, ...]:
    """Return the light sources of a piece; if any lies outside it, one in its centre instead.

    Some catalogues place light sources outside the lamp, as the application never shows them.
    """
    bulbs = piece.lights
    if all(0 <= place <= 1 for bulb in bulbs for place in (bulb.x, bulb.y, bulb.z)):
        return bulbs
    middle = float(np.clip(np.mean([bulb.z for bulb in bulbs]), 0.1, 0.9))
    return (replace(bulbs[0], x=0.5, y=0.5, z=middle),)


def _checked(piece: CataloguePiece, parts: list[ItemPart]) -> float:
    """Return the largest relative error of the size; raises `UnusablePiece` for unsound meshes."""
    for part in parts:
        mesh = part.mesh
        tables = [table for table in (mesh.vertices, mesh.normals, mesh.uvs) if table is not None]
        if not all(np.isfinite(table).all() for table in tables):
            raise UnusablePiece("its model holds numbers that are not finite")
    size = _extent(parts)
    error = np.abs(size - np.array(piece.size))
    allowed = np.maximum(_SIZE_TOLERANCE * np.array(piece.size), _THINNEST)
    if (error > allowed).any():
        measured = " x ".join(f"{side:.3f}" for side in size)
        wanted = " x ".join(f"{side:.3f}" for side in piece.size)
        raise UnusablePiece(f"its model comes out at {measured} m, the catalogue says {wanted} m")
    return float(error.max())


def _mesh(part: ItemPart) -> Mesh:
    """Return the mesh of a part; spheres of bulbs are triangulated."""
    if part.sphere is None:
        return part.mesh
    centre, radius = part.sphere
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    vertices = np.asarray(sphere.vertices) + centre
    return Mesh(vertices, np.asarray(sphere.faces), (vertices - centre) / radius)


def _write(folder: Path, number: int, part: ItemPart, images: _Images) -> AssetPart:
    mesh, finish = _mesh(part), part.finish
    if mesh.normals is None:
        mesh = creased(mesh, 0.0)
    texture, alpha = images.of(finish)
    if texture is None:
        mesh = replace(mesh, uvs=None)
    name = f"meshes/{number}.ply"
    write_ply(folder / name, mesh)
    lumens, kelvin = _light(part, mesh)
    # A bulb that is off is white glass; `lit_parts` makes bulbs black emitters.
    color = (0.8, 0.8, 0.78) if part.sphere is not None else finish.color
    return AssetPart(
        mesh=name,
        kind=finish.kind,
        color=_point(np.array(color)),
        roughness=round(finish.roughness, 4),
        opacity=finish.opacity,
        texture=texture,
        alpha=alpha,
        lumens=lumens,
        kelvin=kelvin,
        triangles=len(mesh.faces),
    )


def _light(part: ItemPart, mesh: Mesh) -> tuple[float, float]:
    """Return luminous flux (lm) and colour temperature (K) of a part; (0, 0) without emission."""
    if part.radiance is None:
        return 0.0, 0.0
    luminance = float(np.dot(part.radiance, REC709))
    # The mesh of a bulb is its bounding octahedron; the radiance is that of the sphere.
    surface = area(mesh) if part.sphere is None else 4 * np.pi * part.sphere[1] ** 2
    return round(luminance * np.pi * surface / LUMEN, 2), round(color_temperature(part.radiance))


class _Images:
    """Stores the images of one piece in its folder, each once, scaled down to a largest size."""

    def __init__(
        self, read: Callable[[str], bytes], folder: Path, size: int, changes: Changes
    ) -> None:
        self._read, self._folder, self._size = read, folder, size
        self._changes = changes
        self._stored: dict[str, tuple[str | None, str | None]] = {}

    @property
    def count(self) -> int:
        """Number of stored images."""
        return sum(color is not None for color, _ in self._stored.values())

    def of(self, finish: SurfaceFinish) -> tuple[str | None, str | None]:
        """Return the files of colour and alpha of a finish; None for each that is absent."""
        if finish.image is None:
            return None, None
        if finish.image not in self._stored:
            try:
                self._stored[finish.image] = self._store(finish.image)
            except (InputError, OSError, ValueError, MemoryError) as error:
                self._changes.note(
                    "images that cannot be read gave way to plain colour: {}",
                    f"{finish.image} ({error})",
                )
                self._stored[finish.image] = (None, None)
        return self._stored[finish.image]

    def _store(self, member: str) -> tuple[str, str | None]:
        data = self._read(member)
        image = open_image(data)
        name = f"textures/{len(self._stored)}"
        small = max(image.size) <= self._size
        if image.format == "JPEG" and image.mode in ("RGB", "L") and small:
            (self._folder / f"{name}.jpg").write_bytes(data)
            return f"{name}.jpg", None
        has_alpha = "A" in image.getbands() or "transparency" in image.info
        full = eight_bits(image).convert("RGBA" if has_alpha else "RGB")
        full.thumbnail((self._size, self._size), Image.Resampling.BOX)
        alpha = None
        if has_alpha and np.asarray(full.getchannel("A")).min() < 255:
            alpha = f"{name}-alpha.png"
            full.getchannel("A").save(self._folder / alpha, compress_level=6)
        if image.format == "JPEG":
            full.convert("RGB").save(self._folder / f"{name}.jpg", quality=92)
            return f"{name}.jpg", alpha
        full.convert("RGB").save(self._folder / f"{name}.png", compress_level=6)
        return f"{name}.png", alpha


def _levels(piece: CataloguePiece, corners: Float64Array) -> tuple[SupportSurface, ...]:
    return tuple(
        SupportSurface(*(round(value, 5) for value in (
            level.x, level.y, level.z, level.half_x, level.half_y, level.headroom)))
        for level in support_surfaces(corners, piece.drop)
    )  # fmt: skip


def _point(values: Float64Array) -> Point3:
    x, y, z = (round(float(value), 5) for value in values)
    return (x, y, z)


def piece_fingerprint(
    piece: CataloguePiece, sha256: str, max_triangles: int, texture_size: int, key: int
) -> str:
    """Return the fingerprint of a converted piece; `key` is that of the converter."""
    determined_by = (key, sha256, piece, max_triangles, texture_size)
    return digest_bytes(*(repr(value).encode() for value in determined_by))
