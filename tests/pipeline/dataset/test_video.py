"""Video in the dataset: columns, links between rows, and frames that are rejected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.channels import VIDEO_BANDS
from pbrnet.pipeline.dataset.agreement import reprojected
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Channels, frame_path
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.views import View, as_matrix, load_cameras, look, save_cameras
from tests.fixtures.dataset import all_rows, box_frames, make_data, small_params, write_view

X, Y, HIDDEN, OUTSIDE = VIDEO_BANDS["forward"]


def box_video(view: View, params: Params) -> Channels:
    """A `video` frame that agrees with `box_frames`: a convex room hides nothing."""
    inputs = {"Z": box_frames(view, params)["inputs"]["Z"]}
    rows, columns = np.mgrid[: view.height, : view.width] + 0.5
    bands: Channels = {}
    for way, pose in (("forward", view.pose_after), ("backward", view.pose_before)):
        x, y = VIDEO_BANDS[way][:2]
        nothing = np.zeros((view.height, view.width))
        bands |= dict.fromkeys(VIDEO_BANDS[way], nothing)
        bands[VIDEO_BANDS[way][3]] = nothing + 1
        if pose:
            places, _ = reprojected(inputs, view, pose)
            bands[x], bands[y] = places[..., 0] - columns, places[..., 1] - rows
            inside = (places >= 0).all(-1) & (places < (view.width, view.height)).all(-1)
            bands[VIDEO_BANDS[way][3]] = ~inside
    return bands


def filmed(folder: Path) -> tuple[Path, Params, list[View]]:
    """Three scenes: two with a single view, one with a trajectory of four frames."""
    params = replace(small_params(), channels=("video",))
    data = make_data(folder, params, scenes=3, views=1, plan="villa")
    poses = [as_matrix(look((2.0, 2.5 + 0.05 * n, 1.5), (1, 0.1 * n, -0.2))) for n in range(4)]
    views = []
    for name in ("home-0000", "home-0001", "home-0002"):
        path = data / "cameras" / f"{name}.json"
        file = load_cameras(path)
        views += file.views
    film = [
        replace(
            views[2],
            view_id=f"walk-00-{n:04d}",
            camera_to_world=pose,
            trajectory="walk-00",
            frame=n,
            pose_before=poses[n - 1] if n else (),
            pose_after=poses[n + 1] if n < 3 else (),
        )
        for n, pose in enumerate(poses)
    ]
    save_cameras(data / "cameras" / "home-0002.json", replace(file, views=(views[2], *film)))
    for view in (*views, *film):
        for kind, channels in box_frames(view, params).items():
            write_view(data, kind, channels, view)
        write_view(data, "video", box_video(view, params), view)
    return data, params, film


def test_a_trajectory_is_rows_with_flow(tmp_path: Path) -> None:
    data, params, film = filmed(tmp_path)
    assert pack_dataset(data, params).total == 7
    rows = all_rows(data)
    assert {row["plan"] for row in rows} == {"villa"}
    frames = [row for row in rows if row["trajectory"] == "walk-00"]
    assert [row["frame"] for row in frames] == [0, 1, 2, 3]
    assert len({row["split"] for row in frames}) == 1
    single = [row for row in rows if row["trajectory"] is None]
    assert len(single) == 3 and all(row["frame"] is None for row in single)
    flow = frames[1]["flow_forward"]
    np.testing.assert_array_equal(flow[..., 0], box_video(film[1], params)[X].astype(np.float32))
    assert not frames[3]["flow_forward"].any() and frames[3]["outside_forward"].all()
    schema = pq.read_schema(next((data / "dataset").glob("*.parquet")))
    assert schema.field("flow_forward").metadata[b"shape"] == b"[24, 32, 2]"
    assert schema.field("occluded_backward").metadata[b"dtype"] == b"uint8"
    drawn = inspect_path(frame_path(data, "video", film[1]))
    assert "forward.occluded" in drawn.text and drawn.draw().size


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({X: 0.02}, "misaligned"),
        ({OUTSIDE: 1.0}, "misaligned"),
        ("hidden", "misaligned"),
        ("next camera", "stale"),
    ],
)
def test_frames_that_do_not_agree_are_rejected(
    change: dict[str, float] | str, words: str, tmp_path: Path
) -> None:
    data, params, film = filmed(tmp_path)
    frame, view = box_video(film[1], params), film[1]
    if change == "next camera":
        view = replace(view, pose_after=film[3].camera_to_world)
    elif change == "hidden":
        frame[HIDDEN] = 1.0 - frame[OUTSIDE]
    else:
        assert isinstance(change, dict)
        for band, more in change.items():
            frame[band] = frame[band] + more
    write_view(data, "video", frame, view)
    assert pack_dataset(data, params).total == 6
    line = (data / "dataset" / "rejected.csv").read_text().splitlines()[1]
    assert line.startswith(f"home-0002,walk-00-0001,{words},")
