"""Files of a study: its result with the picture beside it, and its section of the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pbrnet.model.figures.section import Section, render_section
from pbrnet.scenes.checked import plain
from pbrnet.scenes.files import atomic_file, write_json


def result_path(metrics: Path, study: str) -> Path:
    """Return the path of a study's result, `metrics/studies/NAME.json`."""
    return metrics / "studies" / f"{study}.json"


def write_result(target: Path, result: Any, picture: bytes) -> None:
    """Write a result as JSON to `target`, and its picture, a PNG, beside it."""
    with atomic_file(target.with_suffix(".png")) as partial:
        partial.write_bytes(picture)
    write_json(target, plain(result))


def study_section(study: str, title: str, **context: Any) -> Section:
    """Render the report section of a study from the template `section.html` of its package."""
    return render_section(f"{__package__}.{study}", f"study-{study}", title, **context)
