"""What every test shares."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED_SCENES = Path(__file__).resolve().parents[2] / "shared" / "scenes"


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """Real scenes by other people, which lie beside the project where they are available."""
    if not SHARED_SCENES.is_dir():
        pytest.skip("the shared example scenes are not on this machine")
    return SHARED_SCENES
