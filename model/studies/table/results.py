"""Report section of the study `table`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "All methods"
LABELS: dict[str, str] = {}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "table", TITLE, LABELS)
