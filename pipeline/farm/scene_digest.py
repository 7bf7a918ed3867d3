"""Digest of the content of a scene folder, independent of the folder's path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pbrnet.pipeline.frames import fingerprint
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.files import digest_file

# Keys in scene.json's `source` that the scenes stage writes: its fingerprint, and the files that an
# import looked for.
STAGE_KEY = "made_by_stage"
STAGE_FILES_KEY = "opened_files"


def scene_digest(folder: Path) -> str:
    """Return 64 hex digits over all files of a scene folder, but for the stage's own keys.

    Raises `InputError` for a scene that cannot be read.
    """
    scene = load_scene(folder)
    source = {
        key: value for key, value in scene.source.items() if key not in (STAGE_KEY, STAGE_FILES_KEY)
    }
    bare = replace(scene, source=source)
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    contents = {
        file.relative_to(folder).as_posix(): digest_file(file)
        for file in files
        if file != folder / "scene.json"
    }
    return fingerprint(scene=bare, files=contents)
