"""Placement of furniture models, with the finishes of the model or of the home."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.formats.model_parts import Model, ModelMaterial, ModelPart
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.furnishing.finishes import (
    WHITE,
    glossy_finish,
    mapped_uvs,
    reflectance_of_argb,
    reflectance_of_display,
    roughness_of,
    texture_coordinates,
)
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, SurfaceFinish
from pbrnet.scenes.sweethome.furnishing.placement import model_to_unit_box, unit_box_to_world
from pbrnet.scenes.sweethome.home import HomePiece, NamedMaterial, Texture

_PANE = "sweethome3d_window_pane"
_MIRROR = "sweethome3d_window_mirror"
_BULB = "sweethome3d_light"
_EDGE = "edge_color"
_PANE_OPACITY = 0.5  # of panes whose material is opaque
_CLEAR = 0.5  # opacity up to which a part is glass
_INVISIBLE = 1 / 255  # opacity up to which a part is left out
_METALS = re.compile(
    r"metal|chrom|steel|inox|alumin|silver|brass|bronze|copper|gold\b|nickel|iron\b", re.IGNORECASE
)
# Groups of joints, and of parts that move with a joint.
_JOINT = re.compile(r"sweethome3d_(hinge|rail|ball)_(\d+)")
_FOLLOWER = re.compile(
    r"sweethome3d_(?:opening|window_pane|window_mirror)_on_(hinge|rail|ball)_(\d+)"
)


@dataclass(frozen=True)
class PlacedModel:
    """Parts of a piece in world coordinates, and the 4x4 matrix from its unit box to the world."""

    parts: tuple[ItemPart, ...]
    to_world: Float64Array  # 4x4


def place_piece(piece: HomePiece, model: Model, elevation: float, changes: Changes) -> PlacedModel:
    """Return a piece in its place; `elevation` is that of its level (cm)."""
    shown = _with_joints_moved(piece, _visible_parts(piece, model), changes)
    vertices = np.concatenate([part.mesh.vertices for part in shown])
    to_box = model_to_unit_box(vertices, piece)
    in_box = vertices @ to_box[:3, :3].T + to_box[:3, 3]
    to_world = unit_box_to_world(in_box, piece, elevation)
    whole = to_world @ to_box
    bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    parts = []
    for part in shown:
        made = finish_of_part(piece, part)
        if made is None:
            continue
        finish, uvs = _finish_and_uvs(piece, part, made, bounds)
        mesh = Mesh(part.mesh.vertices, part.mesh.faces, part.mesh.normals, uvs)
        parts.append(
            ItemPart(
                _standing(mesh, whole),
                finish,
                pane=_is_pane(part) and finish.kind == "glass",
                emits=part.material_name in piece.emissive_materials,
            )
        )
    return PlacedModel(tuple(parts), to_world)


def place_without_model(piece: HomePiece, elevation: float) -> PlacedModel:
    """Return a piece without parts, for a missing model; its light sources keep their places."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return PlacedModel((), unit_box_to_world(corners, piece, elevation))


def finish_of_part(piece: HomePiece, part: ModelPart) -> SurfaceFinish | None:
    """Return the finish of a part of a piece; None if the home makes it invisible.

    The colour of the piece has priority, then its texture, then its named materials; only named
    materials change panes. Opacity is always that of the model.
    """
    material, is_pane = part.material, _is_pane(part)
    opacity = material.opacity
    if is_pane and opacity >= 1:
        opacity = _PANE_OPACITY
    if opacity <= _INVISIBLE and material.image is None:
        return None
    if part.group.startswith(_MIRROR):
        return SurfaceFinish("mirror", color=(0.9, 0.9, 0.9))
    override = override_of(piece, part)
    if override is not None and override.color is not None and override.color >> 24 == 0:
        return None
    painted: Color | None = None
    if piece.color is not None and not is_pane:
        painted = reflectance_of_argb(piece.color)
    elif override is not None and override.color is not None:
        painted = reflectance_of_argb(override.color)
    own_texture = texture_of(piece, part)
    base = _base(material, piece, override, painted is not None or own_texture is not None)
    if own_texture is not None:
        made = replace(base, color=WHITE, image=own_texture.image)
    elif painted is not None:
        made = replace(base, color=painted)
    elif material.image is not None:
        # The diffuse colour does not tint the image: many catalogues set it to black.
        made = replace(base, color=WHITE, image=material.image)
    else:
        made = replace(base, color=reflectance_of_display(material.color))
    if opacity <= _CLEAR and made.image is None:
        return SurfaceFinish("glass")
    if opacity < 1 and made.image is None:
        return replace(made, kind="sheer", opacity=round(opacity, 3))
    return made


def override_of(piece: HomePiece, part: ModelPart) -> NamedMaterial | None:
    """Return the named material that applies to a part; None if the piece has colour or texture."""
    if piece.color is not None or piece.texture is not None:
        return None
    for material in piece.materials:
        if part.material_name in ((material.key,) if material.key else (material.name,)):
            return material
    return None


def texture_of(piece: HomePiece, part: ModelPart) -> Texture | None:
    """Return the texture that the home puts on a part, or None."""
    if piece.color is not None:
        return None
    if piece.texture is not None:
        return None if _is_pane(part) else piece.texture
    override = override_of(piece, part)
    if override is None or override.color is not None:
        return None
    return override.texture


def _base(
    material: ModelMaterial, piece: HomePiece, override: NamedMaterial | None, is_repainted: bool
) -> SurfaceFinish:
    shininess = piece.shininess
    if override is not None and override.shininess is not None:
        shininess = override.shininess
    if shininess is not None:
        return SurfaceFinish() if shininess <= 1 / 128 else glossy_finish(shininess)
    if material.highlight < 0.02 or material.exponent < 1:
        return SurfaceFinish()
    roughness = round(roughness_of(material.exponent / 128), 4)
    return SurfaceFinish("gloss", roughness=roughness)


def _is_pane(part: ModelPart) -> bool:
    return part.group.startswith(_PANE)


def _visible_parts(piece: HomePiece, model: Model) -> list[ModelPart]:
    """Return the visible parts of a model: no placeholders of bulbs, no hidden edges."""
    shown = [
        part
        for part in model.parts
        if not (part.group.startswith(_BULB) and piece.kind == "light")
        and not (piece.hide_edges and part.material_name.startswith(_EDGE))
        and not _JOINT.match(part.group)
    ]
    # Joints are drawn too; some models consist of nothing else.
    joints = [part for part in model.parts if _JOINT.match(part.group)]
    return [*shown, *joints] or list(model.parts)


def _with_joints_moved(
    piece: HomePiece, parts: list[ModelPart], changes: Changes
) -> list[ModelPart]:
    """Apply the transformations of joints: open doors, open drawers."""
    moves: dict[tuple[str, str], Float64Array] = {}
    for name, rows in piece.transformations:
        joint = _JOINT.match(name)
        if joint is None:
            changes.note("deformations of a kind not known here were left out: {}", name)
            continue
        moves[(joint[1], joint[2])] = np.vstack([np.array(rows), [0.0, 0, 0, 1]])
    if not moves:
        return parts
    made = []
    for part in parts:
        follower = _FOLLOWER.match(part.group)
        matrix = moves.get((follower[1], follower[2])) if follower else None
        if matrix is None or abs(np.linalg.det(matrix[:3, :3])) < 1e-9:
            made.append(part)
        else:
            made.append(replace(part, mesh=part.mesh.transformed(matrix)))
    return made


def _finish_and_uvs(
    piece: HomePiece, part: ModelPart, finish: SurfaceFinish, bounds: Float64Array
) -> tuple[SurfaceFinish, Float64Array | None]:
    """Return the finish of a part and its texture coordinates, None for plain colour."""
    if finish.image is None:
        return finish, None
    texture, uvs = texture_of(piece, part), part.mesh.uvs
    if texture is None:
        if uvs is None:  # no coordinates: the colour of the model instead of the image
            return replace(
                finish, image=None, color=reflectance_of_display(part.material.color)
            ), None
    elif piece.texture is None and uvs is not None:
        uvs = mapped_uvs(uvs, texture)
    else:
        uvs = texture_coordinates(_wrapped_coordinates(piece, part.mesh.vertices, bounds), texture)
    assert uvs is not None
    return finish, np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)


def _wrapped_coordinates(
    piece: HomePiece, vertices: Float64Array, bounds: Float64Array
) -> Float64Array:
    """Return coordinates (N, 2), cm, from the lower left of the front over the top to the back."""
    extent = np.maximum(bounds[1] - bounds[0], 0.001)
    share = (vertices - bounds[0]) / extent
    across = share[:, 0] * piece.width
    up = share[:, 1] * piece.height + (1 - share[:, 2]) * piece.depth
    return np.stack([across, up], axis=1)


def _standing(mesh: Mesh, matrix: Float64Array) -> Mesh:
    """Transform a mesh to the world; a piece without thickness gets facet normals."""
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-15:
        flat = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        return Mesh(flat, mesh.faces, None, mesh.uvs)
    return mesh.transformed(matrix)


def is_metal(name: str) -> bool:
    """Return whether the name of a material denotes a metal."""
    return _METALS.search(name) is not None
