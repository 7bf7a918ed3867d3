"""Report section of the study `decomposition`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "Two stages or one"
LABELS: dict[str, str] = {
    "two_stage": "Two stages, shading supervised",
    "end_to_end": "The same networks, trained on colour only",
}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "decomposition", TITLE, LABELS)
