"""Descriptions and pictures of scenes, camera files and furniture catalogues."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from pbrnet.pipeline.images import Picture, contact_sheet, enlarge, read_picture
from pbrnet.pipeline.inspection.drawings import draw_cameras, draw_plan, draw_scene
from pbrnet.pipeline.inspection.sections import Inspection, Table, facts_of, rows_of
from pbrnet.pipeline.inspection.sizes import scene_sizes
from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.terminal import counted
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.assets.index import PREVIEW, AssetIndex, IndexEntry, load_asset, load_index
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_bytes
from pbrnet.scenes.procedural.furnishing.asset_sampler import build_kind_index

_COLUMNS = 12
_ROWS = 2  # per category
_GAP = np.array([24, 24, 27], dtype=np.uint8)  # the sheet's background


def inspect_scene(folder: Path, renders: bool = True) -> Inspection:
    """Describe rooms, objects, sizes, lights, portals and credits; draw the plan with cameras.

    With `renders` a dollhouse view and two quick renders are drawn below the plan.
    """
    scene = load_scene(folder)
    camera_path = folder.resolve().parent.parent / "cameras" / f"{scene.scene_id}.json"
    views = load_cameras(camera_path).views if camera_path.is_file() else ()
    rooms: Table = [
        {
            "room": room.id,
            "name": room.name,
            "type": room.type,
            "m2": round(Polygon(room.floor).area, 1),
            "height m": round(room.ceiling_z - room.floor_z, 2),
            "light": "yes" if room.has_light else "no",
            "objects": sum(item.room == room.id for item in scene.objects),
            "views": sum(view.room == room.id for view in views),
        }
        for room in scene.rooms
    ]
    categories = Counter(item.category for item in scene.objects if not item.is_structure)
    lumens = [light.lumens for light in scene.lights if light.lumens is not None]
    return Inspection(
        "scene",
        f"Scene {scene.scene_id}: {counted(len(scene.rooms), 'room')}, "
        f"{counted(len(scene.objects), 'object')}, {counted(len(scene.lights), 'light')}, "
        f"{counted(len(scene.portals), 'portal')}",
        {
            "General": {
                **{f"source {key}": value for key, value in scene.origin.items()},
                "lighting": scene.lighting,
                "plan": scene.plan or scene.scene_id,
                "units": scene.units,
                "shapes": sum(len(item.shapes) for item in scene.objects),
                "views sampled": len(views),
            },
            "Size": scene_sizes(scene),
            "Rooms": rooms,
            "Furniture": dict(categories.most_common()),
            "Lights": {
                **Counter(light.kind for light in scene.lights),
                **({"total lumens": round(sum(lumens))} if lumens else {}),
            },
            "Portals": [
                {
                    "portal": portal.id,
                    "kind": portal.kind,
                    "clear": "yes" if portal.clear else "no",
                    "room": portal.room or "",
                }
                for portal in scene.portals
            ],
            "Credits": rows_of(scene.credits, "part", "title", "author", "licence", "source"),
            "Changed or lost in import": list(scene.changes),
        },
        lambda: draw_scene(scene, views) if renders else draw_plan(scene, views),
    )


def inspect_cameras(path: Path) -> Inspection:
    """Describe views and the reasons of rejected candidates; draw the cameras on the plan."""
    cameras = load_cameras(path)
    folder = path.resolve().parent.parent / "scenes" / cameras.scene_id
    scene = load_scene(folder) if (folder / "scene.json").is_file() else None
    views: Table = [
        {
            "view": view.view_id,
            "room": view.room or "",
            "type": view.room_type,
            "sector": view.sector,
            "score": round(view.score, 2),
            "objects": len(view.seen),
            "size": f"{view.width}x{view.height}",
            "eye": " ".join(f"{value:.2f}" for value in view.eye),
            "sees most": ", ".join(sorted(view.seen, key=lambda name: -view.seen[name])[:3]),
        }
        for view in cameras.views
    ]
    return Inspection(
        "cameras",
        f"Cameras of scene {cameras.scene_id}: {counted(len(cameras.views), 'view')} "
        f"from {cameras.candidates} candidates",
        {"Rejected candidates": dict(cameras.rejected), "Views": views},
        lambda: draw_plan(scene, cameras.views) if scene else draw_cameras(cameras),
    )


def with_leaks(inspection: Inspection, path: Path) -> Inspection:
    """Return the description of a scene with a further section on light leaks.

    Raises `InputError` if `path` is no scene.
    """
    if inspection.kind != "scene":
        raise InputError(f"{path}: not a scene; --leaks requires one")
    set_variant()
    leaks = find_leaks(open_scene(load_scene(path if path.is_dir() else path.parent)))
    sentences = [str(leak) for leak in leaks] or ["none: with all portals closed no light gets in"]
    return replace(inspection, sections={**inspection.sections, "Leaks": sentences})


def inspect_assets(folder: Path) -> Inspection:
    """Describe libraries, categories, licences and refused pieces; draw a sheet of pieces."""
    index = load_index(folder)
    total = len(index.pieces) + len(index.refused)
    index_by_kind = build_kind_index(index)
    kinds = {kind: pieces for kind, pieces in index_by_kind.kinds.items() if pieces}
    unused = set(index_by_kind.own).difference(*kinds.values())
    return Inspection(
        "assets",
        f"Furniture catalogues: {len(index.pieces)} of {counted(total, 'piece')} usable, "
        f"from {counted(len(index.libraries), 'catalogue')}",
        {
            "Libraries": [
                {**row, "from": library.package or library.file}
                for row, library in zip(
                    rows_of(
                        index.libraries, "library=key", "pieces", "usable", "version", "licence"
                    ),
                    index.libraries,
                    strict=True,
                )
            ],
            "Categories": dict(Counter(piece.category for piece in index.pieces).most_common()),
            "Licences": dict(Counter(piece.licence for piece in index.pieces).most_common()),
            "Can stand in for": {kind: len(pieces) for kind, pieces in kinds.items()},
            "Own pieces that procedural homes do not take": {
                one.key: f"{one.category}, " + " x ".join(f"{side:.2f}" for side in one.size) + " m"
                for one in sorted(unused, key=lambda one: one.key)
            },
            "Triangles": _triangles(index.pieces),
            "Checks of own pieces": {
                key: "; ".join(notes)
                for key in sorted(index.own_keys)
                if (notes := load_asset(folder / key).checks.notes)
            },
            "Refused": rows_of(index.refused, "piece=key", "name", "reason"),
        },
        lambda: draw_index(index),
    )


def inspect_piece(folder: Path) -> Inspection:
    """Describe a converted piece: sizes, provenance, parts, support surfaces; draw its preview."""
    asset = load_asset(folder)
    piece, origin = asset.piece, asset.provenance
    return Inspection(
        "piece",
        f"Catalogue piece {piece.key}: {piece.name}, {counted(len(asset.parts), 'part')}",
        {
            "General": {
                "name": piece.name,
                "category": f"{piece.category} ({piece.group})",
                "size m": " x ".join(f"{side:.3f}" for side in piece.size),
                "elevation m": piece.elevation,
                "light sources": len(piece.lights),
                "lumens": round(asset.lumens),
                "boxes": len(asset.boxes),
            },
            "Provenance": {
                **facts_of(piece, "creator", "licence"),
                "library": f"{origin.library} {origin.version}",
                "file": f"{origin.file}, SHA-256 {origin.sha256}",
                **facts_of(origin, "package", "provider"),
            },
            "Parts": [
                {**row, "texture": row["texture"] or ""}
                for row in rows_of(asset.parts, "mesh", "kind", "triangles", "texture", "lumens")
            ],
            "Support surfaces": [
                {
                    "height m": level.z,
                    "size m": f"{2 * level.half_x:.2f} x {2 * level.half_y:.2f}",
                    "headroom m": level.headroom,
                }
                for level in asset.levels
            ],
            "Checks": facts_of(
                asset.checks, "triangles", "dropped", "size error m=size_error", "textures"
            ),
            "Changed or lost": list(asset.checks.notes),
        },
        lambda: enlarge(_preview(folder), 448),
    )


def _triangles(pieces: tuple[IndexEntry, ...]) -> dict[str, int]:
    counts = sorted(piece.triangles for piece in pieces)
    if not counts:
        return {}
    return {"median": counts[len(counts) // 2], "most": counts[-1], "together": sum(counts)}


def draw_index(index: AssetIndex) -> Picture:
    """Draw pieces of every category, the largest first, at most two rows each.

    Categories of few pieces share a row.
    """
    by_category: dict[str, list[IndexEntry]] = {}
    for piece in index.pieces:
        by_category.setdefault(piece.category, []).append(piece)
    rows: list[list[tuple[Picture, str]]] = [[]]
    for category, pieces in sorted(by_category.items(), key=lambda item: (-len(item[1]), item[0])):
        step = max(1, len(pieces) // (_COLUMNS * _ROWS))
        shown = pieces[::step][: _COLUMNS * _ROWS]
        labels = [f"{category} ({len(pieces)})", *(piece.name for piece in shown[1:])]
        pictures = [_preview(index.folder / piece.key) for piece in shown]
        if len(rows[-1]) + len(shown) > _COLUMNS:  # small categories share a row
            rows.append([])
        rows[-1] += zip(pictures, labels, strict=True)
    strips = [
        contact_sheet([one for one, _ in row], _COLUMNS, [label for _, label in row])
        for row in rows
        if row
    ]
    if not strips:
        return contact_sheet([], 1)
    width = max(strip.shape[1] for strip in strips)
    sheet = np.tile(_GAP, (sum(len(strip) for strip in strips), width, 1))
    tops = np.cumsum([0, *(len(strip) for strip in strips)])
    for top, strip in zip(tops, strips, strict=False):
        sheet[top : top + len(strip), : strip.shape[1]] = strip
    return sheet


def _preview(folder: Path) -> Picture:
    path = folder / PREVIEW
    return (
        read_picture(read_bytes(path)) if path.is_file() else np.full((112, 112, 3), 60, np.uint8)
    )
