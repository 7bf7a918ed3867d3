"""Size of a scene: triangles, textures, bytes on disk and estimated memory when open."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.image_files import UnreadableImage, open_image

_CORNER = 3 * 4  # bytes of a triangle's indices; vertices are counted by their size in the file
_TREE = 64  # bytes per triangle of the acceleration structure, approximate
_TEXEL = 4  # bytes per texel and channel in memory: float32
_KINDS = 6  # largest categories, which have their own rows


def scene_sizes(scene: Scene) -> list[dict[str, Any]]:
    """Return a row for the building, for each of the largest categories, and for textures.

    Columns: what, shapes, triangles, pixels, MB on disk, MB in memory (an estimate).
    """
    owner = {
        name: "building" if item.is_structure else item.category
        for item in scene.objects
        for name in item.shapes
    }
    shapes: Counter[str] = Counter()
    triangles: Counter[str] = Counter()
    disk: Counter[str] = Counter()
    for path in sorted((scene.folder / "meshes").glob("*.ply")):
        kind = owner.get(path.stem, "other")
        shapes[kind] += 1
        triangles[kind] += triangles_of(path)
        disk[kind] += path.stat().st_size
    ranked = [kind for kind, _ in triangles.most_common() if kind != "building"]
    for kind in ranked[_KINDS:]:
        for counts in (shapes, triangles, disk):
            counts["the rest"] += counts.pop(kind)
    rows: list[dict[str, Any]] = [
        {
            "what": kind,
            "shapes": shapes[kind],
            "triangles": triangles[kind],
            "pixels": 0,
            "MB on disk": round(disk[kind] / 1e6, 2),
            "MB in memory": round((disk[kind] + (_CORNER + _TREE) * triangles[kind]) / 1e6, 2),
        }
        for kind in ("building", *ranked[:_KINDS], "the rest")
        if shapes[kind]
    ]
    rows.append(_textures(scene.folder / "textures"))
    total = {name: round(sum(row[name] for row in rows), 2) for name in rows[0] if name != "what"}
    return [*rows, {"what": "all", **total}]


def triangles_of(path: Path) -> int:
    """Return the number of faces in the header of a PLY file."""
    with path.open("rb") as stream:
        for line in stream.read(4096).split(b"end_header")[0].splitlines():
            if line.startswith(b"element face"):
                return int(line.split()[-1])
    raise InputError(f"{path}: not a PLY file with faces")


def _textures(folder: Path) -> dict[str, Any]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    pixels, memory = 0, 0
    for path in files:
        if path.suffix.lower() == ".exr":
            memory += path.stat().st_size
            continue
        try:
            with open_image(path, load=False) as image:
                count = image.width * image.height
                pixels += count
                memory += count * len(image.getbands()) * _TEXEL
        except UnreadableImage as error:
            raise InputError(f"{path}: not a readable image ({error})") from None
    return {
        "what": "textures",
        "shapes": len(files),
        "triangles": 0,
        "pixels": pixels,
        "MB on disk": round(sum(path.stat().st_size for path in files) / 1e6, 2),
        "MB in memory": round(memory / 1e6, 2),
    }
