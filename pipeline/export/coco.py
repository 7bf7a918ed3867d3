"""COCO annotations from the label images: instances, and panoptic segmentation.

`images/SPLIT/SCENE/VIEW.png` are tone-mapped. `annotations/instances_SPLIT.json` has one annotation
for each thing that a view shows, its mask as run lengths. `annotations/panoptic_SPLIT.json` goes
with `annotations/panoptic_SPLIT/SCENE/VIEW.png`, whose pixels are segment ids R + 256 G + 65536 B;
0: nothing. There each thing is a segment, and what belongs to the building ("stuff") is one segment
a class.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.dataset.columns import CLASSES
from pbrnet.pipeline.export.images import exposures, write_picture
from pbrnet.pipeline.export.parts import Advance, Format, Job, Part, library
from pbrnet.pipeline.export.rows import ANY_LENS, ViewRow
from pbrnet.pipeline.images import png_bytes
from pbrnet.scenes.arrays import AnyArray, BoolArray
from pbrnet.scenes.files import atomic_file, read_json, write_json

# Names of categories and classes of the building itself.
STUFF = frozenset(
    (
        *("wall", "floor", "ceiling", "structure", "skirting", "slab", "stairs", "railing"),
        *("fireplace", "splashback", "ground", "building", "other structure"),
    )
)
_STUFF_ID = 1 << 23  # segment id of stuff: this and the class; those of things are below


def categories(classes: str) -> list[dict[str, Any]]:
    """Return COCO's table of categories: id, name, supercategory, isthing."""
    names = class_names(classes)
    groups = names
    parent = {"category": "nyu40", "nyu40": "nyu13"}.get(classes)
    if parent:
        numbers: Any = CLASSES[f"{parent}_of_{classes}"]
        groups = [class_names(parent)[number] for number in numbers]
    return [
        {"id": n, "name": name, "supercategory": groups[n], "isthing": int(name not in STUFF)}
        for n, name in enumerate(names)
        if n
    ]


def class_names(classes: str) -> list[str]:
    """Return the names of categories or of NYU classes by number; 0 is none."""
    names: Any = CLASSES[classes]
    return [str(name) for name in names]


def segment_ids(instance: AnyArray, labels: AnyArray, stuff: BoolArray) -> AnyArray:
    """Return panoptic ids (H, W), int32: the object, for stuff the class; 0 without a class.

    `stuff[label]` is true for classes of stuff.
    """
    ids = np.where(stuff[labels], _STUFF_ID + labels, instance)
    return np.where(labels > 0, ids, 0).astype(np.int32)


def id_picture(ids: AnyArray) -> AnyArray:
    """Return panoptic ids (H, W) as uint8 (H, W, 3): R + 256 G + 65536 B."""
    return np.stack([ids >> shift & 255 for shift in (0, 8, 16)], axis=-1).astype(np.uint8)


def _parts(kind: str, job: Job) -> Sequence[Part]:
    parts = []
    for scene, rows in job.rows.scenes().items():
        split = rows[0].split
        # Views count once, with their annotations.
        parts.append(Part(f"images/{split}/{scene}", 0, partial(_write_pictures, job, rows)))
        write = partial(_write_instances if kind == "instances" else _write_panoptic, job, rows)
        parts.append(Part(f"annotations/{kind}_{split}/{scene}", len(rows), write))
    return parts


def _write_pictures(job: Job, rows: Sequence[ViewRow], folder: Path, _: Advance) -> None:
    found = zip(exposures(rows, job.options), job.rows.read(rows, ("color",)), strict=True)
    for exposure, (row, content) in found:
        write_picture(folder / f"{row.view_id}.png", content.images["color"], exposure)


def _labels(job: Job, rows: Sequence[ViewRow]) -> Iterator[tuple[ViewRow, AnyArray, AnyArray]]:
    """Yield rows with the numbers of their instances and classes, (H, W)."""
    classes = job.options.classes
    for row, content in job.rows.read(rows, ("instance", classes)):
        yield row, content.images["instance"], content.images[classes]


def _masks() -> Any:
    """The library of run-length masks; raises `MachineError` where it is missing."""
    return library("pycocotools.mask", "an export to COCO")


def _write_instances(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    masks = _masks()
    stuff = _stuff(job.options.classes)
    views = []
    for row, instance, labels in _labels(job, rows):
        things = np.where((labels > 0) & ~stuff[labels], instance, 0)
        found = []
        for number in np.unique(things[things > 0]):
            mask = things == number
            code = masks.encode(np.asfortranarray(mask, dtype=np.uint8))
            found.append(
                {
                    "category_id": int(labels[mask][0]),
                    "segmentation": {"size": code["size"], "counts": code["counts"].decode()},
                    "area": int(mask.sum()),
                    "bbox": masks.toBbox(code).tolist(),
                    "iscrowd": 0,
                    "instance": int(number),
                }
            )
        views.append({"view_id": row.view_id, "size": labels.shape, "annotations": found})
        advance()
    write_json(folder / "views.json", views)


def _write_panoptic(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    stuff = _stuff(job.options.classes)
    views = []
    for row, instance, labels in _labels(job, rows):
        ids = segment_ids(instance, labels, stuff)
        (folder / f"{row.view_id}.png").write_bytes(png_bytes(id_picture(ids)))
        segments = [_segment(int(number), ids, labels) for number in np.unique(ids[ids > 0])]
        views.append({"view_id": row.view_id, "size": labels.shape, "segments": segments})
        advance()
    write_json(folder / "views.json", views)


def _segment(number: int, ids: AnyArray, labels: AnyArray) -> dict[str, Any]:
    mask = ids == number
    lines, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    left, top = int(columns[0]), int(lines[0])
    return {
        "id": number,
        "category_id": int(labels[mask][0]),
        "area": int(mask.sum()),
        "bbox": [left, top, int(columns[-1]) - left + 1, int(lines[-1]) - top + 1],
        "iscrowd": 0,
    }


def _stuff(classes: str) -> BoolArray:
    return np.array([name in STUFF for name in class_names(classes)])


def _finish(kind: str, job: Job) -> None:
    """Merge the annotations of all scenes, a file a split, one scene in memory at a time."""
    splits: dict[str, list[str]] = {}
    for scene, rows in job.rows.scenes().items():
        splits.setdefault(rows[0].split, []).append(scene)
    table = categories(job.options.classes)
    if kind == "instances":
        table = [category for category in table if category["isthing"]]
    for split, scenes in splits.items():
        folder = job.out / "annotations" / f"{kind}_{split}"
        with atomic_file(folder.with_suffix(".json")) as path, path.open("w") as stream:
            stream.write('{"info":{"description":"labels of a pbrnet dataset"},"licenses":[],')
            stream.write(f'"categories":{_compact(table)},\n"images":[\n')
            _write_items(stream, (image for image, _ in _views(folder, scenes, kind)))
            stream.write('],\n"annotations":[\n')
            _write_items(
                stream, (one for _, found in _views(folder, scenes, kind) for one in found)
            )
            stream.write("]}\n")


def _views(
    folder: Path, scenes: Sequence[str], kind: str
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Yield the images of a split with their annotations, numbered from 1."""
    image = annotation = 0
    for scene in scenes:
        for view in read_json(folder / scene / "views.json"):
            image += 1
            height, width = view["size"]
            name = f"{scene}/{view['view_id']}.png"
            facts = {"id": image, "file_name": name, "width": width, "height": height}
            facts |= {"scene_id": scene, "view_id": view["view_id"]}
            if kind == "panoptic":
                whole = {"image_id": image, "file_name": name, "segments_info": view["segments"]}
                yield facts, [whole]
                continue
            found = [
                {"id": annotation + number, "image_id": image, **one}
                for number, one in enumerate(view["annotations"], 1)
            ]
            annotation += len(found)
            yield facts, found


def _write_items(stream: Any, items: Iterable[dict[str, Any]]) -> None:
    for number, item in enumerate(items):
        stream.write((",\n" if number else "") + _compact(item))


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def _format(kind: str, name: str, title: str) -> Format:
    return Format(
        name,
        title,
        ("color", "instance", "category"),
        partial(_parts, kind),
        partial(_finish, kind),
        check=lambda job: _masks() if kind == "instances" else None,
        uses=("exposure", "classes"),
        lenses=ANY_LENS,
    )


INSTANCES = _format("instances", "coco", "COCO instances: masks, boxes, categories of things")
PANOPTIC = _format("panoptic", "coco-panoptic", "COCO panoptic: segments of things and stuff")
