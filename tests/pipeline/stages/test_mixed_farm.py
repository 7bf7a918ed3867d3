"""Farms of several kinds: each worker renders with what its machine has, any of it holds.

Workers without LLVM stand for those with a graphics card: they, too, have another variant.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from distributed import Client

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import frame_path, read_frame, read_meta
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.views import ImageParams, View, load_cameras
from pbrnet.scenes.errors import MachineError
from tests.fixtures.dask_processes import dask_scheduler, dask_worker
from tests.fixtures.params import pbrs_cameras, pbrs_params
from tests.fixtures.stages import write_room

pytestmark = [pytest.mark.slow, pytest.mark.processes]

PARAMS = pbrs_params(
    image=ImageParams(48, 36),
    farm=FarmParams(workers=1, batch=1, window=1, retries=0),
    cameras=pbrs_cameras(views_per_room=3),
)
BEST = "pbrnet.pipeline.render.variants.best_variant"


def test_workers_of_two_kinds_render_surfaces_that_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wavefront: None
) -> None:
    data = tmp_path / "data"
    for name in ("alpha", "beta"):
        write_room(data / "scenes" / name)
    run_cameras(data, PARAMS)
    refused = Path(shutil.copytree(data, tmp_path / "refused"))
    with (
        dask_scheduler(tmp_path / "dask") as (address, _),
        Client(address) as client,
        dask_worker(address, tmp_path / "one"),
        monkeypatch.context() as patch,
    ):
        patch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so")
        with dask_worker(address, tmp_path / "two"):
            client.wait_for_workers(2, timeout=60)
            with pytest.raises(MachineError, match=r"scalar_rgb, .*, this command accepts"):
                run_frames("inputs", refused, PARAMS, address)
            # The command of a machine with neither LLVM nor a card drives both.
            patch.setattr(BEST, lambda: "scalar_rgb")
            summary = run_frames("inputs", data, PARAMS, address)
            assert run_frames("inputs", data, PARAMS, address).made == 0
    assert any("workers of several kinds" in note for note in summary.notes)
    views = [view for name in ("alpha", "beta") for view in _views(data, name)]
    paths = [frame_path(data, "inputs", view) for view in views]
    mixed = {path: (read_meta(path)["renderer"], read_frame(path)) for path in paths}
    kinds = {renderer.split(", ")[2] for renderer, _ in mixed.values()}
    assert kinds == {"llvm_ad_rgb", "scalar_rgb"}
    # Here, where LLVM works, only its own frames hold, unless the parameters say otherwise.
    foreign = sum("scalar_rgb" in renderer for renderer, _ in mixed.values())
    llvm = replace(PARAMS, farm=replace(PARAMS.farm, variant="llvm_ad_rgb"))
    assert run_frames("inputs", data, llvm).made == foreign
    assert run_frames("inputs", data, PARAMS).made == 0
    for path, (_, before) in mixed.items():
        for name, values in read_frame(path).channels.items():
            assert values == pytest.approx(before.channels[name], abs=1e-4), name


def _views(data: Path, name: str) -> tuple[View, ...]:
    return load_cameras(data / "cameras" / f"{name}.json").views
