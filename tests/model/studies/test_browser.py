"""The page of blind pairs in a browser: keys and clicks, interruptions, scores."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from pbrnet.model.studies.pairs.answers import Key, read_answers, read_key, score
from pbrnet.model.studies.pairs.folders import write_folders_page
from pbrnet.model.studies.pairs.study import QUESTION, PairsConfig, write_pairs_page
from pbrnet.pipeline.params import Params
from tests.fixtures.browser import PATIENCE, Browser, open_browser
from tests.fixtures.study import workplace

OPEN = "['shown', 'hidden'].includes(document.body.dataset.phase)"
SECONDS, ANSWER_SECONDS = 0.5, 8.0  # the second is as long as a busy machine may take for a key

# The gap is too short for a key from outside.
PRESS_IN_EVERY_GAP = """
window.pressed = 0;
new MutationObserver(() => {
  if (document.body.dataset.phase !== "gap") return;
  window.pressed += 1;
  document.dispatchEvent(new KeyboardEvent("keydown", { key: "f" }));
}).observe(document.body, { attributeFilter: ["data-phase"] });
"""

pytestmark = pytest.mark.check  # a browser needs a quiet machine


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """8 pairs, 4 of either method, after 2 of practice."""
    root = tmp_path_factory.mktemp("study")
    folders = workplace(root, views=10)
    config = PairsConfig(8, SECONDS, ANSWER_SECONDS, ("pbrnet", "product"))
    write_pairs_page(Params(), folders, config, root / "pairs.html")
    return root / "pairs.html"


@pytest.fixture(scope="module")
def one_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with open_browser(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture()
def browser(one_browser: Browser, page: Path) -> Browser:
    """A browser at the start of the page, with empty storage."""
    one_browser.open(page)
    one_browser.script("localStorage.clear()")
    one_browser.events.clear()
    one_browser.reload()
    return one_browser


@pytest.fixture()
def key(page: Path) -> Key:
    return read_key(page.with_name("pairs-key.json"))


def wait_for(browser: Browser, pair: str) -> None:
    """Wait until that pair can be answered."""
    browser.until(f"{OPEN} && document.body.dataset.pair === '{pair}'")


def practise(browser: Browser) -> None:
    """Start, answer the practice pairs, and begin the study."""
    browser.click("#start")
    for number in range(2):
        wait_for(browser, f"practice-{number}")
        browser.press("ArrowLeft")
    browser.until("!document.querySelector('#rest').hidden")
    assert "practice" in browser.script("document.querySelector('#rest-title').textContent")
    browser.press("Enter")


def wanted(key: Key, number: int) -> str:
    """Return the side to choose: the product's picture, and the truth in pairs of pbrnet."""
    pair = key.pairs[number]
    if pair.method == "pbrnet":
        return pair.truth
    return "left" if pair.truth == "right" else "right"


def saved(folder: Path) -> Path:
    """Wait for a download and return its path."""
    end = time.monotonic() + PATIENCE
    while not (found := sorted(folder.glob("*.json"))):
        assert time.monotonic() < end, list(folder.iterdir())
        time.sleep(0.02)
    return found[0]


def test_all_pairs_by_keys_and_clicks(browser: Browser, key: Key, tmp_path: Path) -> None:
    browser.downloads_to(tmp_path)
    practise(browser)
    ways = [
        {"left": "ArrowLeft", "right": "ArrowRight"},
        {"left": "f", "right": "j"},
        {"left": "#left", "right": "#right"},
        {"left": "#left-frame", "right": "#right-frame"},
        {"left": "F", "right": "J"},
    ]
    for number, pair in enumerate(key.pairs):
        wait_for(browser, pair.pair)
        assert f"Pair {number + 1} of 8" in browser.script("document.body.innerText")
        if number == 2:  # the timer runs out
            browser.until("document.body.dataset.phase === 'hidden'")
            visible = "getComputedStyle(document.querySelector('#left-picture')).visibility"
            assert browser.script(visible) == "hidden"
            browser.until("!document.querySelector('#rest').hidden")
            assert "No answer in time" in browser.script("document.body.innerText")
            browser.click("#go")
            continue
        if number == 3:  # answered after the pictures have gone, with a pause asked for
            browser.press("p")
            browser.until("document.body.dataset.phase === 'hidden'")
        way = ways[number % len(ways)][wanted(key, number)]
        browser.click(way) if way.startswith("#") else browser.press(way)
        if number == 3:
            browser.until("!document.querySelector('#rest').hidden")
            assert "4 of 8 pairs are done" in browser.script("document.body.innerText")
            browser.press("Enter")
    browser.until("!document.querySelector('#done').hidden")
    browser.click("#download")
    answers = read_answers(saved(tmp_path), key)
    assert json.loads(browser.script("document.querySelector('#text').value"))["page"] == key.page
    late = [answer.timed_out for answer in answers.answers]
    assert late == [n == 2 for n in range(8)], answers.answers
    for number, answer in enumerate(answers.answers):
        limit = 1000 * (SECONDS + ANSWER_SECONDS)
        if number == 2:
            assert limit - 20 < answer.ms < limit + 1000 * PATIENCE
        else:
            assert answer.side == wanted(key, number) and 0 < answer.ms < limit
    assert answers.answers[3].ms >= 1000 * SECONDS - 20
    result = score(key, [answers]).methods
    slow = key.pairs[2].method
    for method, share in (("pbrnet", 0.0), ("product", 1.0)):
        assert result[method].rate == share
        assert result[method].timeouts == (method == slow)
        assert result[method].answers == 4 - (method == slow)
    assert {url.split(":")[0] for url in browser.requests()} <= {"file", "blob"}
    assert not browser.errors()


def test_a_reload_loses_no_answer_and_shows_no_pair_twice(browser: Browser, key: Key) -> None:
    practise(browser)
    for number in range(3):
        wait_for(browser, key.pairs[number].pair)
        browser.press("j")
    wait_for(browser, key.pairs[3].pair)  # is being shown
    browser.reload()
    assert "4 of 8 pairs are done" in browser.script("document.body.innerText")
    browser.click("#start")
    for number in range(4, 8):
        wait_for(browser, key.pairs[number].pair)
        browser.press("f")
    browser.until("!document.querySelector('#done').hidden")
    browser.reload()
    browser.until("!document.querySelector('#done').hidden")
    kept = json.loads(browser.script("document.querySelector('#text').value"))
    sides = [answer["side"] for answer in kept["answers"]]
    assert sides == ["right"] * 3 + [None] + ["left"] * 4
    assert [answer["pair"] for answer in kept["answers"]] == [pair.pair for pair in key.pairs]

    again = "document.querySelector('#again').click()"
    assert browser.asked("Runtime.evaluate", expression=again) == "confirm"
    practise(browser)
    wait_for(browser, key.pairs[0].pair)
    assert answers_kept(browser) == []
    session = browser.script("JSON.parse(Object.values(localStorage)[0]).session")
    assert session != kept["session"]


def test_keys_count_only_while_a_pair_is_open(browser: Browser, key: Key) -> None:
    """Not before the start, not in the gap, not when held down."""
    browser.press("f")
    browser.script(PRESS_IN_EVERY_GAP)
    practise(browser)
    wait_for(browser, key.pairs[0].pair)
    browser.call(
        "Input.dispatchKeyEvent", type="keyDown", key="f", code="f", text="f", autoRepeat=True
    )
    assert answers_kept(browser) == []
    browser.press("j")
    wait_for(browser, key.pairs[1].pair)
    assert browser.script("window.pressed") == 4, "two of practice, two that count"
    assert [answer["side"] for answer in answers_kept(browser)] == ["right"]


def answers_kept(browser: Browser) -> list[Any]:
    kept: list[Any] = browser.script(
        "JSON.parse(localStorage.getItem(Object.keys(localStorage)[0])).answers"
    )
    return kept


def test_a_browser_that_keeps_nothing_is_warned_about(browser: Browser, key: Key) -> None:
    refuse = "Storage.prototype.setItem = () => { throw new Error('full'); };"
    added = browser.call("Page.addScriptToEvaluateOnNewDocument", source=refuse)
    try:
        browser.reload()
        assert "does not allow the page to store data" in browser.script("document.body.innerText")
        practise(browser)
        wait_for(browser, key.pairs[0].pair)
        browser.press("f")
        wait_for(browser, key.pairs[1].pair)
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=added["identifier"])
        question = browser.asked("Page.navigate", url="about:blank")
    assert question == "beforeunload" and not browser.errors()


def test_a_phone_shows_the_pair_without_scrolling(browser: Browser) -> None:
    for width, height in ((390, 844), (844, 390)):
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=2, mobile=True,
        )  # fmt: skip
        try:
            browser.reload()
            browser.script("document.querySelector('#start').click()")
            browser.until(OPEN)
            size = browser.script(
                "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
            )
            assert size[0] <= width and size[1] <= height
            boxes = browser.script(
                "['left-picture', 'right-picture', 'left', 'right'].map("
                "id => document.getElementById(id).getBoundingClientRect().toJSON())"
            )
            assert boxes[0]["width"] == pytest.approx(boxes[1]["width"], abs=1)
            assert boxes[0]["height"] == pytest.approx(boxes[1]["height"], abs=1)
            assert min(box["height"] for box in boxes[2:]) >= 44, "as large as a finger"
        finally:
            browser.call("Emulation.clearDeviceMetricsOverride")


def test_pictures_of_folders_are_shown_in_one_size(one_browser: Browser, tmp_path: Path) -> None:
    """Of whatever size and format the files are."""
    for folder, suffix, sizes in (
        ("old", ".png", [(80, 64), (64, 80)]),
        ("new", ".jpg", [(300, 90), (120, 120)]),
    ):
        (tmp_path / folder).mkdir()
        for index, size in enumerate(sizes):
            Image.new("RGB", size, (80, 90, 99)).save(tmp_path / folder / f"{index}{suffix}")
    folders = tuple((name, tmp_path / name) for name in ("old", "new"))
    page = tmp_path / "pairs.html"
    write_folders_page(0, PairsConfig(folders=folders), page)
    one_browser.events.clear()
    one_browser.open(page)
    assert one_browser.script("document.title") == QUESTION
    one_browser.script("document.querySelector('#start').click()")
    for _ in range(2):
        one_browser.until(OPEN)
        boxes = one_browser.script(
            "['left-picture', 'right-picture'].map(id => document.getElementById(id)).map("
            "e => [e.clientWidth, e.clientHeight, e.naturalWidth, e.naturalHeight])"
        )
        assert boxes[0] == boxes[1] and min(boxes[0]) >= 64
        one_browser.press("f")
    one_browser.until("!document.querySelector('#done').hidden")
    assert not one_browser.errors()
