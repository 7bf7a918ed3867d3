"""Every pass over a small room: what it renders is what was recorded under its key."""

import numpy as np
import pytest

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.frames import Channels
from tests.fixtures.recorded import RECORDED, fault, known, recorded_room, rendered


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, wavefront: None) -> dict[Kind, Channels]:
    return rendered(*recorded_room(tmp_path_factory.mktemp("recorded") / "living"))


@pytest.mark.parametrize("kind", RECORDED)
def test_pixels_change_with_the_key_alone(kind: Kind, frames: dict[Kind, Channels]) -> None:
    message = fault(kind, known()[kind], frames[kind])
    assert message is None, message


@pytest.mark.parametrize("kind", RECORDED)
def test_a_changed_channel_is_noticed(kind: Kind, frames: dict[Kind, Channels]) -> None:
    """One band of each kind in another unit, and one channel too few."""
    before = known()[kind]
    noticed = 0
    for band, values in frames[kind].items():
        changed = values + (values > 0) if values.dtype.kind == "u" else values * 1.02
        other = np.array(changed, dtype=values.dtype)
        if (other != values).any():
            assert fault(kind, before, {**frames[kind], band: other}), band
            noticed += 1
    assert noticed
    stale = {**before, "keys": {}}
    assert "record its pixels" in str(fault(kind, stale, frames[kind]))
