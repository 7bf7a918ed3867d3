"""Files of a study: result and picture, section of the report, locks of its trials."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pbrnet.model.figures.section import Section, render_section
from pbrnet.scenes.checked import plain
from pbrnet.scenes.files import acquire, atomic_file, machine_errors, write_json


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


@contextmanager
def exclusive(path: Path, wait: bool) -> Iterator[bool]:
    """Yield whether this process holds the lock file `path`, which it makes; release it after.

    With `wait` it waits for another process that holds the lock. A killed process holds none.
    """
    with machine_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.open("a")
    with lock:
        yield acquire(lock.fileno(), fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
