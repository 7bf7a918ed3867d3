"""Report section of the study `generalisation`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "Another source"
LABELS: dict[str, str] = {
    "before": "Trained without the source",
    "before, product": "The same, reflectance × predicted shading",
    "tuned": "Fine-tuned on the source",
    "tuned, product": "The same, reflectance × predicted shading",
    "alone": "Trained on the tuning views only",
    "alone, product": "The same, reflectance × predicted shading",
    "ceiling": "Reflectance × true shading",
}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "generalisation", TITLE, LABELS)
