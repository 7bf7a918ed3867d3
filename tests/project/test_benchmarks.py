"""The benchmark program: rows computed on clocks that are known, and what it writes."""

import json
import math
import os
import struct
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from defusedxml import ElementTree

from benchmarks import cycles, farm, sets
from benchmarks.bench import SMALL, Bench, Reference, pixels
from benchmarks.budget_results import Measured, Point, best_options, budget_plot, cells
from benchmarks.budgets import fitting, without_noise
from benchmarks.clay import _bare, windows_of
from benchmarks.cycles import BlenderMissing, blender_python, cycles_rows, run_step
from benchmarks.furnished import blender_folder, thin_sheets, write_furnished
from benchmarks.results import OtherLoad, Results, page_of
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.run import TOPICS, Topic, measure
from benchmarks.shards import (
    keep_channels_of_rows,
    read_columns,
    read_exr,
    read_view,
    views_of,
)
from benchmarks.strategies import _BOTH, _SHOWN, Tried, _gain, summary
from benchmarks.submissions import submissions
from benchmarks.timing import Spent, Spread, by_turns, ratio, spread, sums
from pbrnet.model.benchmark.score import METRICS, score_folder
from pbrnet.model.benchmark.views import pin_views
from pbrnet.model.data.reader import Dataset
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.settings import GroundTruthParams, LightParams
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.splits import SplitParams
from pbrnet.scenes.contract import Light, Portal, Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.home import make_home
from tests.fixtures.dataset import make_data, make_view, small_params
from tests.fixtures.model import box_rows, write_shard
from tests.fixtures.paths import ROOT

pytestmark = pytest.mark.usefixtures("variant")


def test_a_running_child_is_no_other_program() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as child:
        try:
            load, spent = OtherLoad(), psutil.Process(child.pid)
            started = spent.cpu_times().user
            while (used := spent.cpu_times().user - started) < 0.3:
                pass
            assert OtherLoad().own - load.own > 0.9 * used
        finally:
            child.kill()


class FakeClock:
    """Time that passes only when told to; the processor's runs twice as fast as the wall's."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.log: list[str] = []

    def __call__(self) -> Spent:
        return Spent(2 * self.seconds, self.seconds)

    def work(self, name: str, *seconds: float) -> Callable[[], None]:
        """Work that takes so long the first, second ... time."""
        left = iter(seconds)

        def do() -> None:
            self.log.append(name)
            self.seconds += next(left)

        return do


def test_ways_take_turns_and_the_first_turn_does_not_count() -> None:
    clock = FakeClock()
    ways = {"a": clock.work("a", 100, 1, 2, 6), "b": clock.work("b", 50, 2, 2, 2)}
    spent = by_turns(ways, 3, clock=clock)
    assert clock.log == ["a", "b"] * 4
    assert [s.wall for s in spent["a"]] == [1, 2, 6]
    assert [s.cpu for s in spent["a"]] == [2, 4, 12]
    assert ratio(spent["a"], spent["b"], "wall") == Spread(1.0, 0.5, 3.0, 3)


def test_ratios_are_taken_turn_by_turn() -> None:
    """A machine that slows down in the middle changes no ratio."""
    slow = [Spent(0, 1), Spent(0, 10), Spent(0, 2)]
    fast = [Spent(0, 0.5), Spent(0, 5), Spent(0, 1)]
    assert ratio(slow, fast, "wall") == Spread(2.0, 2.0, 2.0, 3)


def test_no_repeats_are_refused() -> None:
    with pytest.raises(ValueError, match="no repeats"):
        spread([])


def test_the_farm_rows_compare_the_stage_with_both_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, allowed = FakeClock(), os.sched_getaffinity(0)
    seconds = {"plain": 10.0, "joint": 6.0, "1": 12.0, "2": 6.3}

    def python(*words: str) -> None:
        if "groundtruth" in words:
            way = words[words.index("--workers") + 1]
            assert len(os.sched_getaffinity(0)) == min(int(way), len(allowed))
        else:
            way = "joint" if "--joint" in words else "plain"
        clock.seconds += seconds[way]

    monkeypatch.setattr(farm, "python", python)
    monkeypatch.setattr(farm, "by_turns", partial(by_turns, clock=clock))
    monkeypatch.setattr(farm.integrator, "available", lambda: True)
    bench = Bench(tmp_path, SMALL, tmp_path)
    bench.__dict__["views"] = {"home": []}
    rows = {row.name: row for row in farm.farm_rows(bench)}
    assert os.sched_getaffinity(0) == allowed
    figures = {name: row.spread.value for name, row in rows.items() if row.spread}
    assert figures == pytest.approx(
        {
            "ground truth stage / plain loop": 0.63,
            "ground truth stage / joint loop (wall)": 1.05,
            "ground truth stage / joint loop (cpu)": 1.05,
            "two workers / one": 12 / 6.3,
        }
    )
    assert rows["two workers / one"].verdict == ">= 1.9: met"


@pytest.mark.parametrize(
    ("goal", "value", "verdict"),
    [
        (at_most(1.25), 1.25, "<= 1.25: met"),
        (at_most(1.25), 1.26, "<= 1.25: MISSED"),
        (at_least(10), 1.3, ">= 10: MISSED"),
        (at_least(1.9), 1.95, ">= 1.9: met"),
        (None, 1.0, ""),
    ],
)
def test_a_goal_is_met_or_missed(goal: object, value: float, verdict: str) -> None:
    row = Row("row", "what it means", Spread(value, value, value, 1), goal=goal)  # type: ignore[arg-type]
    assert row.verdict == verdict
    assert row.plain().get("met") == (None if goal is None else verdict.endswith(": met"))


def test_efficiency_is_error_times_seconds() -> None:
    plain = [Tried(2.0, {"color": 0.4}), Tried(3.0, {"shading": 0.2})]
    both = Tried(2.5, {"color": 0.1, "shading": 0.1})
    assert _gain(plain[:1], both, ("color",)) == pytest.approx(0.8 / 0.25)
    assert _gain(plain, both, ("color", "shading")) == pytest.approx(5 * 0.3 / 0.25)


def test_homes_are_summed_up_by_their_geometric_mean() -> None:
    def home(gain: float) -> dict[str, Spread]:
        return {name: Spread(gain, gain, gain, 2) for name in (*_SHOWN, _BOTH)}

    rows = list(summary([home(2.0), home(8.0)], 64))
    assert [row.name for row in rows[:-2]] == list(_SHOWN.values())
    assert all(row.spread == Spread(pytest.approx(4.0), 2.0, 8.0, 2) for row in rows[:-2])
    for row in rows[-2:]:
        assert row.spread == Spread(pytest.approx(0.25), 0.125, 0.5, 2)
        assert row.verdict == "<= 0.4: met"
    (alone,) = list(summary([home(2.0)], 64))[-1:]
    assert alone.verdict == "<= 0.4: MISSED"


def test_a_references_own_error_is_taken_off() -> None:
    random = np.random.default_rng(5)
    truth = random.uniform(1, 2, (200, 200, 3))

    def noisy(sigma: float) -> np.ndarray:
        return truth + random.normal(0, sigma, truth.shape)

    reference = Reference(noisy(0.1), noisy(0.1))
    wanted = 0.1**2 / truth.mean() ** 2
    assert reference.error(noisy(0.1)) == pytest.approx(wanted, rel=0.05)
    assert reference.own == pytest.approx(wanted / 2, rel=0.05)


def run_topic(results: Results, rows: list[Row], name: str = "shards", fails: bool = False) -> None:
    def topic(bench: Bench) -> Iterator[Row]:
        yield from rows
        if fails:
            raise KeyboardInterrupt

    bench = Bench(results.path.parent, SMALL, results.path.parent)
    measure(name, Topic(topic, joint=False), bench, results)


def fresh(folder: Path, sizes: str = "full") -> Results:
    return Results(folder / "results.json", folder / "page.md", sizes)


ROWS = [
    Row("reading", "rows per second", Spread(1.3, 1.2, 1.44, 5), clock="wall", goal=at_least(10)),
    Row("speed", "views", Spread(1234.5, 1000, 2000, 3), "/s", "cpu"),
    missing("other", "what the other does", "it is not here", at_least(2.5)),
]


def test_the_page_tells_figures_ranges_goals_and_what_is_missing(tmp_path: Path) -> None:
    run_topic(fresh(tmp_path), ROWS)
    page = (tmp_path / "page.md").read_text()
    assert "| reading | 1.3 | 1.2 to 1.44 | wall | >= 10, **missed** |" in page
    assert "| speed | 1,234/s | 1,000/s to 2,000/s | CPU |  |" in page
    assert "| other | not measured: it is not here | | | >= 2.5 |" in page
    assert "- **reading**: rows per second." in page
    assert "**Incomplete**: not measured yet: render, previews, sets, variant" in page
    assert "trial" not in page
    kept = json.loads((tmp_path / "results.json").read_text())["topics"]["shards"]
    assert kept["complete"] and [row.get("met") for row in kept["rows"]] == [False, None, None]


def test_an_interrupted_run_leaves_its_rows_and_says_so(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_topic(fresh(tmp_path), ROWS[:2], fails=True)
    record = json.loads((tmp_path / "results.json").read_text())
    assert len(record["topics"]["shards"]["rows"]) == 2
    assert "shards" in record["unfinished"]
    assert "Incomplete." in page_of(record)
    resumed = fresh(tmp_path)
    resumed.load()
    assert not resumed.complete("shards")
    run_topic(resumed, ROWS)
    assert resumed.complete("shards")


def test_a_partial_run_keeps_the_other_topics_even_of_other_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`make bench ONLY=render` after a change of the code: the rows of `shards` stay."""
    run_topic(fresh(tmp_path), ROWS)
    before = json.loads((tmp_path / "results.json").read_text())
    monkeypatch.setattr("benchmarks.results.code_version", lambda: "other code")
    later = fresh(tmp_path)
    later.load()
    assert later.complete("shards") and not later.current("shards")
    run_topic(later, ROWS[1:2], "render")
    after = json.loads((tmp_path / "results.json").read_text())
    assert after["topics"]["shards"] == before["topics"]["shards"]
    assert [row["name"] for row in after["topics"]["render"]["rows"]] == ["speed"]
    page = (tmp_path / "page.md").read_text()
    assert "| reading | 1.3 |" in page and page.count("| speed |") == 2
    code = before["measured_on"]["code"]
    assert f"Measured in another run: pbrnet {code}." in page


def test_results_of_other_sizes_are_not_current(tmp_path: Path) -> None:
    run_topic(fresh(tmp_path), ROWS)
    small = fresh(tmp_path, "small")
    small.load()
    assert not small.current("shards")


def test_a_damaged_results_file_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("{")
    with pytest.raises(InputError, match=r"results\.json"):
        fresh(tmp_path).load()
    assert (tmp_path / "results.json").read_text() == "{"


def test_without_joint_traces_a_topic_that_needs_them_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.run.integrator.available", lambda: False)
    results = fresh(tmp_path)
    measure("render", TOPICS["render"], Bench(tmp_path, SMALL, tmp_path), results)
    (row,) = results.topics["render"]["rows"]
    assert "scalar" in row["missing"] and results.complete("render")


def test_a_trial_run_is_called_one(tmp_path: Path) -> None:
    run_topic(fresh(tmp_path, "small"), ROWS)
    assert "ignore its figures" in (tmp_path / "page.md").read_text()


def test_without_blender_the_row_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(command: list[str]) -> None:
        raise BlenderMissing("bpy cannot be installed: no matching distribution")

    monkeypatch.setattr(cycles, "run_step", refused)
    (row,) = cycles_rows(Bench(tmp_path, SMALL, tmp_path))
    assert row.spread is None
    assert "no matching distribution" in row.missing
    assert row.verdict == ">= 2.5: not measured"


def test_an_interpreter_without_bpy_is_not_taken(tmp_path: Path) -> None:
    with pytest.raises(BlenderMissing, match="worse luck"):
        run_step([sys.executable, "-c", "raise SystemExit('worse luck')"])
    python = tmp_path / "bpy" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    assert not cycles.has_bpy(python)
    assert blender_python(tmp_path, Path(sys.executable)) == Path(sys.executable)


def test_windows_are_rectangles_that_face_inwards() -> None:
    corners = ((0, 0, 1), (2, 0, 1), (2, 0, 2), (0, 0, 2))
    ((corner, first, second, inward),) = windows_of(
        (Portal("window", "window", corners, (0, -1, 0), True),)
    )
    across, along = np.subtract(first, corner), np.subtract(second, corner)
    assert np.linalg.norm(np.cross(across, along)) == pytest.approx(2)
    assert np.dot(across, along) == pytest.approx(0)
    assert inward == [0, 1, 0]
    middle = np.array(corner) + (across + along) / 2
    assert middle == pytest.approx([1, 0, 1.5])


def test_clay_has_no_panes_and_no_light_but_the_sky() -> None:
    corners = ((0, 0, 1), (2, 0, 1), (2, 0, 2), (0, 0, 2))
    window = Portal("window", "window", corners, (0, -1, 0), True, panes=2)
    home = Scene("home", {}, (), (), (Light("lamp", "area"),), (window,), ())
    clay = _bare(home, "clay", set())
    assert [portal.panes for portal in clay.portals] == [0]
    assert [light.kind for light in clay.lights] == ["environment"]


def test_thin_sheets_of_a_glb_are_found_by_material() -> None:
    passing = {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.4}}
    materials = [{"name": "wood"}, {"name": "curtain", "extensions": passing}]
    text = json.dumps({"materials": materials}).encode()
    head = struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text), len(text), 0x4E4F534A)
    assert thin_sheets(head + text) == {"curtain": 0.4}


def measured(
    name: str, ours: dict[str, Point], *rivals: Point, kind: str = "clay", size: str = "4x3"
) -> Measured:
    return Measured(kind, name, "day", size, 256, 0.06, 0.04, 0.002, ours, rivals, (), "5.1", 0.03)


def ours(seconds: float, flip: float, spp: int = 1) -> Point:
    return Point("ours", "radiosity", spp, seconds, flip, 0.9)


def path(seconds: float, flip: float, method: str = "multijitter") -> Point:
    return Point("path", method, 8, seconds, flip, 0.9)


def test_what_a_cut_off_run_has_measured_is_read_again(tmp_path: Path) -> None:
    pictures = [np.full((6, 8, 3), value, dtype=np.float32) for value in (0.25, 0.5)]
    sheet = tuple(zip(("reference", "ours: hybrid 4, FLIP 0.100"), pictures, strict=True))
    whole = measured("home", {"0.5": ours(0.5, 0.1), "1": ours(0.9, 0.08)}, path(0.4, 0.2))
    for one in (replace(whole, sheet=sheet), replace(whole, size="8x6", rivals=())):
        file = tmp_path / "new" / f"{one.size}.npz"
        file.parent.mkdir(exist_ok=True)
        one.save(file)
        found = Measured.load(file)
        assert replace(found, sheet=()) == replace(one, sheet=())
        assert [label for label, _ in found.sheet] == [label for label, _ in one.sheet]
        for (_, read), (_, written) in zip(found.sheet, one.sheet, strict=True):
            np.testing.assert_array_equal(read, written)


def test_a_budget_gets_the_samples_that_fit() -> None:
    """0.2 s whatever the samples, and 0.05 s each."""
    probes = [(2, 0.3), (8, 0.6)]
    assert [fitting(probes, budget) for budget in (0.2, 0.26, 0.5, 1, 5)] == [0, 1, 4, 12, 64]


def test_ours_is_what_was_chosen_and_not_what_the_truth_prefers() -> None:
    one = measured("home", {"0.5": ours(0.52, 0.3, 1), "1": ours(1.2, 0.1, 4), "2": ours(1.9, 0.2)})
    assert one.chosen(0.2) is None
    assert one.chosen(0.5) == ours(0.52, 0.3, 1)  # 0.52 s are 0.5 s within the clock's noise
    assert one.chosen(1) == ours(0.52, 0.3, 1)  # what was chosen for 1 s takes too long
    assert one.chosen(2) == ours(1.9, 0.2)  # 0.1 was not chosen for it


def test_a_rival_has_its_best_method_where_each_scene_has_a_picture() -> None:
    quick = measured(
        "quick", {"1": ours(0.4, 0.2)}, path(0.4, 0.1), path(0.9, 0.05), path(0.1, 0.01, "fast")
    )
    slow = measured("slow", {"1": ours(0.9, 0.3)}, path(0.8, 0.3), path(0.9, 0.31))
    early, late = cells([[quick], [slow]], (0.5, 1))
    assert (early["first"], early["ours"], early["path"]) == (None, None, None)
    assert late["path"]["flip"] == pytest.approx((0.05 + 0.3) / 2)  # "fast" has none of `slow`
    assert late["path"]["methods"] == ["multijitter"]
    assert late["ours"]["flip"] == pytest.approx(0.25)
    assert late["first"] == "path" and late["cycles"] is None
    assert late["ahead"]["mean"] == pytest.approx(-0.075)
    assert late["ahead"]["low"] == pytest.approx(-0.15) and late["ahead"]["high"] <= 0


def test_kinds_and_sizes_have_cells_of_their_own_and_a_panel() -> None:
    scenes = [
        [measured("a", {"1": ours(0.4, 0.2)}, kind=kind, size=size) for size in ("4x3", "8x6")]
        for kind in ("clay", "furnished")
    ]
    found = cells(scenes, (0.2, 1))
    assert [(cell["kind"], cell["size"], cell["budget"]) for cell in found] == [
        (kind, size, budget)
        for kind in ("clay", "furnished")
        for size in ("4x3", "8x6")
        for budget in (0.2, 1)
    ]
    assert [cell["first"] for cell in found] == 4 * [None, "ours"]
    assert budget_plot(found).startswith(b"\x89PNG")


def test_noise_does_not_count_when_renderers_are_compared() -> None:
    """0.03 whatever the samples, and 0.64 over the root of their number."""
    half, whole = (0.03 + 0.64 / math.sqrt(spp) for spp in (512, 1024))
    assert without_noise(whole, half) == pytest.approx(0.03)
    assert without_noise(0.02, 0.09) == 0
    one = measured("home", {})
    assert one.agrees(0.002, 0.04)
    assert not one.agrees(0.001, 0.04) and not one.agrees(0.002, 0.03)


def test_the_best_settings_of_each_budget_are_kept() -> None:
    tried = [{"a": 0.3, "b": 0.1, "c": 0.2}, {"a": 0.1, "c": 0.2}]
    assert best_options(tried, ["a", "b", "c"], 1) == ["a", "b"]
    assert best_options(tried, ["a", "b", "c"], 2) == ["a", "b", "c"]
    assert best_options(tried, ["c"], 1) == ["c"]


def test_a_furnished_home_keeps_what_both_renderers_show_alike(tmp_path: Path) -> None:
    params = SceneParams(rooms_max=1, texture_size=64)
    home = make_home(tmp_path / "home", "home", params.home(3, "night"))
    view = make_view(small_params(), "home", 0)
    shown = write_furnished(home, view, 11, tmp_path / "shown")
    before, after = (ElementTree.parse(scene.xml).getroot() for scene in (home, shown))
    kinds = Counter(str(bsdf.get("type")) for bsdf in after.iter("bsdf"))
    assert {"normalmap", "bumpmap"} & {bsdf.get("type") for bsdf in before.iter("bsdf")}
    assert not {"normalmap", "bumpmap"} & {*kinds}
    assert kinds["diffuse"] > 10 < kinds["principled"]  # rough ones, and those with highlights
    assert after.find(".//float[@name='sheen']") is None
    clear = {one.get("id") for one in after.iter("bsdf") if one.get("type") == "thindielectric"}
    shapes = [[ref.get("id") for ref in shape.iter("ref")] for shape in after.findall("shape")]
    assert not any(clear & {*ids} for ids in shapes)
    lamps = [shape for shape in after.findall("shape") if shape.find("emitter") is not None]
    assert len(lamps) == len(before.findall("shape/emitter")) > 0
    assert all(lamp.find("boolean[@name='face_normals']") is not None for lamp in lamps)
    assert {portal.panes for portal in shown.portals} == {0}
    files = json.loads((blender_folder(shown.folder) / "cycles.json").read_text())
    assert Path(files["glb"]).is_file() and Path(files["sky"]).is_file()
    assert files["camera"]["width"] == view.width
    image = pixels(render_truth(open_scene(shown), view, GroundTruthParams().sampled(4), 0))
    assert image.mean() > 0


def test_shards_and_frames_are_read_to_the_same_images(tmp_path: Path) -> None:
    """The comparison of speeds is one of equal results."""
    params = small_params(row_group=2, splits=SplitParams(validation=0, test=0))
    data = make_data(tmp_path, params)
    pack_dataset(data, params)
    examples = {example.name: example for example in Dataset(data / "dataset", "train").ordered()}
    count = 0
    for view in views_of(data):
        example = examples[f"{view.scene_id}/{view.view_id}"]
        for name, image in read_view(data, view).items():
            assert np.array_equal(image, example[name]), name
            count += image.size
    keep_channels_of_rows(data, views_of(data))
    with ThreadPoolExecutor(2) as pool:
        assert examples and read_columns(data / "dataset", pool) == count
    assert sum(read_exr(data, view) for view in views_of(data)) == count
    stored = set(example.images)
    assert set(read_view(data, view)) == stored


def test_methods_take_part_in_the_open_benchmark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pictures of all tasks can be scored; what a stage took belongs to the methods that use it."""
    rows = box_rows(["room-0", "room-1"], 1, "test", True, width=32, height=24, panorama=16)
    for row in rows:
        row["camera_to_world"] = np.eye(4)
        row["visibility"] = np.ones_like(row["depth"], np.float16)
        row["transport_color"] = row["color"]
        row["transport_direct"] = row["transport_indirect"] = row["color"]
    write_shard(tmp_path / "dataset" / "test-00000-of-00001.parquet", rows)
    places = [(row["scene_id"], row["view_id"]) for row in rows]
    stages = [("noisy", 5.0), ("transport", 3.0), ("color", 7.0)]
    ledger = [
        {"stage": stage, "scene_id": scene, "view_id": view}
        | {"seconds": 1 + seconds, "opening": 1.0, "threads": 2}
        for stage, seconds in stages
        for scene, view in places
    ]
    monkeypatch.setattr(
        "benchmarks.submissions.read_ledger", lambda data: pa.Table.from_pylist(ledger)
    )

    def loaded(folder: Path, methods: list[str]) -> Any:
        if methods == ["plus"]:
            raise InputError("weights of an earlier form")
        picture = SimpleNamespace(color=np.ones((24, 32, 3), np.float32))
        return SimpleNamespace(
            methods=methods,
            predict=lambda method, example: method,
            radiance=lambda example, predicted: picture,
        )

    monkeypatch.setattr("benchmarks.submissions.load_networks", loaded)
    dataset = DatasetRows(tmp_path / "dataset")
    views = pin_views(dataset, 0, "trial", "1")
    made = submissions(tmp_path / "dataset", tmp_path, views, tmp_path / "out")
    assert list(made) == list(METRICS)
    found = {
        folder.name: score_folder(folder, dataset, views, task)
        for task, folders in made.items()
        for folder in folders
    }
    mean = {name: score.summary()["metrics"] for name, score in found.items()}
    assert mean["radiosity"]["ssim"]["mean"] == pytest.approx(1, abs=1e-3)
    assert mean["radiosity"]["stops"]["mean"] == pytest.approx(0, abs=1e-3)
    assert "plus" not in found, "its weights are of an earlier form"
    for name, least in {"radiosity": 6, "denoised": 10, "hybrid": 16, "reflectance": 0}.items():
        assert least < (found[name].seconds or 0) < least + 5, name
    assert all(0 < one["ssim"]["mean"] < 1.001 for one in mean.values() if "ssim" in one)
    assert 0 < mean["camera"]["mean_angle"]["mean"] < 90


def test_the_command_names_its_topics() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.run", "--help"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert all(word in done.stdout for word in ("--only", "cycles", "budgets"))


def test_sets_of_channels_cost_what_they_take_beside_paper() -> None:
    """Of a trace the difference counts, of a pass of its own all; never less than nothing."""
    seconds = {"inputs": 2, "materials": 3, "labels": 1, "surfaces": 6, "truth": 10, "light": 11}
    seconds |= {"light with groups": 14, "environment": 8, "transport": 5}
    spent = {name: [Spent(cpu, 2 * cpu)] for name, cpu in seconds.items()}
    expected = {"materials": 1, "labels": 0, "light": 1, "light with groups": 4, "transport": 5}
    for name, more in {**expected, "all": 4 + 4 + 8 + 5}.items():
        added = [Spent(1, 1)]
        assert sums(added, *sets._added(name, spent)) == [Spent(1 + more, 1 + 2 * more)]


def test_each_column_of_the_sample_counts_for_the_sets_that_have_it() -> None:
    folder = ROOT / "examples" / "sample"
    sizes = sets._bytes_a_row(folder)
    shards = list(folder.glob("*.parquet"))
    rows = sum(pq.read_metadata(path).num_rows for path in shards)
    whole = sum(path.stat().st_size for path in shards) / rows
    assert 0.9 * whole < sum(sizes.values()) < whole
    params = Params(light=LightParams(groups=1))
    columns = {name: sets._columns(params, name) for name in ("paper", *sets._SETS)}
    assert set.union(*columns.values()) == columns["all"] < set(sizes)
    assert all("noisy" in name or "denoised" in name for name in set(sizes) - columns["all"])
    totals = {name: sum(sizes[column] for column in own) for name, own in columns.items()}
    assert totals["light with groups"] > totals["light"] > totals["paper"]
    together = totals["materials and labels"]
    assert totals["materials"] + totals["labels"] > together + totals["paper"], "one has material"
