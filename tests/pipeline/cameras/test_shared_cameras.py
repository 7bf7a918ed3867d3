"""Cameras shared by the scenes of a plan: the same where they have room, and named where not."""

from dataclasses import replace
from pathlib import Path

import pytest

from pbrnet.pipeline.cameras.camera_files import make_cameras
from pbrnet.pipeline.cameras.settings import TrajectoryFile
from pbrnet.pipeline.cameras.shared_cameras import take_cameras
from pbrnet.pipeline.cameras.view_sampling import TOO_CLOSE
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.stages.cameras import camera_fingerprints, run_cameras
from pbrnet.pipeline.views import ImageParams, load_cameras
from pbrnet.scenes.contract import load_scene, save_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.params import SceneParams
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.stages import LIVING, Block, write_room

EVERYTHING = pbrs_cameras(
    views_per_room=4, walks=1, stereo_baseline=0.05, clearance=0.06, overlap_views=3, overlap=0.4
)


def room(folder: Path, *more: Block) -> RenderScene:
    set_variant("auto")
    write_room(folder, (*LIVING, *more))
    return open_scene(load_scene(folder))


def test_a_scene_of_the_same_shape_has_the_same_cameras(tmp_path: Path) -> None:
    params = pbrs_params(cameras=EVERYTHING)
    one, other = (room(tmp_path / name) for name in ("one", "other"))
    own = make_cameras(one, view_params(params), 0)
    taken = take_cameras(other, view_params(params), own.views)
    assert [replace(view, scene_id="one") for view in taken.views] == list(own.views)
    assert any(view.view_set for view in own.views) and any(view.trajectory for view in own.views)
    assert taken.rejected == {} and taken.stored_left_out == own.stored_left_out


def test_a_camera_without_room_is_left_out(tmp_path: Path) -> None:
    params = pbrs_params(cameras=replace(EVERYTHING, stereo_baseline=0.0, overlap_views=0))
    one = room(tmp_path / "one")
    own = make_cameras(one, view_params(params), 0)
    single = next(view for view in own.views if not view.trajectory)
    middle = next(view for view in own.views if view.frame == 12)
    posts = [
        Block(f"post-{n}", (*(view.eye[:2] - 0.1), 0.0), (*(view.eye[:2] + 0.1), 2.5))
        for n, view in enumerate((single, middle))
    ]
    other = room(tmp_path / "other", *posts)
    taken = take_cameras(other, view_params(params), own.views)
    ids = {view.view_id for view in taken.views}
    assert single.view_id not in ids and not any(view.trajectory for view in taken.views)
    assert taken.stored_left_out == {"walk-00": TOO_CLOSE}
    assert taken.candidates == len(taken.views) + sum(taken.rejected.values())
    poses = {view.view_id: view.camera_to_world for view in own.views}
    assert all(view.camera_to_world == poses[view.view_id] for view in taken.views)


@pytest.mark.slow
def test_the_stage_shares_within_a_plan_alone(tmp_path: Path) -> None:
    data = tmp_path / "data"
    for name, plan in (("alpha", "villa"), ("beta", "villa"), ("gamma", "hut")):
        folder = data / "scenes" / name
        chair = replace(LIVING[3], color=(0.9, 0.1, 0.1 * len(name)))
        write_room(folder, (*LIVING[:3], chair))
        save_scene(folder, replace(load_scene(folder), plan=plan))
    params = pbrs_params(
        image=ImageParams(48, 36),
        farm=FarmParams(workers=1),
        scenes=SceneParams(homes=0, imports=("nothing",)),
        cameras=pbrs_cameras(share_cameras=True),
    )
    assert run_cameras(data, params).made == 3
    files = {
        name: load_cameras(data / "cameras" / f"{name}.json") for name in ("alpha", "beta", "gamma")
    }
    poses = {
        name: {view.view_id: view.camera_to_world for view in file.views}
        for name, file in files.items()
    }
    assert poses["alpha"] == poses["beta"] != poses["gamma"]
    assert files["beta"].views[0].scene_id == "beta"
    assert run_cameras(data, params).kept == 3
    (data / "cameras" / "beta.json").unlink()
    assert run_cameras(data, params).made == 1
    assert load_cameras(data / "cameras" / "beta.json") == files["beta"]
    given = (TrajectoryFile("beta", "path.txt"),)
    with pytest.raises(InputError, match="beta shares the cameras of alpha; name that"):
        run_cameras(data, replace(params, cameras=replace(params.cameras, trajectories=given)))


def test_a_change_of_the_first_scene_concerns_those_that_share(tmp_path: Path) -> None:
    names = ("alpha", "beta", "gamma")
    scenes = {}
    for name in names:
        write_room(tmp_path / name)
        scenes[name] = replace(load_scene(tmp_path / name), plan="" if name == "gamma" else "villa")
    sharing = pbrs_params(cameras=pbrs_cameras(share_cameras=True))
    digests = dict.fromkeys(names, "1")

    def changed(params: Params, scene: str) -> set[str]:
        before, after = (
            camera_fingerprints(scenes, view_params(params), params.seed, values, ["r"])
            for values in (digests, {**digests, scene: "2"})
        )
        return {name for name in names if before[name] != after[name]}

    assert changed(sharing, "alpha") == {"alpha", "beta"}
    assert changed(sharing, "beta") == {"beta"}
    assert changed(pbrs_params(), "alpha") == {"alpha"}
