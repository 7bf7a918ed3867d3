"""The report is one file that shows all outputs and names the missing ones."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from pbrnet.model.figures.charts import line_chart, line_figure, strip_figure, strip_plot
from pbrnet.model.figures.diagrams import TALL, WIDE, Node, chain, panorama_guide
from pbrnet.model.figures.row_pictures import environment_pictures, light_pictures, rows_with
from pbrnet.model.report.page import Places, write_report
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import frame_path
from pbrnet.pipeline.images import png_bytes
from pbrnet.pipeline.params import Params
from pbrnet.scenes.contract import Credit
from tests.fixtures.command import printed
from tests.fixtures.dataset import add_scene, make_data, make_view, small_params
from tests.fixtures.report import make_ledger, make_results

SECTIONS = (
    "chain", "pictures", "panorama", "rejections", "dataset", "curves", "results", "views", "costs",
    "scenes", "details",
)  # fmt: skip
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Checks that tags nest, and collects what the page refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: set[str] = set()
        self.sources: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags.append(tag)
        if "id" in values:
            self.ids.add(values["id"] or "")
        for name in ("src", "href", "xlink:href", "srcset", "data", "action"):
            if values.get(name):
                self.sources.append(values[name] or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> closes <{self.open[-1:]}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All outputs of a finished run: data, models, metrics, plots."""
    root = tmp_path_factory.mktemp("report")
    params = small_params()
    make_data(root / "data", params, scenes=4)
    add_scene(
        root / "data",
        params,
        "grey-room",
        2,
        source={"kind": "mitsuba"},
        changes=("The <integrator> 'sppm' was replaced.",),
        credits=(Credit("everything", "Grey Room", "Wig", "CC-BY-3.0"),),
    )
    frame_path(root / "data", "color", make_view(params, "home-0001", 1)).unlink()
    pack_dataset(root / "data", params)
    keys = [(f"home-000{scene}", f"00{view}") for scene in (0, 2) for view in range(3)]
    make_results(root, keys, (32, 24))
    make_ledger(root / "data", keys)
    return root


@pytest.fixture
def blank_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts without content, for tests of the rest: drawing them is most of a page's time."""
    blank = '<svg viewBox="0 0 1 1"></svg>'
    monkeypatch.setattr(Figure, "savefig", lambda figure, stream, **options: stream.write(blank))


@pytest.fixture
def copy(root: Path, tmp_path: Path) -> Path:
    """A copy of the finished run, to be changed."""
    return shutil.copytree(root, tmp_path / "copy")


def written(root: Path, params: Params | None = None) -> tuple[str, list[str]]:
    """The page of the run in a folder, and the notes on what it leaves out."""
    parts = ("data", "models", "metrics", "plots", "predictions")
    notes = write_report(
        Places(*(root / part for part in parts)), params or small_params(), root / "index.html"
    )
    return (root / "index.html").read_text(), notes


@pytest.fixture(scope="module")
def text(root: Path) -> str:
    """The page of a finished run."""
    page, notes = written(root)
    assert notes == []
    return page


def test_the_page_nests_and_has_every_section(text: str) -> None:
    assert set(SECTIONS) <= Page(text).ids
    assert 'class="missing"' not in text.replace('<p class="missing">All scenes', "")
    assert "SSIM of both networks (pbrnet), on test scenes" in text
    assert "&lt;integrator&gt;" in text and "<integrator>" not in text, "foreign text is escaped"
    assert "prefers-color-scheme: dark" in text and 'name="viewport"' in text


def test_the_ledger_is_drawn(text: str) -> None:
    costs = text[text.index('id="costs"') : text.index('id="scenes"')]
    assert costs.count("<svg") == 4  # all views had as many samples
    assert "Worker timeline" in costs and "Memory of the workers" in costs


def test_the_page_needs_nothing_from_outside(text: str) -> None:
    page = Page(text)
    assert page.sources
    for source in page.sources:
        assert source.startswith(("data:image/", "#")), source[:80]
    assert not {"script", "link", "iframe", "object", "embed"} & set(page.tags)
    assert not re.search(r"url\(\s*['\"]?(?!#)", text), "a style sheet that loads something"
    assert "@import" not in text


def test_the_page_shows_all_modalities_results_and_reasons(text: str) -> None:
    page = Page(text)
    for words in (
        "Colour",
        "Shading",
        "Reflectance",
        "Normal",
        "Depth",
        "Illumination: intensity",
        "Illumination: distance",
        "too few objects",
        "no color frame",
        "efficientnet_lite0",
        "Reflectance × true shading",
        "LPIPS is not shown",
        "0.700 to 0.800",
        "renderer: color",
        "Views with the lowest error",
        "Views with the highest error",
        "Predicted shading",
        "CC-BY-3.0",
        "replaced",
        "spp: 64",
        "mitsuba",
    ):
        assert words in page.text, words
    assert "2 items were made more than once" in page.text


def test_charts_are_well_formed_and_the_page_small(text: str) -> None:
    charts = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(charts) >= 8
    for chart in charts:
        ElementTree.fromstring(chart)
    assert len(text) < 8_000_000


def test_predictions_are_shown_with_their_authors(copy: Path) -> None:
    folder = copy / "predictions"
    folder.mkdir()
    picture = np.full((12, 16, 3), 99, np.uint8)
    facts = {
        "prediction": "parlour/v7",
        "models": "models/fine",
        "words": "SSIM 0.321",
        "credits": ["The Parlour by A. Painter, CC-BY-4.0"],
    }
    (folder / "parlour--v7.png").write_bytes(png_bytes(picture, facts))
    (folder / "holiday.png").write_bytes(png_bytes(picture))
    (folder / "torn.png").write_bytes(png_bytes(picture, facts)[:60])
    content, missing = written(copy)
    page = Page(content)
    for words in ("parlour/v7", "SSIM 0.321, models/fine", facts["credits"][0]):
        assert words in page.text
    assert len(missing) == 2
    assert "holiday.png was not written by" in missing[0] and "torn.png is damaged" in missing[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gone", "words"),
    [
        (("data", "models", "metrics", "plots"), "pbrnet scenes"),
        (("data/dataset",), "pbrnet dataset"),
        (("data/cameras",), "pbrnet cameras"),
        (("data/ledger.parquet",), "There is no cost ledger yet"),
        (("metrics",), "pbrnet evaluate"),
        (("metrics/examples",), ""),
        (("metrics/evaluation.csv",), ""),
        (("plots",), "pbrnet train"),
        (("models",), "pbrnet backbone"),
        (("data/scenes",), "pbrnet scenes"),
        (("data/inputs", "data/color"), ""),
    ],
)
@pytest.mark.usefixtures("blank_charts")
def test_what_is_missing_is_named_and_the_rest_shown(
    copy: Path, gone: tuple[str, ...], words: str
) -> None:
    for name in gone:
        path = copy / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    page = Page(written(copy)[0])
    assert set(SECTIONS) <= page.ids
    assert words in page.text


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "metrics/evaluation.json",
        "models/shading.json",
        "data/dataset/train-00000-of-00001.parquet",
        "data/cameras/home-0000.json",
        "data/scenes/home-0000/scene.json",
        "data/ledger.parquet",
        "metrics/examples/home-0000--000--prediction.png",
        "plots/train_shading.csv",
        "metrics/evaluation.csv",
    ],
)
@pytest.mark.usefixtures("blank_charts")
def test_a_damaged_part_is_named_and_the_rest_shown(copy: Path, name: str) -> None:
    (copy / name).write_bytes(b"a,b\n\xff\x00 not what it was\n")
    page, notes = written(copy)
    assert any(Path(name).name in note or Path(name).parent.name in note for note in notes), notes
    assert set(SECTIONS) <= Page(page).ids


def test_the_command_writes_by_rename(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(root)
    (tmp_path / "params.yaml").write_text("seed: 0\n")
    out = tmp_path / "new" / "index.html"
    said = printed("report", "--params", tmp_path / "params.yaml", "--out", out)
    assert "Written" in said
    assert [path.name for path in out.parent.iterdir()] == ["index.html"]


def test_charts_place_values_where_they_belong() -> None:
    lines = {"loss": [(0, 1.0), (10, 3.0), (20, 2.0)], "gaps": [(0, 1.0), (5, float("nan"))]}
    figure = line_figure(lines, "step", "loss")
    assert figure is not None
    (axes,) = figure.axes
    assert np.array_equal(axes.lines[0].get_xydata(), lines["loss"])
    assert np.array_equal(axes.lines[1].get_xydata(), [(0, 1.0)])
    assert axes.get_yscale() == "linear" and axes.get_ylabel() == "loss"
    steep = line_figure({"loss": [(0, 100.0), (1, 10.0), (2, 1.0)]}, "step", "loss")
    assert steep is not None and steep.axes[0].get_yscale() == "log"
    strips = strip_figure({"a": [1.0, 3.0], "b": []}, "SSIM")
    assert strips is not None
    ticks, mean = strips.axes[0].lines
    assert sorted(set(np.asarray(ticks.get_xydata())[:2, 0])) == [1.0]
    assert set(np.asarray(mean.get_xydata())[:, 0]) == {2.0}


def test_charts_are_reproducible_and_follow_the_theme() -> None:
    series = {"<training>": [(0.0, 1.125), (10.0, 3.0)], "validation": [(0.0, 2.0)]}
    svg = line_chart(series, "step", "loss")
    assert svg == line_chart(series, "step", "loss")
    text = ElementTree.tostring(ElementTree.fromstring(svg), method="text", encoding="unicode")
    assert "<training>" in text and "step" in text
    assert {"var(--s0)", "var(--s1)", "var(--rule)", "var(--soft)"} <= set(
        re.findall(r"var\(--\w+\)", svg)
    )
    assert not re.search(r": #[0-9a-f]{6}|<style|<metadata|20\d\d-", svg)


@pytest.mark.parametrize(
    "values", [[], [float("nan")], [3.0], [2.0, 2.0], [0.0, 1e-9], [-1.0, 5.0]]
)
def test_charts_bear_odd_values(values: list[float]) -> None:
    for svg in (
        line_chart({"a": list(enumerate(values))}, "x", "y"),
        strip_plot({"a": values, "<b>": []}, "y"),
    ):
        if svg:
            ElementTree.fromstring(str(svg))
            assert "nan" not in str(svg)


def test_the_panorama_guide_outlines_the_field_of_view() -> None:
    params = small_params()
    intrinsics = make_view(params, "home", 0).intrinsics
    svg = str(panorama_guide("data:,", (360, 180), intrinsics, (32, 24)))
    outline = re.search(r'points="([^"]+)"', svg)
    assert outline
    points = np.array([[float(v) for v in pair.split(",")] for pair in outline[1].split()])
    half_x = np.degrees(params.image.half_fov_x)
    middle = points[np.abs(points[:, 1] - 90) < 2]
    assert middle[:, 0].min() == pytest.approx(180 - half_x, abs=0.2)
    assert middle[:, 0].max() == pytest.approx(180 + half_x, abs=0.2)
    half_y = np.degrees(np.arctan(np.tan(params.image.half_fov_x) * 24 / 32))
    top = points[np.abs(points[:, 0] - 180) < 0.5]
    assert top[:, 1].min() == pytest.approx(90 - half_y, abs=0.2)


def test_a_panoramic_view_has_no_outline_in_its_panorama() -> None:
    assert "polygon" not in str(panorama_guide("data:,", (360, 180), None, (32, 16)))


def test_parts_of_the_light_are_shown_under_the_exposure_of_colour() -> None:
    """Equal radiance looks equal in colour, parts and groups; groups without light are left out."""
    color = np.random.default_rng(0).uniform(0.1, 2, (12, 16, 3)).astype(np.float32)
    dark = np.zeros_like(color)
    row: dict[str, Any] = {"color": color, "radiance_scale": 4.0}
    assert light_pictures(row) == environment_pictures(row) == []
    row |= {"direct": color, "indirect": dark, "diffuse": color / 4, "specular": color * 3 / 4}
    row |= {"irradiance": color, "lights": np.stack([color / 4, dark]).astype(np.float16)}
    shown = dict(light_pictures({**row, "light_names": ["sky", "sun"]}))
    assert [*shown][-2:] == ["Irradiance", "Light of sky"]
    np.testing.assert_array_equal(shown["Direct"], shown["Colour"])
    assert np.abs(shown["Light of sky"].astype(int) - shown["Colour"]).max() <= 1
    assert shown["Indirect"].max() < shown["Diffuse"].mean() < shown["Colour"].mean()


def test_the_surroundings_are_shown_with_their_geometry() -> None:
    light = np.ones((8, 16, 3), np.float32)
    row = {
        "environment": light,
        "environment_depth": light[..., 0],
        "environment_normal": light / 2,
    }
    titles, pictures = zip(*environment_pictures(row), strict=True)
    assert titles == ("Environment", "Distance along the rays", "Normal")
    assert {picture.shape for picture in pictures} == {(8, 16, 3)}


def test_motion_is_shown_only_of_views_with_a_next_frame() -> None:
    still, last = {"depth": 1}, {"depth": 1, "flow_forward": np.zeros((2, 2, 2))}
    moving = {"depth": 1, "flow_forward": np.ones((2, 2, 2)), "occluded_forward": np.zeros((2, 2))}
    sheet = [still, last, moving]
    assert rows_with("depth", sheet) == sheet
    assert rows_with("flow_forward", sheet) == rows_with("occluded_forward", sheet) == [moving]


def test_the_chain_has_every_stage_in_both_layouts() -> None:
    assert set(WIDE) == set(TALL)
    nodes = {name: Node(name, "<note>") for name in WIDE}
    for layout in (WIDE, TALL):
        svg = str(chain(nodes, layout, "x"))
        ElementTree.fromstring(svg)
        assert all(f">{name}</text>" in svg for name in WIDE)
        boxes = list(layout.values())
        for index, (x, y, w, h) in enumerate(boxes):
            for u, v, s, t in boxes[index + 1 :]:
                assert x + w <= u or u + s <= x or y + h <= v or v + t <= y, "boxes overlap"


def test_sources_kept_back_have_a_table_of_their_own(copy: Path) -> None:
    path = copy / "metrics" / "evaluation.json"
    found = json.loads(path.read_text())
    figures = found["methods"]["pbrnet"] | {"ssim": {"mean": 0.123, "low": 0.1, "high": 0.2}}
    found["kept_back"] = {"views": 3, "scenes": 1, "methods": {"pbrnet": figures}}
    path.write_text(json.dumps(found))
    page = Page(written(copy)[0])
    assert "Test-only sources" in page.text and "0.123" in page.text


@pytest.mark.slow
def test_own_exposure_shows_the_truth_by_its_own_exposure(copy: Path) -> None:
    path = copy / "metrics" / "evaluation.json"
    pages = []
    for policy in ("shared", "own"):
        path.write_text(re.sub('"exposure": "[a-z]+"', f'"exposure": "{policy}"', path.read_text()))
        page, _ = written(copy, replace(small_params(), seed=1))
        truths = re.findall(r'src="([^"]+)" alt="Truth"', page)
        pages.append(truths)
    assert len(pages[0]) == 4 and pages[0] != pages[1]
