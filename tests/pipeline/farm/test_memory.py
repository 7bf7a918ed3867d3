"""Memory of a worker stays flat over many scenes, and the ledger shows it."""

import os
from pathlib import Path

import pytest

from benchmarks.memory import Course, courses, draw, measure, parameters
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from tests.fixtures.stages import write_room


def test_growth_is_told_from_a_large_scene_that_comes_back() -> None:
    flat = Course("truth", (1.0, 9.0, 5.0, 9.0, 6.0, 9.0, 7.0, 9.0), 2)
    assert flat.peaks == (9.0, 9.0, 9.0) and flat.growth == 0
    leak = Course("truth", tuple(100.0 + number for number in range(30)), 10)
    assert leak.growth == pytest.approx(129 / 119 - 1)


@pytest.mark.check
@pytest.mark.timeout(600)
def test_memory_is_flat_over_rooms(tmp_path: Path) -> None:
    """A small sample of the check below: forty scenes, one worker."""
    for number in range(40):
        room = tmp_path / "scenes" / f"room{number:02}"
        write_room(room, size=(4.0, 3.0 + number % 5 / 5, 2.6), lamp=5.0 + number)
    params = parameters(homes=1)
    run_cameras(tmp_path, params)
    run_frames("groundtruth", tmp_path, params)
    found = {course.stage: course for course in courses(tmp_path, 10, ("cameras", "truth"))}
    assert len(found["cameras"].memory) == 40
    for stage in ("cameras", "truth"):
        assert len(found[stage].memory) > 35  # a room or two has nothing to look at
        assert min(found[stage].memory) > 50
        assert found[stage].growth < 0.05, found[stage].peaks


@pytest.mark.check
@pytest.mark.timeout(7200)
def test_memory_is_flat_over_five_hundred_scenes(tmp_path: Path) -> None:
    """One worker that is never replaced; PBRNET_PICTURES names a folder for the drawing."""
    found = measure(tmp_path, homes=10, scenes=500)
    pictures = Path(os.environ.get("PBRNET_PICTURES", tmp_path))
    draw(found).savefig(pictures / "memory.png")
    for course in found:
        assert len(course.memory) == 500
        assert course.growth < 0.05, (course.stage, course.peaks)
