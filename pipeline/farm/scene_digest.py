"""Which scene it is: a digest of all that a scene folder holds, wherever the folder lies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pipeline.frames import fingerprint
from scenes.contract import load_scene
from scenes.files import digest_file

STAGE_MARK = "made_by_stage"  # key in scene.json's `source`: the fingerprint, ours to replace


def scene_digest(folder: Path) -> str:
    """64 hex digits over all files of a scene folder, but for the stage's own mark.

    Raises `InputError` for a scene that cannot be read.
    """
    scene = load_scene(folder)
    bare = replace(scene, source={k: v for k, v in scene.source.items() if k != STAGE_MARK})
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    contents = {
        file.relative_to(folder).as_posix(): digest_file(file)
        for file in files
        if file != folder / "scene.json"
    }
    return fingerprint(scene=bare, files=contents)
