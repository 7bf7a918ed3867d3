"""`pbrnet study`: the group of the studies' commands, assembled from the registry."""

from __future__ import annotations

import importlib

import click

from pbrnet.model.studies.registry import STUDIES, study_command

ALL = "all"  # the command that makes the figures of docs/results.md, model/studies/complete.py


class StudyGroup(click.Group):
    """Commands of the registered studies, imported on use."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Names of all studies, in the order of the registry, and `ALL`."""
        return [*STUDIES, ALL]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import and return a study's command; None for an unknown name."""
        if name == ALL:
            found: click.Command = importlib.import_module("pbrnet.model.studies.complete").command
            return found
        return study_command(name) if name in STUDIES else None

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the studies without importing them."""
        with formatter.section("Commands"):
            everything = (ALL, "All figures and plots of the results with one command.")
            formatter.write_dl([*STUDIES.items(), everything])


@click.group(
    cls=StudyGroup,
    epilog="""\b
Examples:
  pbrnet study pairs                       make a page of blind pairs for observers
  pbrnet study pairs --score answers/*.json    score their answer files
  pbrnet study loss --dry-run              list trainings that differ in the loss
  pbrnet study flicker SCENE --view VIEW   measure temporal stability of predictions
  pbrnet study all --docs docs             make all missing figures of docs/results.md

Results are written to metrics/studies/; `pbrnet report` shows them.""",
)
def study() -> None:
    """Repeat one of the paper's studies on your own networks."""
