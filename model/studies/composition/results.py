"""Report section of the study `composition`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "Composition network or multiplication"
LABELS: dict[str, str] = {
    "network": "Composition network",
    "product_linear": "The same, projected linearly",
    "ceiling": "Reflectance × true shading",
}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "composition", TITLE, LABELS)
