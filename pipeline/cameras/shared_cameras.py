"""Cameras that a scene takes from another scene of its plan, where they have room.

Scenes of a plan differ in finishes, light, or furniture. A camera stays where it is, so that rows
of one plan and view id show the same place; it is left out if something is in its way here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pbrnet.pipeline.cameras.camera_files import (
    collisions,
    described_collisions,
    frames_of,
    stereo_pairs,
)
from pbrnet.pipeline.cameras.overlap import outlook, overlap
from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.cameras.view_sampling import (
    BLOCKED,
    INSIDE,
    TOO_CLOSE,
    make_view,
    room_at,
    sights,
    surroundings,
)
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import CameraFile, View


def take_cameras(
    render_scene: RenderScene, params: ViewParams, views: Sequence[View]
) -> CameraFile:
    """Return the camera file of a scene with the cameras of another one, `views`.

    Single views are its candidates. A trajectory stays whole or is left out; collisions of those
    from files are treated as in the scene that they are written for. Overlap and stereo partners
    follow from this scene.
    """
    scene = render_scene.scene
    options = params.cameras
    lefts = [view for view in views if view.stereo_offset >= 0]
    eyes = np.array([view.eye for view in lefts]).reshape(-1, 3)
    close, enclosed = surroundings(render_scene, eyes, options.clearance)
    kept: list[View] = []
    rejected: Counter[str] = Counter()
    left_out: dict[str, str] = {}
    collided: dict[str, dict[str, str]] = {}
    trajectories: dict[str, list[int]] = {}
    for index, view in enumerate(lefts):
        if view.trajectory:
            trajectories.setdefault(view.trajectory, []).append(index)
            continue
        (sight,) = sights(render_scene, [(view.pose, view.lens)], params)
        own = next((room for room in scene.rooms if room.id == view.room), None)
        room = own or room_at(scene, view.eye)
        reason = INSIDE if enclosed[index] else TOO_CLOSE if close[index] else ""
        if not reason and sight.coarse.nearness > options.max_near:
            reason = BLOCKED
        if reason:
            rejected[reason] += 1
            continue
        taken = make_view(scene, view.lens, view.view_id, view.pose, sight, room)
        kept.append(replace(taken, sector=view.sector, view_set=view.view_set))
    singles = len(kept)
    for name, members in trajectories.items():
        if name.startswith("walk-") and (close | enclosed)[members].any():
            left_out[name] = TOO_CLOSE
            continue
        poses = np.array([lefts[index].pose for index in members])
        if name.startswith("path-") and (found := collisions(render_scene, params, poses)):
            collided[name] = found
            if options.collisions == "reject":
                left_out[name] = described_collisions(found, len(poses))
                continue
        kept += frames_of(render_scene, params, name, poses, lefts[members[0]].lens)
    kept = _with_overlap(render_scene, kept)
    if options.stereo_baseline:
        kept, without = stereo_pairs(render_scene, params, kept)
        left_out |= without
    return CameraFile(
        scene_id=scene.scene_id,
        views=tuple(sorted(kept, key=lambda view: view.view_id)),
        candidates=singles + sum(rejected.values()),
        rejected={reason: rejected[reason] for reason in sorted(rejected)},
        stored_left_out=left_out,
        collisions=collided,
    )


def _with_overlap(render_scene: RenderScene, views: list[View]) -> list[View]:
    """Return the views with the overlap of their sets here; a set of one view is none."""
    sets: dict[str, list[int]] = {}
    for index, view in enumerate(views):
        if view.view_set:
            sets.setdefault(view.view_set, []).append(index)
    result = list(views)
    for name, members in sets.items():
        seen = [outlook(render_scene, views[i].pose, views[i].lens) for i in members]
        pairs = [overlap(render_scene, one, other) for one, other in combinations(seen, 2)]
        for index in members:
            median = round(float(np.median(pairs)), 6) if pairs else 0.0
            linked = {"view_set": name if pairs else "", "set_overlap": median}
            result[index] = replace(views[index], **linked)  # type: ignore[arg-type]
    return result
