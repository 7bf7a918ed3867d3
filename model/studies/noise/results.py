"""Report section of the study `noise`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "Noisy ground truth"
LABELS: dict[str, str] = {
    "clean": "The dataset's own ground truth",
}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "noise", TITLE, LABELS)
