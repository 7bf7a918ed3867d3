"""The dataset reader: every row once, seeded, resumable, bounded, and clear about bad files."""

from collections import Counter
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pbrnet.model.data.direct_light import panorama_radiance
from pbrnet.model.data.encoding import encode, input_named
from pbrnet.model.data.reader import Dataset, _convert, coin_flips, mirrored
from pbrnet.scenes.color import encode_srgb
from pbrnet.scenes.errors import InputError
from tests.fixtures.model import UNIT, box_dataset, box_rows, box_view, write_shard

SIZE = {"width": 8, "height": 6, "panorama": 8}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty rows in two shards, row groups of four."""
    folder = tmp_path_factory.mktemp("rows") / "dataset"
    rows = box_rows([f"room-{index}" for index in range(15)], 2, "train", **SIZE)
    write_shard(folder / "train-00000-of-00002.parquet", rows[:18])
    write_shard(folder / "train-00001-of-00002.parquet", rows[18:])
    return folder


def names(stream: object, count: int) -> list[str]:
    return [example.name for example in islice(stream, count)]  # type: ignore[call-overload]


def test_ordered_reading_gives_back_what_was_packed(folder: Path) -> None:
    examples = list(Dataset(folder, "train").ordered())
    assert [example.name for example in examples][:3] == [
        "room-0/v000",
        "room-0/v001",
        "room-1/v000",
    ]
    assert len(examples) == 30
    images = box_view(sum(b"room-0") * 100, **SIZE)
    for name in (
        "depth",
        "normal",
        "reflectance",
        "intensity",
        "distance",
        "tint",
        "shading",
        "color",
    ):
        read = examples[0][name]
        assert read.dtype == np.float32
        assert np.array_equal(read, images[name].astype(np.float32)), name
    assert examples[0]["valid"].dtype == bool and examples[0]["valid"].all()


def test_rows_come_by_number_in_the_order_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = Dataset(folder, "train")
    everything = names(dataset.ordered(), 30)
    loads: list[tuple[int, int]] = []
    load = Dataset._load
    monkeypatch.setattr(
        Dataset,
        "_load",
        lambda self, shard, group, wanted: (
            loads.append((shard, group)) or load(self, shard, group, wanted)
        ),
    )
    chosen = [29, 3, 18, 0]
    assert names(dataset.at(chosen), 30) == [everything[number] for number in chosen]
    assert loads == [(1, 2), (0, 0), (1, 0)], "each row group once, no other"


def test_every_pass_visits_every_row_once_in_an_order_of_its_own(folder: Path) -> None:
    stream = Dataset(folder, "train").shuffled(seed=5, buffer=6)
    first, second = names(stream, 30), names(stream, 30)
    assert set(Counter(first).values()) == {1} and len(first) == 30
    assert sorted(first) == sorted(second)
    assert first != second
    assert first != sorted(first)


def test_the_order_depends_on_the_seed_alone(folder: Path) -> None:
    orders = [names(Dataset(folder, "train").shuffled(seed), 30) for seed in (0, 0, 1)]
    assert orders[0] == orders[1] != orders[2]


@pytest.mark.parametrize("start", [1, 7, 29, 30, 44])
def test_a_position_is_all_it_takes_to_go_on(folder: Path, start: int) -> None:
    whole = names(Dataset(folder, "train").shuffled(3, buffer=6), 75)
    assert (
        names(Dataset(folder, "train").shuffled(3, buffer=6, start=start), 75 - start)
        == whole[start:]
    )
    flips = list(islice(coin_flips(3, 0, 30), 75))
    assert list(islice(coin_flips(3, start, 30), 75 - start)) == flips[start:]
    assert 20 < sum(flips) < 55


def test_rows_that_were_read_stay_as_they_were(folder: Path) -> None:
    """Memory of decoded rows is used again, that of examples is not."""
    dataset = Dataset(folder, "train")
    kept = [*dataset.ordered(), *islice(dataset.shuffled(2, buffer=5), 40)]
    anew = {example.name: example for example in Dataset(folder, "train").at(range(30))}
    assert len(kept) == 70 and len(anew) == 30
    for example in kept:
        other = anew[example.name]
        assert np.array_equal(example.intrinsics, other.intrinsics)
        for name in dataset.images:
            assert np.array_equal(example[name], other[name]), name


def test_half_floats_are_converted_as_numpy_does() -> None:
    """Every one of them, in more than one piece, not whole ones only."""
    halves = np.arange(2**16, dtype=np.uint16).view(np.float16)
    stored = np.concatenate([halves, halves[:1001]])
    for scale in (1.0, 2.0**-9, 2.0**7):
        image = np.full(len(stored), -1, np.float32)
        _convert(stored, image, scale)
        expected = stored.astype(np.float32) * np.float32(scale)
        assert np.array_equal(image, expected, equal_nan=True)


def test_no_more_than_the_buffer_and_one_row_group_are_held(folder: Path) -> None:
    dataset = Dataset(folder, "train")
    most = 0
    for _ in islice(dataset.shuffled(1, buffer=6), 60):
        most = max(most, dataset.held)
    assert 6 <= most < 6 + 4


def test_a_mirrored_view_is_the_view_in_a_mirror(folder: Path) -> None:
    example = next(Dataset(folder, "train").ordered())
    mirror = mirrored(example)
    assert np.array_equal(mirror["depth"], example["depth"][:, ::-1])
    assert np.array_equal(mirror["intensity"], example["intensity"][:, ::-1])
    assert np.array_equal(mirror["normal"][..., 0], -example["normal"][:, ::-1, 0])
    assert np.array_equal(mirror["normal"][..., 1:], example["normal"][:, ::-1, 1:])
    twice = mirrored(mirror)
    assert all(
        np.array_equal(twice[name], example[name])
        for name in ("depth", "normal", "color", "distance")
    )


def test_an_image_column_is_an_input_of_networks_as_it_is(folder: Path) -> None:
    """A channel that a network reads needs no line in the reader or the encoder."""
    example = next(Dataset(folder, "train", ("tint",)).ordered())
    (found,) = encode([example], ("tint",))["tint"]
    assert np.array_equal(found.permute(1, 2, 0).numpy(), example["tint"])
    with pytest.raises(InputError, match="no emission; add 'materials' to channels"):
        encode([example], ("emission",))


def test_brightening_every_light_changes_no_input(folder: Path) -> None:
    example = next(Dataset(folder, "train").ordered())
    brighter = example.having(intensity=example["intensity"] * 1000)
    for name, value in encode([example]).items():
        assert np.allclose(value, encode([brighter])[name], rtol=1e-5), name


def test_a_view_without_any_light_is_encoded_without_nan(folder: Path) -> None:
    example = next(Dataset(folder, "train").ordered())
    dark = example.having(
        intensity=0 * example["intensity"], depth=0 * example["depth"], valid=~example["valid"]
    )
    assert all(value.isfinite().all() for value in encode([dark]).values())


def test_what_is_no_surface_reaches_the_composition_as_grey_not_as_black(folder: Path) -> None:
    example = next(Dataset(folder, "train").ordered())
    window = example.having(reflectance=0 * example["reflectance"], valid=0 * example["valid"] > 0)
    given = encode([window])["reflectance"]
    assert np.allclose(given, 2 * encode_srgb(np.float32(0.5)) - 1)


def test_no_dataset_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no dataset shards here.*pbrnet dataset"):
        Dataset(tmp_path, "train")


def test_an_empty_split(folder: Path) -> None:
    with pytest.raises(InputError, match="the test split is empty"):
        Dataset(folder, "test")


def test_a_missing_shard(folder: Path, tmp_path: Path) -> None:
    shard = folder / "train-00001-of-00002.parquet"
    (tmp_path / shard.name).write_bytes(shard.read_bytes())
    with pytest.raises(InputError, match="1 of 2 train shards"):
        Dataset(tmp_path, "train")


@pytest.mark.parametrize("keep", [0, 3, 100, 0.5, 0.99])
def test_a_truncated_shard(tmp_path: Path, keep: float) -> None:
    box_dataset(tmp_path, 4, 0, 0, **SIZE)
    shard = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    content = shard.read_bytes()
    shard.write_bytes(content[: int(keep * len(content)) if isinstance(keep, float) else keep])
    with pytest.raises(InputError, match=r"train-00000-of-00001.parquet: damaged"):
        Dataset(tmp_path / "dataset", "train")


def test_damage_inside_a_shard(tmp_path: Path) -> None:
    box_dataset(tmp_path, 4, 0, 0, **SIZE)
    shard = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    content = bytearray(shard.read_bytes())
    content[40 : len(content) // 2] = bytes(len(content) // 2 - 40)
    shard.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        list(Dataset(tmp_path / "dataset", "train").ordered())


def test_a_foreign_table(tmp_path: Path) -> None:
    pq.write_table(pa.table({"a": [1, 2]}), tmp_path / "train-00000-of-00001.parquet")
    with pytest.raises(InputError, match="not a dataset of this project: the column 'scene_id'"):
        Dataset(tmp_path, "train")


def test_a_dataset_from_before_lights_had_colours_is_read_as_white(tmp_path: Path) -> None:
    box_dataset(tmp_path, 2, 0, 0, **SIZE)
    shard = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    (now,) = list(Dataset(tmp_path / "dataset", "train").ordered())[:1]
    pq.write_table(pq.read_table(shard).drop_columns(["tint"]), shard)
    (before,) = list(Dataset(tmp_path / "dataset", "train").ordered())[:1]
    assert "tint" not in before and "tint" in now
    assert np.array_equal(panorama_radiance(before), panorama_radiance(now))  # its lamp is white
    assert "tint" not in mirrored(before)


def test_the_unit_of_radiance_is_undone(tmp_path: Path) -> None:
    """A dataset from before has no unit: its radiance is the renderer's. Others must be powers."""
    box_dataset(tmp_path, 2, 0, 0, **SIZE)
    shard = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    table = pq.read_table(shard)
    (now,) = list(Dataset(tmp_path / "dataset", "train").ordered())[:1]
    pq.write_table(table.drop_columns(["radiance_scale"]), shard)
    (bare,) = list(Dataset(tmp_path / "dataset", "train").ordered())[:1]
    for name in ("intensity", "shading", "color"):
        assert np.array_equal(now[name], np.float32(UNIT) * bare[name]), name
    assert np.array_equal(now["depth"], bare["depth"]) and UNIT != 1
    index = table.schema.get_field_index("radiance_scale")
    wrong = pa.array([0.3] * len(table), pa.float32())
    pq.write_table(table.set_column(index, table.schema.field(index), wrong), shard)
    with pytest.raises(InputError, match="not a power of two"):
        list(Dataset(tmp_path / "dataset", "train").ordered())


def test_images_without_shape(tmp_path: Path) -> None:
    box_dataset(tmp_path, 4, 0, 0, **SIZE)
    shard = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    table = pq.read_table(shard)
    bare = pa.schema([field.remove_metadata() for field in table.schema])
    pq.write_table(pa.Table.from_arrays(table.columns, schema=bare), shard)
    with pytest.raises(InputError, match="'depth' has no readable shape"):
        list(Dataset(tmp_path / "dataset", "train").ordered())


def test_rows_of_another_split(tmp_path: Path) -> None:
    rows = box_rows(["room"], 2, "test", **SIZE)
    write_shard(tmp_path / "train-00000-of-00001.parquet", rows)
    with pytest.raises(InputError, match="rows of the split 'test'"):
        list(Dataset(tmp_path, "train").ordered())


def test_plans_come_from_the_list_of_scenes(folder: Path, tmp_path: Path) -> None:
    assert Dataset(folder, "train").plans() == {}
    box_dataset(tmp_path, 4, 0, 0, **SIZE)
    (tmp_path / "dataset" / "scenes.csv").write_text("scene_id,plan\nday,house\nnight,house\n")
    assert Dataset(tmp_path / "dataset", "train").plans() == {"day": "house", "night": "house"}


def test_depth_is_the_logarithm_relative_to_two_and_a_half_metres() -> None:
    depth = np.array([[0.0, 0.05, 2.5, 25.0, 1000.0]], np.float32)
    view = {"depth": depth, "valid": np.array([[0, 1, 1, 1, 1]])}
    logarithm, valid = np.moveaxis(np.asarray(input_named("depth").of(view)), -1, 0)
    expected = np.log([1.0, 0.02, 1.0, 10.0, 40.0])
    np.testing.assert_allclose(logarithm[0], expected, rtol=1e-6, atol=1e-6)
    assert valid[0].tolist() == [0, 1, 1, 1, 1]
