"""Progress: lines before anything is finished, and estimates that a forecast steadies."""

import time

import pytest

from pbrnet.pipeline import progress
from pbrnet.pipeline.progress import Pace, Progress, span


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, a list of one number; the progress beats every tenth of a real second."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_line_comes_before_the_first_item(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "FIRST", 0.1)
    with Progress(30, "color", kept=6, expected=600.0):
        time.sleep(1.3)
    first = capsys.readouterr().err.splitlines()[0]
    assert first.startswith("color: 6/30 views, 10 minutes left")


def test_lines_between_items_have_the_latest_note(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "FIRST", 0.5)
    with Progress(9, "train", "steps") as bar:
        bar.advance(1, "loss 0.5")
        time.sleep(1.3)
    assert "steps" in (first := capsys.readouterr().err.splitlines()[0]) and "loss 0.5" in first


def test_the_forecast_gives_way_to_what_is_measured(clock: list[float]) -> None:
    """100 items of 1 s, forecast at 10 s each: after a fifth the forecast counts no more."""
    bar = Progress(100, "color", expected=1000.0)
    assert bar.seconds_left() == 1000
    clock[0] += 10
    bar.advance(10)
    assert bar.seconds_left() == pytest.approx(0.5 * 100 + 0.5 * 1000 - 10)
    clock[0] += 10
    bar.advance(10)
    assert bar.seconds_left() == pytest.approx(80)
    bar.advance(80)
    assert bar.seconds_left() is None


def test_without_forecast_a_few_items_tell_and_the_start_does_not_count(
    clock: list[float],
) -> None:
    bar = Progress(20, "color", kept=8)
    clock[0] += 60
    assert bar.seconds_left() is None
    for number in range(3):
        bar.announce(str(number), 1)
        assert bar.seconds_left() is None, "60 s of start would make this 9 minutes"
        clock[0] += 2
    bar.announce("3", 1)
    assert bar.seconds_left() == pytest.approx(8 * 2)


def test_each_sort_of_item_tells_of_its_own(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    """Of light, which takes 5 s, inputs of 0.1 s tell only by its samples; first items compile."""
    pace = Pace({"inputs": 10, "color": 5}, {"inputs": 1.0, "color": 16.0}, workers=2)
    bar = Progress(15, "frames", "frames", note="compiling")
    bar.pace = pace
    clock[0] += 4
    bar._print_if_due()
    assert capsys.readouterr().err == "frames: 0/15 frames, 4 seconds so far, compiling\n"
    pace.ended("inputs", 2.0)
    assert bar.seconds_left() == pytest.approx((9 + 5 * 16) * 2 / 2)
    for number in range(9):
        pace.ended("inputs", 2.0 if number == 0 else 0.1)
        bar.announce(str(number), 1)
    assert bar.seconds_left() == pytest.approx(5 * 16 * 0.1 / 2)
    bar._print()
    assert "roughly 4 seconds left" in capsys.readouterr().err
    clock[0] += 5
    bar._print("home")
    assert "/s, 9 seconds so far, compiling" in capsys.readouterr().err
    for seconds in (9.0, 9.0, 5.0):
        pace.ended("color", seconds)
    bar._print()
    assert "/s, 5 seconds left" in capsys.readouterr().err
    assert bar.seconds_left() == pytest.approx(2 * 5 / 2)
    pace.dropped("color")
    clock[0] += 1
    assert bar.seconds_left() == pytest.approx(5 / 2 - 1)


def test_what_a_worker_announced_counts_once(clock: list[float]) -> None:
    bar = Progress(10, "color", expected=0.0)
    for name in ("one", "two", "two"):
        bar.announce(name, 2)
    clock[0] += 4
    assert bar.seconds_left() == pytest.approx(6)
    bar.advance(2, of="one")
    bar.advance(2, of="two")
    assert bar.seconds_left() == pytest.approx(6) and bar.done == 4


@pytest.mark.parametrize(("count", "said"), [(4, "0.20/s"), (1, "20 s each")])
def test_slow_work_has_seconds_for_each_item(
    count: int, said: str, clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    bar = Progress(10, "color", expected=100.0)
    clock[0] += 20
    bar.advance(count)
    assert capsys.readouterr().err.startswith(f"color: {count}/10 views, {said}, ")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.9, "1 second"), (40, "40 seconds"), (720, "12 minutes"), (46511, "12.9 hours")],
)
def test_durations_are_words(seconds: float, text: str) -> None:
    assert span(seconds) == text
