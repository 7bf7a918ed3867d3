"""The dataset says exactly what the frames say, and leaves nothing out without a reason."""

import csv
import errno
import io
import json
import re
import resource
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner

from pbrnet.pipeline.channels import KINDS, TINT, dataset_channels, kinds_of_sets
from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.commands.stages import require_whole_walks, summary_lines
from pbrnet.pipeline.dataset.checks import (
    REASONS,
    black_share,
    blown_share,
    check_light,
    check_surfaces,
    firefly_share,
)
from pbrnet.pipeline.dataset.columns import dataset_columns
from pbrnet.pipeline.dataset.pack import is_packed, pack_dataset
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.dataset.shards import ShardWriter, verify_sums
from pbrnet.pipeline.frames import HALF_MAX, Frame, frame_path, read_frame
from pbrnet.pipeline.images import read_picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.splits import Source, SplitParams, kept_back, split_plans
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.tonemap import exposure_of
from pbrnet.pipeline.views import ImageParams, load_cameras, save_cameras
from pbrnet.scenes.contract import Credit
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import digest_folder
from tests.fixtures.command import Run
from tests.fixtures.dataset import (
    add_scene,
    all_rows,
    box_frames,
    box_scene,
    make_data,
    make_view,
    small_params,
    write_view,
)


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with four scenes of three views and its dataset."""
    params = small_params(row_group=2)
    data = make_data(tmp_path_factory.mktemp("data"), params)
    pack_dataset(data, params)
    return data


def rejected_of(data: Path) -> list[dict[str, str]]:
    """The lines of `rejected.csv`."""
    with (data / "dataset" / "rejected.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_column_equals_the_frames_bit_for_bit(packed: Path) -> None:
    params = small_params()
    rows = all_rows(packed)
    assert len(rows) == 12
    for row in rows:
        view = make_view(params, row["scene_id"], int(row["view_id"]))
        frames = {
            kind: read_frame(frame_path(packed, kind, view))
            for kind in ("inputs", "illumination", "visibility", "shading", "color")
        }
        inputs = frames["inputs"].channels
        expected = {
            "depth": inputs["Z"],
            "normal": np.stack([inputs[f"N.{axis}"] for axis in "XYZ"], -1),
            "reflectance": np.stack([inputs[f"albedo.{band}"] for band in "RGB"], -1),
            "valid": inputs["valid"].astype(np.uint8),
            "intensity": frames["illumination"].channels["intensity.Y"],
            "distance": frames["illumination"].channels["distance.Z"],
            "tint": np.stack([frames["illumination"].channels[name] for name in TINT], -1),
            **{
                kind: np.stack([frames[kind].channels[band] for band in "RGB"], -1)
                for kind in ("shading", "color")
            },
            "visibility": frames["visibility"].channels["visibility.Y"],
            "K": view.intrinsics,
            "camera_to_world": view.pose,
        }
        scale = np.float32(row["radiance_scale"])
        assert scale == frames["color"].radiance_scale
        for name in ("intensity", "shading", "color"):
            expected[name] = (expected[name] / scale).astype(row[name].dtype)
        for name, values in expected.items():
            assert row[name].dtype == values.dtype, name
            assert row[name].tobytes() == values.tobytes(), name
        assert row["seed"] == -5, "64-bit seeds are kept in two's complement"
        assert (row["spp"], row["noise_color"], row["score"]) == (64, 0.125, view.score)
        exposure = exposure_of(frames["color"].rgb, params.tone)
        assert (row["exposure_color"], row["white_color"]) == (exposure.scale, exposure.white)
        assert (row["licence"], row["source"]) == ("CC0-1.0", "procedural")
        assert "A. Maker" in row["attribution"]
        assert read_picture(row["preview"]["bytes"]).shape == (24, 32, 3)


def test_objects_are_counted_in_the_image_itself(tmp_path: Path) -> None:
    """And not in the small picture by which the view was chosen."""
    params = small_params()
    data = make_data(tmp_path, params, scenes=1, views=1)
    view = make_view(params, "home-0000", 0)
    channels = box_frames(view, params)["inputs"]
    numbers = channels["object"].copy()
    numbers[:4], numbers[10, :7] = 2, 3  # the sofa; less than 1 % of the lamp
    write_view(data, "inputs", {**channels, "object": numbers}, view)
    pack_dataset(data, params)
    assert [row["objects"] for row in all_rows(data)] == [1] != [len(view.seen)]


def test_columns_come_in_the_documented_order_with_units(packed: Path) -> None:
    schema = pq.read_schema(next((packed / "dataset").glob("train-*.parquet")))
    columns = dataset_columns(small_params())
    assert schema.names == [column.name for column in columns]
    for name in ("depth", "normal", "reflectance", "intensity", "distance", "shading", "color"):
        field = schema.field(name)
        assert pa.types.is_binary(field.type) and not field.nullable, name
        assert field.metadata[b"encoding"] == b"npy byte planes"
    assert schema.field("depth").metadata[b"dtype"] == b"float32"
    assert schema.field("depth").metadata[b"unit"] == b"metre"
    assert all(field.metadata[b"description"] for field in schema)


def test_pages_are_compressed_by_what_is_in_them(packed: Path) -> None:
    file = pq.ParquetFile(next((packed / "dataset").glob("train-*.parquet")))
    assert file.metadata.metadata[b"pbrnet"] == b"2"
    group = file.metadata.row_group(0)
    others = {channel.name for channel in dataset_channels(KINDS)}  # of whatever compresses best
    for index in range(group.num_columns):
        column = group.column(index)
        name = column.path_in_schema
        image = name in ("depth", "color", "normal", "valid", "intensity")
        assert column.compression == (
            "LZ4" if image else "UNCOMPRESSED" if name.endswith(".bytes") else "ZSTD"
        ) or (name in others and not image)
        assert column.has_offset_index, "readers can fetch single rows"
        assert not (image and (column.has_dictionary_page or column.is_stats_set))


def test_row_groups_are_smaller_where_rows_are_large(tmp_path: Path) -> None:
    params = Params(
        image=ImageParams(640, 480), illumination=IlluminationParams(640, shadow_rays=0)
    )
    columns = dataset_columns(params)
    row = sum(column.image_bytes for column in columns)
    writer = ShardWriter(tmp_path, "train", columns, 16, 10**9)
    assert writer.row_group == (64 << 20) // row == 5
    huge = dataset_columns(replace(params, image=ImageParams(4096, 4096)))
    assert ShardWriter(tmp_path, "train", huge, 16, 10**9).row_group == 1


def test_hugging_face_datasets_reads_it(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    datasets = pytest.importorskip("datasets")
    files = {
        split: str(packed / "dataset" / f"{split}-*.parquet")
        for split in ("train", "validation", "test")
    }
    loaded = datasets.load_dataset("parquet", data_files=files, cache_dir=str(tmp_path / "cache"))
    assert {split: len(part) for split, part in loaded.items()} == {
        "train": 6,
        "validation": 3,
        "test": 3,
    }
    assert isinstance(loaded["train"].features["preview"], datasets.Image)
    first = loaded["train"][0]
    assert first["preview"].size == (32, 24)
    ours = next(row for row in all_rows(packed) if row["split"] == "train")
    planes = np.load(io.BytesIO(first["color"]))
    assert np.array_equal(np.stack(planes, -1).view(planes.dtype.names[0])[..., 0], ours["color"])
    assert np.array_equal(first["K"], ours["K"]) and np.shape(first["K"]) == (3, 3)


def test_no_scene_is_in_two_splits_and_rows_stand_in_order(packed: Path) -> None:
    split_of: dict[str, str] = {}
    for path in sorted((packed / "dataset").glob("*.parquet")):
        table = pq.read_table(path, columns=["scene_id", "view_id", "split"]).to_pylist()
        assert table == sorted(table, key=lambda row: (row["scene_id"], row["view_id"]))
        for row in table:
            assert path.name.startswith(row["split"])
            assert split_of.setdefault(row["scene_id"], row["split"]) == row["split"]
    assert set(split_of.values()) == {"train", "validation", "test"}


def sources(count: int, **fields: Any) -> list[Source]:
    """Scenes in four light settings, without views."""
    settings = ("day", "evening", "night", "mixed")
    return [
        Source(box_scene(f"home-{index:03d}", settings[index % 4], **fields), None)
        for index in range(count)
    ]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 12, 100])
def test_splits_follow_the_shares_and_none_is_empty_by_chance(count: int) -> None:
    for seed in range(5):
        sizes = Counter(split_plans(sources(count), SplitParams(), seed).values())
        assert sizes["train"] >= 1
        assert sizes["test"] == (max(1, round(0.2 * count)) if count >= 2 else 0)
        assert sizes["validation"] == (max(1, round(0.1 * count)) if count >= 3 else 0)


def test_every_split_sees_every_light_setting() -> None:
    scenes = sources(60)
    splits = split_plans(scenes, SplitParams(), 3)
    for split, least in (("test", 2), ("validation", 1), ("train", 9)):
        settings = Counter(
            source.scene.lighting for source in scenes if splits[source.plan] == split
        )
        assert min(settings[name] for name in ("day", "evening", "night", "mixed")) >= least


def test_scenes_of_one_plan_stay_together() -> None:
    scenes = [
        Source(box_scene(f"home-{index:03d}", "day", plan=f"plan-{index // 4}"), None)
        for index in range(24)
    ]
    splits = split_plans(scenes, SplitParams(), 0)
    assert set(splits) == {f"plan-{index}" for index in range(6)}


def test_plans_kept_back_are_tested_on_and_leave_the_others_where_they_are() -> None:
    own = sources(20)
    others = [Source(box_scene(f"villa-{index}", "day"), None) for index in range(5)]
    splits = split_plans(own + others, SplitParams(test_only=("villa-[0-3]", "home-000")), 0)
    assert {splits[f"villa-{index}"] for index in range(4)} == {"test"}
    assert splits["home-000"] == "test"
    del splits["home-000"], splits["villa-0"], splits["villa-1"], splits["villa-2"]
    del splits["villa-3"]
    assert splits == split_plans(own[1:] + others[4:], SplitParams(), 0)


def test_a_scene_is_kept_back_with_its_whole_plan() -> None:
    scenes = [
        Source(box_scene(f"{kind}-{index}", "day", plan=f"{kind}-plan-{index // 2}"), None)
        for kind in ("home", "furnished")
        for index in range(10)
    ]
    splits = split_plans(scenes, SplitParams(test_only=("furnished-*", "home-5")), 0)
    assert {splits[f"furnished-plan-{index}"] for index in range(5)} == {"test"}
    assert splits["home-plan-2"] == "test"
    assert kept_back(("b*",), {"a0": "p", "b0": "p", "c": "q"}) == {"p"}


def test_adding_scenes_hardly_moves_the_others() -> None:
    before = split_plans(sources(40), SplitParams(), 0)
    after = split_plans(sources(44), SplitParams(), 0)
    moved = [plan for plan, split in before.items() if after[plan] != split]
    assert len(moved) <= 4
    assert split_plans(list(reversed(sources(40))), SplitParams(), 0) == before
    assert split_plans(sources(40), SplitParams(), 1) != before, "the seed deals the plans"


def test_the_same_frames_give_the_same_bytes(packed: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    params = small_params(row_group=2)
    for name in ("scenes", "cameras", "inputs", "illumination", "visibility", "shading", "color"):
        shutil.copytree(packed / name, again / name)
    pack_dataset(again, params)
    assert digest_folder(again / "dataset") == digest_folder(packed / "dataset")


def test_a_shard_is_capped_and_memory_holds_one_row_group(tmp_path: Path) -> None:
    params = small_params(row_group=4, shard_mb=1)
    params = replace(params, image=replace(params.image, width=128, height=96))
    make_data(tmp_path, params, scenes=2, views=24)
    random = np.random.default_rng(0)
    for index in range(2):
        for number in range(24):
            view = make_view(params, f"home-{index:04d}", number)
            noise = random.uniform(0.5, 1.5, (3, 96, 128))
            write_view(tmp_path, "color", dict(zip("RGB", noise, strict=True)), view)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    summary = pack_dataset(tmp_path, params)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    shards = sorted((tmp_path / "dataset").glob("train-*.parquet"))
    assert len(shards) >= 2
    assert all(path.stat().st_size <= 1_000_000 + 20_000 for path in shards), "cap and footer"
    names = [f"train-{index:05d}-of-{len(shards):05d}.parquet" for index in range(len(shards))]
    assert [path.name for path in shards] == names
    assert sum(pq.read_metadata(path).num_rows for path in shards) == summary.rows["train"]
    groups = pq.ParquetFile(shards[0]).metadata
    assert groups.row_group(0).num_rows == 4
    assert grown < 60, f"{grown:.0f} MB for 24 views of 0.4 MB"


def spoil(kind: str, **changes: Any) -> Any:
    """A function that writes the view's `kind` frame with some channels or metadata changed."""

    def write(data: Path, view: Any) -> None:
        channels = box_frames(view, small_params())[kind]
        notes = ("noise", "lost_pixels", "firefly_light", "radiance_scale")
        meta = {key: changes[key] for key in notes if key in changes}
        for name, value in changes.items():
            if name in (*notes, "rgb"):
                continue
            channels[name] = value(channels[name])
        if "rgb" in changes:
            channels = {name: changes["rgb"](np.array(channels[name])) for name in "RGB"}
        write_view(data, kind, channels, view, **meta)

    return write


def remove(data: Path, view: Any) -> None:
    """The panorama is gone."""
    frame_path(data, "illumination", view).unlink()


def fail(data: Path, view: Any) -> None:
    """The renderer gave up on the view and said so."""
    remove(data, view)
    listed = [{"scene_id": view.scene_id, "view_id": view.view_id, "error": "no light\nat all"}]
    (data / "failures").mkdir()
    (data / "failures" / "illumination.json").write_text(json.dumps(listed))


def truncate(data: Path, view: Any) -> None:
    """Half of the file is missing."""
    path = frame_path(data, "color", view)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip_bit(data: Path, view: Any) -> None:
    """One bit of the pixel data turned over."""
    path = frame_path(data, "color", view)
    content = bytearray(path.read_bytes())
    content[-40] ^= 16
    path.write_bytes(bytes(content))


def foreign(data: Path, view: Any) -> None:
    """Not an EXR at all."""
    frame_path(data, "inputs", view).write_bytes(b"GIF89a" + bytes(100))


def other_kind(data: Path, view: Any) -> None:
    """A shading frame where the colour frame belongs."""
    shutil.copy(frame_path(data, "shading", view), frame_path(data, "color", view))


def other_camera(data: Path, view: Any) -> None:
    """A frame of the neighbouring view under this one's name."""
    other = make_view(small_params(), view.scene_id, 2)
    turned = replace(other, view_id=view.view_id)
    write_view(data, "shading", box_frames(turned, small_params())["shading"], turned)


def other_lens(data: Path, view: Any) -> None:
    """A frame through another lens of the same focal length."""
    made = replace(view, distortion=(0.1, 0.0, 0.0, 0.0))
    write_view(data, "color", box_frames(view, small_params())["color"], made)


def other_size(data: Path, view: Any) -> None:
    """A frame of half the size."""
    params = small_params()
    small = replace(params, image=replace(params.image, width=16, height=12))
    channels = box_frames(replace(view, width=16, height=12), small)["color"]
    write_view(data, "color", channels, view)


def half_black(values: np.ndarray) -> np.ndarray:
    """All but one pixel in twenty without light."""
    values = values.copy()
    values.ravel()[np.arange(values.size) % 20 != 0] = 0
    return values


def speckled(values: np.ndarray) -> np.ndarray:
    """Every fourth pixel of every fourth row a thousand times too bright."""
    values = values.copy()
    values[::4, ::4] = 1000 * values.max()
    return values


@pytest.mark.parametrize(
    ("reason", "word", "change"),
    [
        ("missing", "illumination", remove),
        ("failed", "no light at all", fail),
        ("damaged", "color", truncate),
        ("damaged", "color", flip_bit),
        ("damaged", "inputs", foreign),
        ("damaged", "kind 'shading'", other_kind),
        ("stale", "camera_to_world", other_camera),
        ("stale", "distortion", other_lens),
        ("size", "16x12", other_size),
        ("negative", "-1", spoil("shading", rgb=lambda values: values - 1 - values)),
        ("inconsistent", "depth", spoil("inputs", Z=lambda values: values * 0)),
        ("inconsistent", "normals", spoil("inputs", **{"N.X": lambda values: values + 1})),
        ("few_surfaces", "0.0%", spoil("inputs", valid=lambda values: values * 0)),
        ("black", "color", spoil("color", rgb=half_black)),
        ("blown_out", "100.0%", spoil("color", rgb=lambda v: v * 0 + 1e9, radiance_scale=1.0)),
        ("fireflies", "shading", spoil("shading", rgb=speckled)),
        ("fireflies", "60.0% of the light", spoil("shading", firefly_light=0.6)),
        ("noise", "0.95", spoil("color", noise=0.95)),
        ("not_finite", "3 pixels without", spoil("color", lost_pixels=3)),
    ],
)
def test_a_bad_view_is_listed_with_its_reason(
    tmp_path: Path, reason: str, word: str, change: Any
) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=1, views=3)
    view = make_view(params, "home-0000", 1)
    change(data, view)
    summary = pack_dataset(data, params)
    (line,) = rejected_of(data)
    assert (line["scene_id"], line["view_id"], line["reason"]) == ("home-0000", "001", reason)
    assert word in line["detail"]
    assert str(tmp_path) not in line["detail"], "the list must not depend on where it was made"
    assert [row["view_id"] for row in all_rows(data)] == ["000", "002"]
    assert summary.sampled == 3 == summary.total + 1
    assert REASONS[reason] in (data / "dataset" / "README.md").read_text()


@pytest.mark.parametrize("whole", [False, True])
def test_a_walk_with_a_rejected_frame_is_named_or_rejected_whole(
    tmp_path: Path, whole: bool
) -> None:
    params = small_params(checks=CheckParams(whole_walks=whole))
    data = make_data(tmp_path, params, scenes=2, views=3)
    path = data / "cameras" / "home-0000.json"
    cameras = load_cameras(path)
    walk = [
        replace(view, trajectory="walk-00" if number else "", frame=number - 1)
        for number, view in enumerate(cameras.views)
    ]
    save_cameras(path, replace(cameras, views=tuple(walk)))
    frame_path(data, "color", walk[2]).unlink()
    summary = pack_dataset(data, params)
    reasons = [(line["view_id"], line["reason"]) for line in rejected_of(data)]
    if whole:
        assert reasons == [("001", "walk"), ("002", "missing")] and not summary.walks
        require_whole_walks(summary)
    else:
        assert reasons == [("002", "missing")]
        with pytest.raises(StageError, match=r"home-0000/walk-00 \(1 frame\)"):
            require_whole_walks(summary)
    assert summary.total == 6 - len(reasons)


def test_parts_of_the_paper_are_packed_without_the_rest(tmp_path: Path) -> None:
    params = replace(small_params(), channels=("depth", "normal"))
    assert params.kinds == ("inputs",)
    data = make_data(tmp_path, small_params(), scenes=3, views=2)
    for kind in ("color", "shading", "illumination", "visibility"):
        shutil.rmtree(data / kind, ignore_errors=True)
    assert pack_dataset(data, params).total == 6
    row = all_rows(data)[0]
    assert {"depth", "normal", "valid", "preview_depth", "K", "renderer"} <= row.keys()
    assert not {"reflectance", "color", "shading", "intensity", "exposure_color"} & row.keys()
    assert not {"preview", "spp", "seed", "noise_color", "visibility"} & row.keys()
    card = (data / "dataset" / "README.md").read_text()
    assert "path traced" not in card and "`depth`" in card
    with pytest.raises(ValueError, match="light needs color"):
        replace(params, channels=("depth", "light")).verify("")


@pytest.mark.parametrize(
    ("sets", "kinds"),
    [
        (("paper",), ("inputs", "illumination", "shading", "color")),
        (("video",), ("inputs", "illumination", "shading", "color", "video")),
        (("video", "depth"), ("inputs", "video")),
        (("color", "light"), ("inputs", "color", "light")),
        (("depth", "all"), kinds_of_sets(("all",))),
    ],
)
def test_kinds_of_parts(sets: tuple[Any, ...], kinds: tuple[str, ...]) -> None:
    assert {*kinds_of_sets(sets)} == {*kinds}


def test_what_is_packed_is_kept_until_something_changes(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=2, views=2)
    first = pack_dataset(data, params)
    before = digest_folder(data / "dataset")
    again = pack_dataset(data, params)
    assert not again.packed and is_packed(data, params)
    assert (again.rows, again.bytes, again.files) == (first.rows, first.bytes, first.files)
    assert summary_lines(again, data)[:2] == summary_lines(first, data)[:2]
    shard = data / "dataset" / first.files[0]
    shard.write_bytes(shard.read_bytes()[:-1] + b"?")
    assert pack_dataset(data, params).packed, "a damaged shard"
    frame = next((data / "color").rglob("*.exr"))
    frame.touch()
    assert not is_packed(data, params)
    assert pack_dataset(data, params).packed, "a frame that was written again"
    assert digest_folder(data / "dataset") == before
    others = replace(params, tone=replace(params.tone, key=0.5))
    assert pack_dataset(data, others).packed, "another parameter"
    assert not pack_dataset(data, others).packed
    (data / "packed.json").write_text("[]")
    assert pack_dataset(data, others).packed, "a damaged list"


def test_nan_is_refused_even_where_another_program_wrote_it() -> None:
    params = small_params()
    view = make_view(params, "home-0000", 0)
    meta = {"view": {"scene_id": view.scene_id, "view_id": view.view_id}}
    meta["view"] |= {"camera_to_world": view.camera_to_world, "K": view.K}
    frames = {kind: Frame(pixels, meta) for kind, pixels in box_frames(view, params).items()}
    assert check_surfaces(view, frames, params.size_of("inputs"), CheckParams(), {}) is None
    others = ({kind: params.size_of(kind) for kind in frames}, CheckParams(), 0)
    assert check_light(view, frames, *others) is None
    frames["shading"].channels["G"] = np.full((24, 32), np.nan)
    wrong = check_light(view, frames, *others)
    assert wrong is not None and wrong.reason == "not_finite" and "768 pixels" in wrong.detail


def test_shares_are_what_they_say() -> None:
    image = np.ones((10, 10, 3), np.float32)
    assert (black_share(image), blown_share(image), firefly_share(image)) == (0, 0, 0)
    image[0, :5] = 0
    image[5, 5, 1] = HALF_MAX
    assert black_share(image) == pytest.approx(0.05)
    assert blown_share(image) == pytest.approx(0.01)
    assert firefly_share(image) == pytest.approx(0.01)


def test_the_grain_of_an_undersampled_image_is_not_fireflies() -> None:
    random = np.random.default_rng(0)
    hits = random.random((120, 160, 1)) < 0.3
    image = np.where(hits, random.uniform(0.5, 2, (120, 160, 1)), 0) * np.ones(3)
    assert firefly_share(image.astype(np.float32)) == 0


def test_a_bright_window_is_not_a_firefly() -> None:
    image = np.full((24, 32, 3), 0.01, np.float32)
    image[5:12, 8:20] = 50.0
    assert firefly_share(image) == 0


def test_rejections_that_empty_a_split_deal_the_rest_again(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=5, views=1)
    pack_dataset(data, params)
    (victim,) = {row["scene_id"] for row in all_rows(data) if row["split"] == "test"}
    shutil.rmtree(data / "color" / victim)
    summary = pack_dataset(data, params)
    assert summary.rows == {"train": 2, "validation": 1, "test": 1}
    assert [line["scene_id"] for line in rejected_of(data)] == [victim]


def test_scenes_without_any_view_are_listed(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=2)
    add_scene(data, params, "home-empty", views=0)
    pack_dataset(data, params)
    with (data / "dataset" / "scenes.csv").open(newline="") as stream:
        lines = {line["scene_id"]: line for line in csv.DictReader(stream)}
    assert lines["home-empty"]["views"] == lines["home-empty"]["rows"] == "0"
    assert lines["home-empty"]["rooms_without_view"] == "room-0 room-1"
    assert lines["home-0000"]["rooms_without_view"] == "room-1"


def test_nothing_usable_is_an_error_and_keeps_the_old_dataset(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=1)
    pack_dataset(data, params)
    before = digest_folder(data / "dataset")
    shutil.rmtree(data / "color")
    with pytest.raises(InputError, match="missing: 3"):
        pack_dataset(data, params)
    assert digest_folder(data / "dataset") == before
    assert not list(data.glob(".partial-*"))


def test_a_broken_camera_file_is_named(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=1)
    path = data / "cameras" / "home-0000.json"
    path.write_text(path.read_text()[:200])
    with pytest.raises(InputError, match=r"home-0000\.json: not valid JSON"):
        pack_dataset(data, params)


def test_cameras_without_their_scene_are_named(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=2)
    shutil.rmtree(data / "scenes" / "home-0001")
    with pytest.raises(InputError, match="no scene 'home-0001'"):
        pack_dataset(data, params)


def test_foreign_files_in_the_data_folder_do_no_harm(tmp_path: Path) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=1)
    (data / "cameras" / "notes.txt").write_text("mine")
    (data / "color" / "home-0000" / "thumbs.db").write_bytes(b"x")
    (data / "scenes" / "stray").mkdir()
    (data / ".partial-killed").mkdir()  # what a killed run leaves
    assert pack_dataset(data, params).total == 3
    assert (data / "cameras" / "notes.txt").exists()
    assert not (data / ".partial-killed").exists()


def test_a_full_disk_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    params = small_params()
    data = make_data(tmp_path, params, scenes=3)

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq.ParquetWriter, "write_table", full)
    with pytest.raises(MachineError, match="disk is full"):
        pack_dataset(data, params)
    assert not (data / "dataset").exists() and not list(data.glob(".partial-*"))


def test_the_card_is_a_hugging_face_card(packed: Path) -> None:
    text = (packed / "dataset" / "README.md").read_text()
    matter = yaml.safe_load(text.split("---\n")[1])
    assert matter["license"] == "cc0-1.0"
    files = matter["configs"][0]["data_files"]
    assert [entry["split"] for entry in files] == ["train", "validation", "test"]
    for entry in files:
        assert list((packed / "dataset").glob(entry["path"]))
    for column in dataset_columns(small_params()):
        assert f"`{column.name}`" in text
    assert "A. Maker" in text


def test_foreign_authors_cannot_break_the_card(tmp_path: Path) -> None:
    params = small_params()
    hostile = "<script>x</script> | a\n---\n# head [l](javascript:1) `\x1b[2J <!--"
    credit = Credit("everything", hostile, hostile, hostile, hostile)
    data = make_data(tmp_path, params, scenes=1, credits=(credit,))
    for path in (data / "scenes").glob("*/scene.json"):
        content = json.loads(path.read_text())
        path.write_text(json.dumps({**content, "source": {"kind": f"# {hostile}"}}))
    pack_dataset(data, params)
    text = (data / "dataset" / "README.md").read_text()
    matter, _, body = text.removeprefix("---\n").partition("---\n")
    assert yaml.safe_load(matter)["license"] == "other" and "# head" in matter
    for found in ("<script", "<!--", "\n# head", " [l](", "\x1b", " | a "):
        assert found not in body, found
    (row,) = (line for line in body.splitlines() if line.count("script>x") == 4)
    assert len(re.findall(r"(?<!\\)\|", row)) == 6
    described = json.loads((data / "dataset" / "croissant.json").read_text())
    assert all(re.fullmatch(r"[\w:/.%-]+", url) for url in described["license"])


def test_croissant_names_every_shard_with_its_checksum_and_every_column(packed: Path) -> None:
    folder = packed / "dataset"
    described = json.loads((folder / "croissant.json").read_text())
    assert described["@type"] == "sc:Dataset"
    assert described["conformsTo"][0] == "http://mlcommons.org/croissant/1.1"
    for key in ("@context", "name", "description", "license", "url", "creator", "citeAs"):
        assert described[key], key
    files = {item["@id"]: item for item in described["distribution"] if "sha256" in item}
    assert sorted(files) == sorted(path.name for path in folder.glob("*.parquet"))
    for name, item in files.items():
        checksum = subprocess.run(
            ["sha256sum", folder / name], capture_output=True, text=True, check=True
        ).stdout.split()[0]
        assert item["sha256"] == checksum
    views = next(item for item in described["recordSet"] if item["name"] == "views")
    names = [column.name for column in dataset_columns(small_params())]
    assert [field["name"] for field in views["field"]] == names
    ids = {item["@id"] for item in described["distribution"]}
    assert {field["source"]["fileSet"]["@id"] for field in views["field"]} <= ids


def test_checksums_find_what_is_damaged_missing_or_foreign(packed: Path, tmp_path: Path) -> None:
    folder = tmp_path / "dataset"
    shutil.copytree(packed / "dataset", folder)
    inspect = ["inspect", str(folder), "--verify", "--text-only"]
    assert "files match their checksums" in CliRunner().invoke(cli, inspect).output
    done = subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder)
    assert done.returncode == 0
    assert verify_sums(folder) == len(list(folder.iterdir())) - 1
    shard = next(folder.glob("train*.parquet"))
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    (folder / "scenes.csv").unlink()
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(InputError) as caught:
        verify_sums(folder)
    for words in (f"{shard.name} is damaged", "scenes.csv is missing", "notes.txt is not on"):
        assert words in str(caught.value)
    (folder / "SHA256SUMS").write_text("../../etc/passwd\n")
    with pytest.raises(InputError, match="is not a checksum"):
        verify_sums(folder)
    (folder / "SHA256SUMS").unlink()
    result = CliRunner().invoke(cli, inspect)
    assert result.exit_code and isinstance(result.exception, InputError)


def test_the_command_packs_and_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pbrnet_run: Run
) -> None:
    params = small_params()
    make_data(tmp_path / "data", params, scenes=1)
    values = {"image": {"width": 32, "height": 24}, "illumination": {"width": 32}}
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(values))
    monkeypatch.chdir(tmp_path)
    code, said, errors = pbrnet_run("dataset")
    assert code == 0, errors
    assert "3 views sampled, 3 rows" in said
    assert (tmp_path / "data" / "dataset" / "README.md").is_file()
