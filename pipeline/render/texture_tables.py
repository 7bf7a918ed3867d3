"""Textures whose image or number is looked up in a table by material.

Mitsuba's BSDFs hold their textures; a BSDF of many materials holds these. All images of a scene are
one array of texels, and a table has the place and size of each material's. Values are those of
Mitsuba's `bitmap` for images of 8 bits per channel that repeat: sRGB is decoded before texels are
interpolated. Other textures have no column here, and stay in BSDFs of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column, shape_table
from pbrnet.pipeline.render.scenegraph import Graph, shapes_of
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import decode_srgb_value

Kind = Literal["colour", "vector", "number"]
_READ = frozenset({"filename", "raw", "filter_type", "wrap_mode", "to_uv"})


@dataclass(frozen=True)
class Column:
    """One property of one material as a table holds it: an image, or a constant of three numbers.

    `form` is what all materials of a table have in common. `node` is the image's texture.
    """

    form: tuple[str, ...]
    node: int = -1
    constant: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Image:
    """An image: texels (H, W) of four bytes, rows of its texture transform (2, 3), its form."""

    texels: AnyArray
    to_uv: AnyArray
    grey: bool
    form: tuple[str, ...]


class TextureTables:
    """Images of a scene in one array, tables that refer to them, and each shape's material."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._images: dict[int, _Image | None] = {}
        self._numbers = {node: number for number, node in enumerate(sorted(graph.shaders))}
        self._materials = mi.UInt32(0)
        self._tables: list[_ConstantTable | _ImageTable] = []

    def texture(self, kind: Kind, node: int) -> Column | None:
        """Return the column of a texture node; None for one that Mitsuba must evaluate itself."""
        if node not in self._images:
            self._images[node] = _read(self._graph, node)
        image = self._images[node]
        if image is None or (kind == "number" and not image.grey):
            return None
        return Column((kind, *image.form), node)

    def table(self, columns: Mapping[int, Column]) -> Any:
        """Return a texture that holds the columns of materials, by the material's node."""
        first = next(iter(columns.values()))
        made: _ConstantTable | _ImageTable
        if first.node < 0:
            rows = self._rows(columns, lambda one: [*one.constant, 0], 4)
            made = _ConstantTable(self._materials, column(mi.Float, rows))
        else:
            rows = self._rows(columns, self._place, 4)
            placed = "placed" in first.form
            transforms = self._rows(columns, self._transform, 8) if placed else np.zeros(0)
            made = _ImageTable(
                self._materials,
                self._texels,
                column(mi.UInt32, rows),
                column(mi.Float, transforms),
                first.form,
            )
        self._tables.append(made)
        return _texture_class()(made)

    def number_shapes(self) -> None:
        """Tell all tables, also those made later, which material each shape has.

        Called once, when the shapes have been made.
        """
        if not dr.is_jit_v(mi.Float):
            return
        nodes = [
            (node, own[0])
            for node in shapes_of(self._graph)
            if (own := self._graph.nested(node, "BSDF"))
        ]
        shapes = [self._graph.make(node) for node, _ in nodes]
        self._materials = shape_table(shapes, [self._numbers[own] for _, own in nodes])
        for table in self._tables:
            table.materials = self._materials
        self._tables.clear()

    def _rows(self, columns: Mapping[int, Column], row: Any, width: int) -> AnyArray:
        """Return a flat table with the row of each material's column at the material's number.

        Materials that no shape has, and so no number, are left out.
        """
        rows = np.zeros((len(self._numbers), width))
        for node in columns.keys() & self._numbers.keys():
            rows[self._numbers[node]] = row(columns[node])
        return rows.ravel()

    def _place(self, one: Column) -> list[int]:
        height, width = self._images[one.node].texels.shape  # type: ignore[union-attr]
        return [self._offsets[one.node], width, height, 0]

    def _transform(self, one: Column) -> AnyArray:
        to_uv = self._images[one.node].to_uv  # type: ignore[union-attr]
        return np.pad(to_uv, ((0, 0), (0, 1))).ravel()

    @cached_property
    def _offsets(self) -> dict[int, int]:
        """Place of each image's first texel, by node, once all images are known."""
        used = self._used()
        ends = np.cumsum([0, *(image.texels.size for image in used.values())])
        return {node: int(end) for node, end in zip(used, ends, strict=False)}

    @cached_property
    def _texels(self) -> mi.UInt32:
        used = self._used()
        return column(mi.UInt32, np.concatenate([one.texels.ravel() for one in used.values()]))

    def _used(self) -> dict[int, _Image]:
        """Return the images of all BSDFs: twins may need one that no table has held before."""
        graph = self._graph
        for node in range(len(graph.nodes)):
            if graph.kind(node) == "BSDF":
                for texture in graph.nested(node, "Texture"):
                    self.texture("colour", texture)
        return {node: image for node, image in self._images.items() if image is not None}


def constant(kind: Kind, value: Any) -> Column | None:
    """Return the column of a constant; None for 0, and for what is no number or colour.

    A colour beyond [0, 1] has none: Mitsuba refuses it.
    """
    if isinstance(value, bool | str):
        return None
    try:
        numbers = np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        return None
    if kind == "number":
        fits = numbers.size == 1 and numbers[0] > 0
    else:
        fits = numbers.size in (1, 3) and bool(((numbers >= 0) & (numbers <= 1)).all())
    if not fits:
        return None
    return Column((kind, "constant"), -1, tuple(np.broadcast_to(numbers, 3).tolist()))


def _read(graph: Graph, node: int) -> _Image | None:
    """Return the image of a texture node, None if it is none of the kind that tables hold."""
    props = graph.props(node)
    if graph.plugin(node) != "bitmap" or not _READ.issuperset(props.keys()):
        return None
    if props.get("wrap_mode", "repeat") != "repeat":
        return None
    known = node in graph.made
    params = mi.traverse(graph.make(node))
    texels, to_uv = params["data"].numpy(), np.array(params["to_uv"].matrix, dtype=np.float64)
    if texels.dtype != np.uint8 or texels.shape[2] not in (1, 3):
        return None
    if not known:
        del graph.made[node]  # the array of all images holds it now
    packed = np.zeros((*texels.shape[:2], 4), dtype=np.uint8)
    packed[..., :3] = texels
    form = (
        "raw" if props.get("raw", False) else "srgb",
        str(props.get("filter_type", "bilinear")),
        *(() if np.array_equal(to_uv, np.eye(3)) else ("placed",)),
    )
    return _Image(packed.view(np.uint32)[..., 0], to_uv[:2], texels.shape[2] == 1, form)


class _Table:
    """Table of materials; `materials` are their numbers by registry id of the shape."""

    materials: mi.UInt32

    def material(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.UInt32:
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        return dr.gather(mi.UInt32, self.materials, shape, active)


class _ConstantTable(_Table):
    """Three numbers per material, in rows of four."""

    def __init__(self, materials: mi.UInt32, rows: mi.Float) -> None:
        self.materials, self.rows = materials, rows

    def colour(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> list[mi.Float]:
        row = dr.gather(mi.Vector4f, self.rows, self.material(si, active), active)
        return [row.x, row.y, row.z]

    def number(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Float:
        return dr.gather(mi.Float, self.rows, self.material(si, active) * 4, active)


class _ImageTable(_Table):
    """An image per material: rows of first texel, width, height; a transform in eight."""

    def __init__(
        self,
        materials: mi.UInt32,
        texels: mi.UInt32,
        rows: mi.UInt32,
        transforms: mi.Float,
        form: tuple[str, ...],
    ) -> None:
        self.materials, self.texels, self.rows, self.transforms = (
            materials,
            texels,
            rows,
            transforms,
        )
        self.bands = 1 if form[0] == "number" else 3
        self.nearest, self.placed = "nearest" in form, "placed" in form
        self.decoded = column(mi.Float, _decoded()) if "srgb" in form else mi.Float(0)
        self.srgb = "srgb" in form

    def number(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Float:
        return self.colour(si, active)[0]

    def colour(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> list[mi.Float]:
        material = self.material(si, active)
        start, width, height, _ = dr.gather(mi.Vector4u, self.rows, material, active)
        uv = self.place(si.uv, material, active)
        uv -= dr.floor(uv)

        def texel(x: mi.UInt32, y: mi.UInt32) -> list[mi.Float]:
            packed = dr.gather(mi.UInt32, self.texels, start + y * width + x, active)
            return self.unpack(packed, active)

        if self.nearest:
            x, y = (
                dr.minimum(mi.UInt32(place * size), size - 1)
                for place, size in zip(uv, (width, height), strict=True)
            )
            return texel(x, y)
        left, right, x = _neighbours(uv.x, width)
        lower, upper, y = _neighbours(uv.y, height)
        rows = [
            [dr.lerp(*pair, x) for pair in zip(texel(left, v), texel(right, v), strict=True)]
            for v in (lower, upper)
        ]
        return [dr.lerp(*pair, y) for pair in zip(*rows, strict=True)]

    def place(self, uv: mi.Point2f, material: mi.UInt32, active: mi.Bool) -> mi.Point2f:
        if not self.placed:
            return mi.Point2f(uv)
        rows = [
            dr.gather(mi.Vector4f, self.transforms, 2 * material + which, active)
            for which in range(2)
        ]
        return mi.Point2f([dr.fma(row.x, uv.x, dr.fma(row.y, uv.y, row.z)) for row in rows])

    def unpack(self, packed: mi.UInt32, active: mi.Bool) -> list[mi.Float]:
        numbers = [(packed >> (8 * band)) & 0xFF for band in range(self.bands)]
        if self.srgb:
            return [dr.gather(mi.Float, self.decoded, number, active) for number in numbers]
        return [mi.Float(number) * (1 / 255) for number in numbers]


@cache
def _texture_class() -> Any:
    """Return the class of textures that a table evaluates; its base class needs a variant."""

    class TableTexture(mi.Texture):  # type: ignore[misc]
        def __init__(self, table: _ConstantTable | _ImageTable) -> None:
            super().__init__(mi.Properties())
            self.table = table

        def eval(self, si: mi.SurfaceInteraction3f, active: mi.Bool = True) -> mi.Color3f:
            return mi.Color3f(self.table.colour(si, active))

        def eval_3(self, si: mi.SurfaceInteraction3f, active: mi.Bool = True) -> mi.Color3f:
            return mi.Color3f(self.table.colour(si, active))

        def eval_1(self, si: mi.SurfaceInteraction3f, active: mi.Bool = True) -> mi.Float:
            return self.table.number(si, active)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"{type(self.table).__name__}[]"

    return TableTexture


def _neighbours(place: mi.Float, size: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32, mi.Float]:
    """Return the texels on both sides of `place` in [0, 1], and the share of the second.

    Both are below `size` even where `place` is no number.
    """
    texel = dr.fma(place, mi.Float(size), -0.5)
    first = dr.floor(texel)
    share = texel - first
    first = mi.Int32(first)
    number = dr.minimum(mi.UInt32(dr.select(first < 0, mi.Int32(size) - 1, first)), size - 1)
    second = number + 1
    return number, dr.select(second >= size, 0, second), share


@cache
def _decoded() -> AnyArray:
    """Return the linear value of each byte of an sRGB image, (256,)."""
    return np.array([decode_srgb_value(byte / 255) for byte in range(256)])
