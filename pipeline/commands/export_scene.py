"""`pbrnet export-scene`: one scene as a file for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.pipeline.commands.options import FILE, PATH, idle_seed_option
from pbrnet.pipeline.scene_export.export import TARGETS, export_scene
from pbrnet.pipeline.terminal import say


@click.command(
    "export-scene",
    epilog="""\b
Examples:
  pbrnet export-scene data/scenes/home-0000 --to glb       exports/home-0000.glb, textures inside
  pbrnet export-scene data/scenes/home-0000 --to glb --out house.glb --cameras views.json
  pbrnet export-scene data/scenes/home-0000 --to usdz      metres, Z up
  pbrnet export-scene data/scenes/home-0000 --to mitsuba   a zip for the mitsuba command
\b
docs/exports.md describes what each format holds. pbrnet import reads the files back.""",
)
@click.argument("scene", type=PATH)
@click.option(
    "--to",
    "name",
    type=click.Choice(list(TARGETS)),
    required=True,
    help="Format: " + "; ".join(f"{one.name}: {one.title}" for one in TARGETS.values()) + ".",
)
@click.option("--out", type=FILE, help="File to write.  [default: exports/SCENE]")
@click.option(
    "--cameras",
    type=FILE,
    help="Camera file whose views become cameras; not for mitsuba.  [default: that of the "
    "scene's data folder]",
)
@click.option(
    "--panes/--no-panes",
    default=True,
    show_default=True,
    help="Sheets of glass in windows. Omit them for path tracers such as Cycles, which do not "
    "sample sun and sky through glass. Not for mitsuba.",
)
@idle_seed_option
def export_scene_command(
    scene: Path, name: str, out: Path | None, cameras: Path | None, panes: bool
) -> None:
    """Write the scene folder SCENE as one file for other programs.

    Lists what the format cannot hold, also in a JSON file beside the output.
    """
    out = out or Path("exports", scene.resolve().name + TARGETS[name].suffixes[0])
    done = export_scene(scene, name, out, cameras, panes)
    say(f"{scene} -> {', '.join(map(str, done.files))}: {done.objects} objects")
    if done.lost:
        say("not held by the format:", *(f"  - {line}" for line in done.lost))
