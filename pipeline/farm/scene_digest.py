"""Digest of the content of a scene folder, independent of the folder's path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pipeline.frames import fingerprint
from scenes.contract import load_scene
from scenes.files import digest_file

STAGE_KEY = "made_by_stage"  # in scene.json's `source`: the fingerprint that the stage keeps there


def scene_digest(folder: Path) -> str:
    """Return 64 hex digits over all files of a scene folder, but for the stage's fingerprint.

    Raises `InputError` for a scene that cannot be read.
    """
    scene = load_scene(folder)
    bare = replace(scene, source={k: v for k, v in scene.source.items() if k != STAGE_KEY})
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    contents = {
        file.relative_to(folder).as_posix(): digest_file(file)
        for file in files
        if file != folder / "scene.json"
    }
    return fingerprint(scene=bare, files=contents)
