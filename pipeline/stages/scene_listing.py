"""Scenes of a data folder as inputs of the rendering stages: ids, content digests, renderer."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from pathlib import Path

from pbrnet.pipeline.farm.scene_digest import scene_digest
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.records import Failure
from pbrnet.pipeline.render.scene import renderer_version
from pbrnet.pipeline.render.variants import accepted
from pbrnet.pipeline.stages.runner import StagePlan, threaded
from pbrnet.scenes.contract import Scene, load_scene, scene_folders
from pbrnet.scenes.errors import InputError

SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")


def accepted_renderers(params: FarmParams) -> tuple[str, ...]:
    """Return the versions of the renderer whose frames and cameras hold, the preferred one first.

    One for each variant that workers may choose.
    """
    return tuple(renderer_version(variant) for variant in accepted(params.variant))


def list_scenes(data: Path, plan: StagePlan, without: Collection[str] = ()) -> dict[str, Scene]:
    """Return all readable scenes by id; add the others to the plan's failures.

    Scenes of the names `without` are left aside. Raises `InputError` if there are none at all.
    """
    scenes = {}
    for folder in scene_folders(data / "scenes"):
        if folder.name in without:
            continue
        try:
            scene = load_scene(folder)
            if scene.scene_id != folder.name:
                raise InputError(
                    f"{folder}: its scene.json says {scene.scene_id!r}; rename the folder"
                )
            if not SAFE_NAME.fullmatch(scene.scene_id):
                raise InputError(
                    f"{folder}: a scene id may contain letters, digits, '.', '_' and '-' only"
                )
            scenes[scene.scene_id] = scene
        except InputError as error:
            plan.failures.append(Failure(plan.stage, folder.name, "", str(error)))
    if not scenes and not plan.failures and not without:
        raise InputError(f"{data / 'scenes'}: there are no scenes; run first: pbrnet scenes")
    return scenes


def scene_digests(data: Path, scenes: Iterable[str]) -> dict[str, str]:
    """Return the content digest of each scene by id."""
    names = list(scenes)
    digests = threaded(lambda name: scene_digest(data / "scenes" / name), names)
    return dict(zip(names, digests, strict=True))
