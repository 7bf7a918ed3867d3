"""Time budgets: the order of methods is that of the published time study."""

import json
from itertools import pairwise

import pytest

from pbrnet.model.evaluation.budget import Effort, efforts_for
from pbrnet.pipeline.passes.transport import samples_for
from tests.fixtures.paths import ROOT

TOLERANCE = 0.001  # of FLIP: neighbours this close may be in either order


@pytest.mark.parametrize("size", [(160, 120), (480, 360)])
def test_each_step_errs_less_in_the_published_study(size: tuple[int, int]) -> None:
    width, height = size
    study = json.loads((ROOT / "docs" / "data" / f"time-{width}x{height}.json").read_text())
    known: dict[Effort, float] = {}
    for point in study["points"]:
        spp = point["spp"] or samples_for(width * height)
        name = {"planned_denoised": "denoised"}.get(point["method"], point["method"])
        known[Effort(name, spp)] = point["flip"]
    efforts = efforts_for(width * height, ("radiosity", "hybrid", "denoised"))
    measured = [known[effort] for effort in efforts if effort in known]
    assert len(measured) >= 8
    for before, after in pairwise(measured):
        assert after <= before + TOLERANCE
