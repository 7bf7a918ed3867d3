"""Importer of layouts: read, plan, furnish, light and write with the generator of homes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pbrnet.scenes.assets.index import load_index
from pbrnet.scenes.contract import Credit, Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, parse_json, read_text
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import find_credit
from pbrnet.scenes.layout.building.plan import plan_of
from pbrnet.scenes.layout.building.swings import with_swings
from pbrnet.scenes.layout.checks import check_layout
from pbrnet.scenes.layout.formats import FORMATS, LayoutFormat
from pbrnet.scenes.layout.furnishing.furnish import furnish_layout
from pbrnet.scenes.layout.furnishing.things import left_things
from pbrnet.scenes.layout.layout import Layout
from pbrnet.scenes.layout.options import LayoutOptions
from pbrnet.scenes.looks import STYLES, HomeSettings
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.procedural.design import Design, catalogue_sampler, draw_style
from pbrnet.scenes.procedural.home import Origin, write_home
from pbrnet.scenes.seeds import generator

_MOST_BYTES = 16 << 20
_PIECE_TRIANGLES = 30_000  # of a piece from catalogues
_GROUNDS = (-0.15, -0.3, -0.45)  # metres, heights of the ground outdoors


def import_layout(
    path: Path, out: Path, scene_id: str, options: LayoutOptions, opened: OpenedFiles
) -> Scene:
    """Import a layout into the scene folder `out`.

    Equal files and options give equal bytes. Raises `InputError` that names file and key, and in
    pbrnet's own format the line, of what cannot be used.
    """
    for file in (path, options.assets):
        if file is not None:
            opened.is_file(file)
    text = read_text(path, _MOST_BYTES)
    kind, content = recognised(path, text)
    try:
        layout = check_layout(kind.read(content, path, options))
        return _write(layout, path, out, scene_id, options, opened)
    except InputError as error:
        if kind.line is None or path.name in str(error):
            raise
        raise InputError(f"{path}: {kind.line(text, str(error))}{error}") from None


def recognised(path: Path, text: str) -> tuple[LayoutFormat, Any]:
    """Return the format of a file and its content; raises `InputError` for unknown ones."""
    is_json = path.suffix.lower().endswith("json")
    content = parse_json(text, str(path)) if is_json else text
    for kind in FORMATS:
        if (kind.content == "json") == is_json and kind.recognises(content):
            return kind, content
    known = ", ".join(kind.title for kind in FORMATS)
    raise InputError(
        f"{path}: no layout of a known format ({known}), but maybe a description of a scene whose "
        "surfaces are in other files: convert it with the tools of its data set to .obj, .glb or "
        ".usd; a scene folder is imported by the folder's name"
    )


def _write(
    layout: Layout,
    path: Path,
    out: Path,
    scene_id: str,
    options: LayoutOptions,
    opened: OpenedFiles,
) -> Scene:
    """Build, furnish and write a checked layout."""
    changes = Changes()
    for change in layout.changes:
        changes.note(change)
    home = _home(layout, options)
    plan, openings = plan_of(layout, generator(home.seed, "ground").pick(_GROUNDS), changes)
    style = draw_style(home)
    sampler = catalogue_sampler(home, options.catalogue)
    rng = home.draw("furniture", "furniture")
    furnished = furnish_layout(
        rng, layout, plan, style, sampler, changes, add_lamps=options.lamps != "home"
    )
    solid = [one.footprint for one in furnished.standing if one.on_floor]
    plan = with_swings(generator(home.seed, "swings"), plan, openings, solid)
    placed = furnished.placed
    if options.things:
        placed += left_things(generator(home.seed, "things"), plan, style, placed)
    credit = _credit(layout, options, opened, changes)
    source = {
        "kind": "layout",
        "file": path.name,
        "name": layout.name,
        "seed": str(home.seed),
        "furnishing": furnished.record,
    }
    origin = Origin(source, _plan_name(layout), (credit,), changes.sentences())
    design = Design(plan, style, placed)
    return write_home(out, scene_id, design, origin, home)


def _home(layout: Layout, options: LayoutOptions) -> HomeSettings:
    """Settings of the generator; `InputError` if there are no catalogues in their folder."""
    folder = options.catalogue
    if folder is not None and not load_index(folder).pieces:
        raise InputError(f"{folder}: holds no catalogue; convert one with: pbrnet assets")
    named = next((one for one in STYLES if one == (options.style or layout.style)), None)
    return HomeSettings(
        next(seed for seed in (options.seed, layout.seed, 0) if seed is not None),
        options.lighting,
        styles=(named,) if named else STYLES,
        share=0.0 if folder is None else 1.0,
        triangles=_PIECE_TRIANGLES,
        outdoors=options.outdoors,
    )


def _credit(
    layout: Layout, options: LayoutOptions, opened: OpenedFiles, changes: Changes
) -> Credit:
    licence, author = options.licence or layout.licence, options.author or layout.author
    found = find_credit(opened, layout.name, licence, author, changes)
    source = layout.source or found.source
    return replace(found, part="plan and boxes of furniture", source=source)


def _plan_name(layout: Layout) -> str:
    """A name that layouts of the same rooms share, so that their scenes stay in one split."""
    return f"layout-{digest_bytes(repr(layout.rooms).encode())[:16]}"
