"""Descriptions of scenes, camera files and furniture catalogues."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

from shapely.geometry import Polygon

from pbrnet.pipeline.inspection.asset_sheet import (
    describe_asset,
    describe_index,
    draw_asset,
    draw_index,
)
from pbrnet.pipeline.inspection.drawings import (
    counted,
    draw_cameras,
    draw_plan,
    draw_scene,
)
from pbrnet.pipeline.inspection.sections import Inspection, Table, rows_of
from pbrnet.pipeline.inspection.sizes import scene_sizes
from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.assets.index import load_asset, load_index
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError


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
        f"Scene {scene.scene_id}: {counted(scene.rooms, 'room')}, "
        f"{counted(scene.objects, 'object')}, {counted(scene.lights, 'light')}, "
        f"{counted(scene.portals, 'portal')}",
        {
            "General": {
                **{f"source {key}": value for key, value in scene.source.items()},
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
        f"Cameras of scene {cameras.scene_id}: {counted(cameras.views, 'view')} "
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
    return Inspection(
        "assets",
        f"Furniture catalogues: {len(index.pieces)} of {total} pieces usable, "
        f"from {len(index.libraries)} libraries",
        describe_index(index),
        lambda: draw_index(index),
    )


def inspect_piece(folder: Path) -> Inspection:
    """Describe one converted catalogue piece; draw its preview."""
    asset = load_asset(folder)
    return Inspection(
        "piece",
        f"Catalogue piece {asset.piece.key}: {asset.piece.name}, {counted(asset.parts, 'part')}",
        describe_asset(asset),
        lambda: draw_asset(folder),
    )
