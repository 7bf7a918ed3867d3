"""Registry of the studies: the command and the report section of each follow from its line here.

A study that compares trainings is a module NAME of this package, which defines `command`, the
click command `pbrnet study NAME`; its words are in `trials/words.py`, its section of the report is
that of `trials`. Any other study is a folder: `NAME/command.py` defines `command`,
`NAME/results.py` defines `report_section(records)`. All are imported by name when they are needed,
so that the report and `pbrnet study --help` do not import torch.
"""

from __future__ import annotations

import importlib
from typing import Any

import click

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.trials.results import trials_section
from pbrnet.model.studies.trials.words import COMPARISONS

# Name: its line in `pbrnet study --help`. The report has the sections in this order.
STUDIES = {
    "pairs": "Blind pairs: which image is the rendering? (Table II)",
    "illumination": "Change the light and compare with the renderer (Figure 10).",
    "time": "Time every part; networks and renderer at equal time.",
    "loss": "Compare four losses (Figure 7).",
    "decomposition": "Compare two stages with one (Figure 8).",
    "composition": "Compare composition network and product (Figure 9).",
    "table": "Train all methods under equal conditions and compare them (Table I).",
    "noise": "Train on noisy ground truth (Figure 11).",
    "generalisation": "Test on another source, then fine-tune (Figures 14, 15).",
    "flicker": "Measure temporal stability along a camera move.",
    "photographs": "Train on any dataset, test on real photographs.",
}


def study_command(name: str) -> click.Command:
    """Import and return the click command of a study."""
    command: click.Command = _module(name if name in COMPARISONS else f"{name}.command").command
    return command


def report_sections(records: Records) -> list[Section]:
    """Return the report sections of all studies that have results."""
    sections = (
        trials_section(records, name)
        if name in COMPARISONS
        else _module(f"{name}.results").report_section(records)
        for name in STUDIES
    )
    return [section for section in sections if section is not None]


def _module(name: str) -> Any:
    return importlib.import_module(f"{__package__}.{name}")
