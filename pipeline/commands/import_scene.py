"""`pbrnet import`: one scene from any source into a scene folder, and what became of it."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import Any

import click

from pipeline.inspection.sizes import triangles_of
from scenes.contract import Scene
from scenes.errors import ParameterError
from scenes.import_options import OPTIONS, SPELLED
from scenes.params import SceneParams
from scenes.registry import import_scene
from scenes.seeds import derive
from scenes.variants.vary import vary_scene

# Sections of the help: title -> names of parameters; what is in none comes first.
_SECTIONS = {
    "Mitsuba, glTF, GLB, OBJ": ("scale", "up", "root", "sky"),
    "Mitsuba only": ("parameters", "skip_missing"),
    "Sweet Home 3D only": ("levels", "time", "lamps"),
    "Every kind of file, but for scene folders": ("licence", "author"),
}


class SectionedCommand(click.Command):
    """A command whose help lists options by the kind of file that they are for."""

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options in sections."""
        titles = {name: title for title, names in _SECTIONS.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        sections |= {title: [] for title in _SECTIONS}
        for parameter in self.get_params(context):
            record = parameter.get_help_record(context)
            if record is not None and isinstance(parameter, click.Option):
                sections[titles.get(parameter.name or "", "Options")].append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


@click.command(
    cls=SectionedCommand,
    epilog="""\b
Examples:
  pbrnet import room/scene.xml --out data/scenes/room
  pbrnet import old.xml --out data/scenes/old --parameter envmap_path=sky.exr --scale 0.01
  pbrnet import house.sh3d --out data/scenes/house --time 19:30 --level Upstairs
  pbrnet import house.sh3d --out data/scenes/house --variants 3 --seed 7
  pbrnet import chair.glb --out data/scenes/chair
  pbrnet import flat.obj --out data/scenes/flat --up z --scale 0.01 --author "A. Maker" \\
      --licence CC-BY-4.0
\b
All kinds, options and limits: docs/scenes.md.""",
)
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Scene folder to make; its name becomes the scene's id.",
)
@click.option("--id", "scene_id", default=None, help="Another id than the folder's name.")
@click.option(
    "--variants",
    type=click.IntRange(0, 999),
    default=0,
    help="Scenes to make beside it, OUT-v1 and so on, with other finishes and light.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Of the variants; the import itself makes no random choice.",
)
@click.option("--scale", type=click.FloatRange(1e-6, 1e6), help="Metres per unit of the file.")
@click.option(
    "--up",
    type=click.Choice(["auto", "x", "y", "z"]),
    default="auto",
    show_default=True,
    help="Axis that points up in the file.",
)
@click.option(
    "--root",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    default=None,
    help="Folder above the file's from which it may read, too.",
)
@click.option(
    "--sky",
    is_flag=True,
    help="Add sun and sky: to a Mitsuba scene without light, to any building as model.",
)
@click.option(
    "--parameter",
    "parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="Value for a $parameter of the file; may be repeated.",
)
@click.option("--skip-missing", is_flag=True, help="Go on without shapes whose mesh is missing.")
@click.option(
    "--level",
    "levels",
    multiple=True,
    metavar="NAME",
    help="Level of a home to bring in; may be repeated. All if not given.",
)
@click.option("--time", metavar="HH:MM", help="Local time of day in a home, instead of its own.")
@click.option(
    "--lamps",
    type=click.Choice(["home", "on", "off"]),
    default="home",
    show_default=True,
    help="A home's lamps: as it has them, all lit, or none.",
)
@click.option("--licence", default="", help="Terms of use, e.g. CC-BY-4.0, if no file says so.")
@click.option("--author", default="", help="Whose work it is, if no file says so.")
def import_command(
    path: Path,
    out: Path,
    scene_id: str | None,
    variants: int,
    seed: int,
    **options: Any,
) -> None:
    """Bring the scene PATH into the scene folder OUT and say what was found, changed and lost.

    PATH is a Mitsuba XML file of version 0.4 to 3.x (a house of the PBRS release, too), a Sweet
    Home 3D home (.sh3d), a glTF, GLB or OBJ model of a building or of one object, which gets a
    room of its own, or a scene folder with scene.json. Options for another kind of file than
    PATH are refused.
    """
    options["parameters"] = _parameters(options["parameters"])
    started = time.monotonic()
    scene = import_scene(path, out, scene_id, **_options_for(path, options))
    click.echo(f"{path} -> {out} in {time.monotonic() - started:.1f} s")
    for line in summary(scene):
        click.echo(line)
    for number in range(1, variants + 1):
        name = f"{scene.scene_id}-v{number}"
        place = out.with_name(f"{out.name}-v{number}")
        made = vary_scene(
            out, place, name, number, SceneParams(), derive(seed, "import", scene.scene_id)
        )
        click.echo(f"variant {place}: light: {made.lighting}")


def _parameters(pairs: tuple[str, ...]) -> dict[str, str]:
    """`NAME=VALUE` pairs as a mapping; raises `ParameterError` for what is none."""
    made = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name:
            raise ParameterError(f"--parameter: {pair!r} is not of the form NAME=VALUE")
        made[name.removeprefix("$")] = value
    return made


def _options_for(path: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Those of `options` that the kind of `path` takes; a scene folder takes none.

    Raises `ParameterError` for one that was given and belongs to another kind.
    """
    context = click.get_current_context()
    own = () if path.is_dir() else OPTIONS.get(path.suffix.lower(), tuple(options))
    for name in sorted(options):
        source = context.get_parameter_source(name)
        if name not in own and source == click.core.ParameterSource.COMMANDLINE:
            kind = "scene folders" if path.is_dir() else f"{path.suffix} files"
            raise ParameterError(f"--{SPELLED.get(name, name).replace('_', '-')}: not for {kind}")
    return {name: options[name] for name in own}


def summary(scene: Scene) -> list[str]:
    """What a scene holds, and what its importer changed, as lines of text."""
    lines = [f"scene {scene.scene_id}: {scene.source.get('kind', '')}, light: {scene.lighting}"]
    for room in scene.rooms:
        west, south = (min(point[axis] for point in room.floor) for axis in (0, 1))
        east, north = (max(point[axis] for point in room.floor) for axis in (0, 1))
        height = room.ceiling_z - room.floor_z
        lines.append(
            f"  room     {room.id:10} {room.type:9} {east - west:5.2f} x {north - south:.2f} m, "
            f"{height:.2f} m high{'' if room.has_light else ', no light'}"
        )
    things = Counter(thing.category for thing in scene.objects if not thing.is_structure)
    structure = sum(thing.is_structure for thing in scene.objects)
    shapes = sum(len(thing.shapes) for thing in scene.objects)
    named = ", ".join(f"{count} {name}" for name, count in things.most_common(12))
    lines += [
        f"  objects  {sum(things.values())} ({named}) and {structure} parts of the building",
        f"  lights   {_counted(Counter(light.kind for light in scene.lights))}",
        f"  portals  {_counted(Counter(portal.kind for portal in scene.portals))}",
        f"  views    {len(scene.source.get('views', []))} stored",
        f"  geometry {shapes} shapes, {_triangles(scene):,} triangles",
    ]
    for credit in scene.credits:
        lines.append(f"  credit   {credit.title} by {credit.author}, {credit.licence}")
    lines.append("changed or lost:" if scene.changes else "nothing was changed or lost")
    lines += [f"  - {change}" for change in scene.changes]
    return lines


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "none"


def _triangles(scene: Scene) -> int:
    return sum(triangles_of(path) for path in sorted((scene.folder / "meshes").glob("*.ply")))
