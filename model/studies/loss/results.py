"""Report section of the study `loss`."""

from __future__ import annotations

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section

TITLE = "Loss functions"
LABELS: dict[str, str] = {
    "l1": "L1 loss on the image only",
    "fifth": "Deepest of the five feature layers only",
    "full": "Image and all five feature layers",
    "part": "Part-perceptual: image and three feature layers",
}


def report_section(records: Records) -> Section | None:
    """Return the study's section of the report; None without a result."""
    return trials_section(records, "loss", TITLE, LABELS)
