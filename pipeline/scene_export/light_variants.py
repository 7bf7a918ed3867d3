"""Scenes beside an exported one that differ from it in light alone."""

from __future__ import annotations

import filecmp
import re
from collections.abc import Sequence

import numpy as np

from pbrnet.pipeline.scene_export.content import Content, read_content
from pbrnet.pipeline.scene_export.looks import Glow, Look, Picture
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.errors import InputError


def light_variants(content: Content) -> list[Content]:
    """Return the scenes of one plan beside `content` that have another light, one of each kind.

    They are named like it but for `-v1` and so on, and differ in what shines and outdoors only.
    """
    scene = content.scene
    folder = scene.folder.resolve()
    stem = re.sub(r"-v\d+$", "", folder.name)
    found: list[Content] = []
    taken = {scene.lighting}
    for beside in sorted(folder.parent.glob(f"{stem}*")):
        if not re.fullmatch(rf"{re.escape(stem)}(-v\d+)?", beside.name) or beside == folder:
            continue
        try:
            other = read_content(beside)
        except InputError:
            continue  # no complete scene
        if other.scene.lighting not in taken and _is_variant(content, other):
            taken.add(other.scene.lighting)
            found.append(other)
    return found


def differing(content: Content, others: Sequence[Content]) -> set[str]:
    """Return the ids of objects that one of `others` lacks, adds or shows otherwise."""
    return {id_ for other in others for id_ in _differing(content, other)}


def _is_variant(content: Content, other: Content) -> bool:
    first, second = content.scene, other.scene
    if not first.plan or (first.plan, first.rooms, first.portals) != (
        second.plan, second.rooms, second.portals
    ):  # fmt: skip
        return False
    found = [_by_id(content), _by_id(other)]
    for id_ in _differing(content, other):
        things = [one.get(id_) for one in found]
        outdoors = all(thing is None or thing.room is None for thing in things)
        lamp = any(thing is not None and _shines(scene, thing)
                   for scene, thing in zip((content, other), things, strict=True))  # fmt: skip
        if not (outdoors or (lamp and None not in things)):
            return False
    return True


def _differing(content: Content, other: Content) -> set[str]:
    ours, theirs = _by_id(content), _by_id(other)
    return set(ours.keys() ^ theirs.keys()) | {
        id_
        for id_ in ours.keys() & theirs.keys()
        if ours[id_].shapes != theirs[id_].shapes
        or not all(_is_same(content, other, name) for name in ours[id_].shapes)
    }


def _by_id(content: Content) -> dict[str, SceneObject]:
    return {thing.id: thing for thing in content.scene.objects}


def _shines(content: Content, thing: SceneObject) -> bool:
    pieces = [content.pieces[name] for name in thing.shapes]
    return any(content.materials[piece.material][2] is not None for piece in pieces)


def _is_same(content: Content, other: Content, name: str) -> bool:
    first, second = content.pieces[name], other.pieces[name]
    (_, look, glow), (_, *theirs) = (
        content.materials[first.material], other.materials[second.material]
    )  # fmt: skip
    return (
        [look, glow] == theirs
        and np.array_equal(first.mesh.faces, second.mesh.faces)
        and np.array_equal(first.mesh.vertices, second.mesh.vertices)
        and all(
            filecmp.cmp(content.scene.folder / file, other.scene.folder / file, shallow=False)
            for file in _files(look, glow)
        )
    )


def _files(look: Look, glow: Glow | None) -> list[str]:
    """Names of the images of a material."""
    values = (look.base, look.roughness, look.metallic, look.normal, look.opacity)
    pictures = [*values, None if glow is None else glow.image]
    return [one.file for one in pictures if isinstance(one, Picture)]
