"""Every pass over a small room: what it renders is what was recorded under its revision."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.registry import PASSES, SURFACES
from tests.fixtures.recorded import FILE, RECORDED, recorded_room, rendered, summary

AGAIN = "python -m tests.fixtures.recorded"
# Of the values that are not 0: light frames differ from processor to processor in under 1 %, and
# another sampling or another unit in nearly all of them.
LEAST_ALIKE, TOLERANCE = 0.9, 2e-3


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, wavefront: None) -> dict[Kind, Channels]:
    return rendered(*recorded_room(tmp_path_factory.mktemp("recorded") / "living"))


def fault(kind: Kind, known: dict[str, Any], channels: Channels) -> str | None:
    """Say what is wrong with a kind of frames that was recorded as `known`, or return None."""
    if known["revision"] != PASSES[kind].revision:
        return f"{kind} has another revision; record its pixels with: {AGAIN}"
    raise_it = f"{kind} has other pixels under the same REVISION: raise it, then run {AGAIN}"
    found = summary(kind, channels)
    if kind in SURFACES:
        return None if found["digest"] == known["digest"] else raise_it
    if found["values"].keys() != known["values"].keys():
        return raise_it
    for name, values in known["values"].items():
        here, there = np.array(found["values"][name]), np.array(values)
        if here.shape != there.shape or alike(here, there) < LEAST_ALIKE:
            return f"{name}: {raise_it}"
    return None


def alike(one: np.ndarray, other: np.ndarray) -> float:
    """Share of equal values, within the tolerance, of those that are not 0 in both."""
    some = (one != 0) | (other != 0)
    close = np.isclose(one[some], other[some], rtol=TOLERANCE, atol=0)
    return float(close.mean()) if some.any() else 1.0


@pytest.mark.parametrize("kind", RECORDED)
def test_pixels_change_with_the_revision_alone(kind: Kind, frames: dict[Kind, Channels]) -> None:
    message = fault(kind, json.loads(Path(FILE).read_text())[kind], frames[kind])
    assert message is None, message


@pytest.mark.parametrize("kind", RECORDED)
def test_a_changed_channel_is_noticed(kind: Kind, frames: dict[Kind, Channels]) -> None:
    """One band of each kind in another unit, and one channel too few."""
    known = json.loads(Path(FILE).read_text())[kind]
    noticed = 0
    for band, values in frames[kind].items():
        changed = values + (values > 0) if values.dtype.kind == "u" else values * 1.02
        other = np.array(changed, dtype=values.dtype)
        if (other != values).any():
            assert fault(kind, known, {**frames[kind], band: other}), band
            noticed += 1
    assert noticed
    stale = {**known, "revision": known["revision"] + 1}
    assert "record its pixels" in str(fault(kind, stale, frames[kind]))
