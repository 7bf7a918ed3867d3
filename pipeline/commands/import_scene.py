"""`pbrnet import`: import of one scene file into a scene folder."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import click

from pbrnet.pipeline.commands.options import FOLDER, PATH, NumberRange
from pbrnet.pipeline.farm.limits import Limits, run_limited
from pbrnet.pipeline.inspection.sizes import triangles_of
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.checked import check_name
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.files import sweep
from pbrnet.scenes.importing.changes import DOUBTS
from pbrnet.scenes.importing.options import FILE
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.registry import SOURCES, import_scene, is_exported, option_names
from pbrnet.scenes.seeds import derive
from pbrnet.scenes.variants.vary import VariantSettings, vary_scene

_SOURCES = tuple(dict.fromkeys(SOURCES.values()))


def _sections() -> dict[str, list[str]]:
    """Titles of the help's sections -> names of import options, by the sources that take them."""
    takers: dict[str, list[str]] = {}
    for source in _SOURCES:
        for one in fields(source):
            if one.name == "seed":  # of the variants of all kinds
                continue
            takers.setdefault(one.name, []).append(source.title)
    shared: dict[str, list[str]] = {}
    single: dict[str, list[str]] = {}
    every: dict[str, list[str]] = {}
    for name, titles in takers.items():
        if len(titles) == len(_SOURCES):
            every.setdefault("All file types, but not scene folders", []).append(name)
        elif len(titles) > 1:
            shared.setdefault(", ".join(titles), []).append(name)
        else:
            single.setdefault(f"{titles[0]} only", []).append(name)
    return {**shared, **single, **every}


def _import_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of all scene sources to a command."""
    described = {one.name: (source, one) for source in _SOURCES for one in fields(source)}
    del described["seed"]  # one for layouts and variants
    for name, (source, one) in reversed(described.items()):
        hint = get_type_hints(source)[name]
        command = click.option(
            f"--{name.replace('_', '-')}",
            name,
            metavar=one.metadata["metavar"],
            help=_help(one.metadata),
            **_click_type(hint, one.default, one.metadata["metavar"] == FILE),
        )(command)
    return command


def _help(metadata: Mapping[str, Any]) -> str:
    """Help text of an option, with the range of a number."""
    text = str(metadata["help"])
    return f"{text}  [{metadata['allowed']}]" if "check" in metadata else text


def _click_type(hint: Any, default: Any, is_file: bool) -> dict[str, Any]:
    """Arguments of `click.option` for a field with a type and a default.

    A path is that of a file if `is_file`, else of a folder.
    """
    if hint is bool:
        return {"is_flag": True}
    if get_origin(hint) in (tuple, dict):
        return {"multiple": True}
    if get_origin(hint) is Literal:
        return {"type": click.Choice(get_args(hint)), "default": default}
    if Path in get_args(hint):
        kind = click.Path(path_type=Path, file_okay=is_file, dir_okay=not is_file, exists=True)
        return {"type": kind, "default": default}
    if hint is float or float in get_args(hint):
        return {"type": click.FLOAT, "default": default}
    if hint is int or int in get_args(hint):
        return {"type": click.INT, "default": default}
    return {"type": click.STRING, "default": default, "show_default": bool(default)}


class SectionedCommand(click.Command):
    """Command whose help groups the options by the kind of file that they apply to."""

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options in sections."""
        names = _sections()
        titles = {name: title for title, group in names.items() for name in group}
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in ("Options", *names)}
        for parameter in self.get_params(context):
            record = parameter.get_help_record(context)
            if record is not None and isinstance(parameter, click.Option):
                sections[titles.get(parameter.name or "", "Options")].append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


_KINDS = ", ".join(f"{one.title} ({' '.join(one.suffixes)})" for one in _SOURCES)
_HELP = f"""Import the scene PATH into the scene folder OUT and report what was found and changed.

PATH is a file of one of these types: {_KINDS}; or a scene folder with scene.json. A model may be a
building or a single object, which is placed in a room. Options of other file types are refused."""


@click.command(
    cls=SectionedCommand,
    help=_HELP,
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
File types, options and limits: docs/scenes.md.""",
)
@click.argument("path", type=PATH)
@click.option(
    "--out", type=FOLDER, required=True, help="Scene folder to write; its name is the scene's id."
)
@click.option("--id", "scene_id", help="Id of the scene.  [default: name of the folder]")
@click.option(
    "--variants",
    type=click.IntRange(0, 999),
    default=0,
    help="Number of variants with other finishes and light, written to OUT-v1 and so on.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    help="Seed of the variants, and of what a layout leaves open.",
)
@click.option(
    "--max-seconds",
    type=NumberRange(0.1),
    default=SceneParams.import_seconds,
    help="Time limit of the import in seconds.",
)
@click.option(
    "--max-memory",
    type=NumberRange(0.25),
    default=SceneParams.import_memory,
    help="Memory limit of the import in GiB.",
)
@_import_options
def import_command(
    path: Path,
    out: Path,
    scene_id: str | None,
    variants: int,
    seed: int,
    max_seconds: float,
    max_memory: float,
    **options: Any,
) -> None:
    """Run `pbrnet import`; exit code 1 if no room was found, or up axis or scale are in doubt."""
    given = _given_options(path, options)
    if "seed" in option_names(path.suffix) and _is_given("seed"):
        given["seed"] = seed
    name = scene_id if scene_id is not None else out.name
    for longest in (name, f"{name}-v{variants}" if variants else name):
        check_name(longest, "a scene's id", error=InputError)
    started = time.monotonic()

    work = partial(import_scene, path, out, name, **given)
    sweep(out.parent, recursive=False)  # what a killed import left
    try:
        run_limited(work, Limits(max_seconds, max_memory), str(path))
    except (MachineError, KeyboardInterrupt):
        sweep(out.parent, recursive=False)
        raise
    scene = load_scene(out)
    say(f"{path} -> {out} in {time.monotonic() - started:.1f} s")
    for line in summary(scene):
        say(line)
    for number in range(1, variants + 1):
        name = f"{scene.scene_id}-v{number}"
        place = out.with_name(f"{out.name}-v{number}")
        seed_of = derive(seed, "import", scene.scene_id)
        made = vary_scene(out, place, name, VariantSettings.of(SceneParams(), seed_of, number))
        say(f"variant {place}: light: {made.lighting}")
    doubts = [change for change in scene.changes if change.startswith(DOUBTS)]
    for doubt in doubts:
        say(f"Warning: {path}: {doubt}", err=True)
    if doubts:
        click.get_current_context().exit(1)


def _parameters(pairs: tuple[str, ...]) -> dict[str, str]:
    """Return `NAME=VALUE` pairs as a mapping; raises `ParameterError` for other text."""
    made = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name:
            raise ParameterError(f"--parameter: {pair!r} is not of the form NAME=VALUE")
        made[name.removeprefix("$")] = value
    return made


def _given_options(path: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Return the options for the kind of file that `path` is; a scene folder takes none.

    Raises `ParameterError` for a given option of another kind.
    """
    copied = path.is_dir() or is_exported(path)
    source = None if copied else SOURCES.get(path.suffix.lower())
    known = option_names(path.suffix) if source is not None else ()
    for name in sorted(options):
        if name not in known and _is_given(name):
            if source is None and not copied:
                continue  # `import_scene` refuses the file itself
            kind = "scene folders and exported scenes" if copied else f"{path.suffix} files"
            raise ParameterError(f"--{name.replace('_', '-')}: not for {kind}")
    given = {name: options[name] for name in known if name in options}
    if "parameter" in given:
        given["parameter"] = _parameters(given["parameter"])
    return given


def _is_given(option: str) -> bool:
    """Test whether an option is on the command line."""
    origin = click.get_current_context().get_parameter_source(option)
    return origin == click.core.ParameterSource.COMMANDLINE


def summary(scene: Scene) -> list[str]:
    """Return lines of text on the content of a scene and the changes of its importer."""
    lines = [f"scene {scene.scene_id}: {scene.source.get('kind', '')}, light: {scene.lighting}"]
    placement = scene.source.get("placement")
    if isinstance(placement, dict):
        lines.append(
            f"  placed   as {placement['kind']}, 1 unit = {placement['scale']:.4g} m, "
            f"+{placement['up'].upper()} up, confidence {placement['confidence']:.2f}, because"
        )
        lines += [f"           - {reason}" for reason in placement["reasons"]]
    for room in scene.rooms:
        west, south = (min(point[axis] for point in room.floor) for axis in (0, 1))
        east, north = (max(point[axis] for point in room.floor) for axis in (0, 1))
        height = room.ceiling_z - room.floor_z
        lines.append(
            f"  room     {room.id:10} {room.type:9} {east - west:5.2f} x {north - south:.2f} m, "
            f"{height:.2f} m high{'' if room.has_light else ', no light'}"
        )
    items = Counter(item.category for item in scene.objects if not item.is_structure)
    structure = sum(item.is_structure for item in scene.objects)
    shapes = sum(len(item.shapes) for item in scene.objects)
    named = ", ".join(f"{count} {name}" for name, count in items.most_common(12))
    lines += [
        f"  objects  {sum(items.values())} ({named}) and {structure} parts of the building",
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
