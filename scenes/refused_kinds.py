"""Kinds of scene files that no source reads, and the best way around each.

The registry looks here last, so a kind that a source reads after all is not refused.
"""

from __future__ import annotations

_BLENDER = "open it in Blender and export it as .glb"
_CAD = "open it in FreeCAD and export it as .ifc or .glb"
_SCAN = "a scan is no scene of surfaces: make a mesh of it first, and save that as .glb"
_UNPACK = "unpack it and import the scene file inside"

# Suffix in lower case -> (name of the kind, what to do).
REFUSED: dict[str, tuple[str, str]] = {
    ".3dm": ("Rhino", "export it from Rhino as .obj or .glb"),
    ".7z": ("archive", _UNPACK),
    ".abc": ("Alembic", _BLENDER),
    ".blend": ("Blender", "export it from Blender as .glb"),
    ".c4d": ("Cinema 4D", "export it from Cinema 4D as .glb or .usdz"),
    ".dwg": ("AutoCAD", "export the building as .ifc; a drawing of lines alone is no scene"),
    ".dxf": ("AutoCAD", "export the building as .ifc; a drawing of lines alone is no scene"),
    ".e57": ("point cloud", _SCAN),
    ".fbx": ("FBX", _BLENDER),
    ".hip": ("Houdini", "export it from Houdini as .usd or .glb"),
    ".ifcxml": ("IFC as XML", "save it as .ifc in the program that wrote it"),
    ".ifczip": ("IFC in a zip", _UNPACK),
    ".iges": ("IGES", _CAD),
    ".igs": ("IGES", _CAD),
    ".kmz": ("Google Earth", "unpack it (it is a zip) and import the .dae inside"),
    ".las": ("point cloud", _SCAN),
    ".laz": ("point cloud", _SCAN),
    ".ma": ("Maya", "export it from Maya as .usd or .obj"),
    ".max": ("3ds Max", "export it from 3ds Max as .glb, .usd or .obj"),
    ".mb": ("Maya", "export it from Maya as .usd or .obj"),
    ".pln": ("Archicad", "save it in Archicad as .ifc"),
    ".ply": ("PLY", f"it has no materials by part: {_BLENDER}"),
    ".rar": ("archive", _UNPACK),
    ".rfa": ("Revit family", "place it in a Revit project and export that as .ifc"),
    ".rvt": ("Revit", "export it from Revit as .ifc"),
    ".sh3f": ("furniture catalogue of Sweet Home 3D", "name its folder in assets.folder"),
    ".skp": ("SketchUp", "export it from SketchUp as .dae (COLLADA) or .glb"),
    ".step": ("STEP", _CAD),
    ".stl": ("STL", f"it has no materials: {_BLENDER}"),
    ".stp": ("STEP", _CAD),
    ".uasset": ("Unreal Engine", "export the level from Unreal as .glb or .usd"),
    ".umap": ("Unreal Engine", "export the level from Unreal as .glb or .usd"),
    ".unity": ("Unity", "export the scene from Unity as .glb"),
    ".vwx": ("Vectorworks", "export it from Vectorworks as .ifc"),
    ".wrl": ("VRML", _BLENDER),
    ".x3d": ("X3D", _BLENDER),
    ".zip": ("archive", _UNPACK),
}
