"""Export of one scene folder to a file of another format, and a report beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pbrnet.pipeline.scene_export.archive import write_archive
from pbrnet.pipeline.scene_export.content import Content, read_content
from pbrnet.pipeline.scene_export.glb import glb_bytes
from pbrnet.pipeline.scene_export.joints import add_joints
from pbrnet.pipeline.scene_export.light_variants import light_variants
from pbrnet.pipeline.scene_export.outdoors import SKY, Lit, Outdoors, outdoors_of, save_sky
from pbrnet.pipeline.scene_export.panes import add_panes
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.files import (
    atomic_directory,
    atomic_file,
    exists,
    read_json,
    temporary_folder,
    write_json,
)
from pbrnet.scenes.installation import optional


@dataclass(frozen=True)
class Exported:
    """Files of an export, and what its format does not hold."""

    files: tuple[Path, ...]
    objects: int
    lost: tuple[str, ...]


@dataclass(frozen=True)
class Target:
    """A format: its suffixes, of which the first is the default, and its title."""

    name: str
    title: str
    suffixes: tuple[str, ...]


TARGETS = {
    one.name: one
    for one in (
        Target("glb", "binary glTF 2.0, one file with textures", (".glb",)),
        Target("usd", "OpenUSD crate, textures in a folder beside it", (".usdc", ".usd")),
        Target("usdz", "OpenUSD as one package with textures", (".usdz",)),
        Target("mitsuba", "the scene folder as one archive", (".zip",)),
    )
}


def export_scene(
    folder: Path, name: str, out: Path, cameras: Path | None = None, panes: bool = True
) -> Exported:
    """Write the scene `folder` as format `name` to the file `out`.

    `cameras` is a camera file whose views become cameras; by default that of the scene's project,
    if it is there. Without `panes`, windows stay openings without glass. Beside `out` appear
    `OUT-sky.exr` for a scene with a sky, and a file named like `out` with `.json` added, which
    lists what the format does not hold. All are written by rename. Raises `InputError` for a scene
    that cannot be used or changes meanwhile, `ParameterError` for a suffix of another format, a
    file in the scene folder and options that an archive does not have, `MachineError` if `out` is
    something else than a regular file, or what would be replaced beside it is of no export.
    """
    target = TARGETS[name]
    if out.suffix.lower() not in target.suffixes:
        raise ParameterError(f"{out}: --to {name} writes {' or '.join(target.suffixes)} files")
    if out.resolve().is_relative_to(folder.resolve()):
        raise ParameterError(f"{out}: lies in the scene folder; choose another --out")
    unchanged = partial(_check_unchanged, folder, _states(folder))
    if name == "mitsuba":
        if cameras is not None or not panes:
            raise ParameterError(
                "--to mitsuba writes the scene folder as it is; leave out --cameras and --no-panes"
            )
        scene = load_scene(folder)
        with atomic_file(out) as archive:
            write_archive(folder, archive)
            unchanged()
        return Exported((out,), len(scene.objects), ())
    if name != "glb":
        optional("pxr", "usd")
    notes = out.with_name(f"{out.name}.json")
    beside = {"glb": f"{out.stem}-sky.exr", "usd": f"{out.stem}-textures"}.get(name)
    _check_replaced(notes, None if beside is None else out.with_name(beside))
    content = read_content(folder, cameras)
    variants = [] if name == "glb" else light_variants(content)
    add_joints(content)
    if panes:
        add_panes(content)
    elif any(portal.panes for portal in content.scene.portals):
        content.lost.note("window panes were left out: see the portals in the description")
    outdoors = outdoors_of(content)
    sky = out.with_name(f"{out.stem}-sky.exr")
    if outdoors is not None and outdoors.stated["kind"] == "image":
        places = {"glb": sky.name, "usd": f"{out.stem}-textures/{SKY}", "usdz": f"textures/{SKY}"}
        outdoors.stated["file"] = places[name]
    if name == "glb":
        files = _write_glb(content, outdoors, out, unchanged)
    else:
        lit = [(one, outdoors_of(one)) for one in variants]
        write = _write_usd if name == "usd" else _write_usdz
        files = write((content, outdoors), out, lit, unchanged)
    lost = content.lost.sentences()
    write_json(notes, {"scene": content.scene.scene_id, "format": name, "not held": list(lost)})
    return Exported((*files, notes), len(content.scene.objects), lost)


def _check_replaced(notes: Path, images: Path | None) -> None:
    """Refuse to replace a JSON file, a sky or a folder of images that no export wrote."""
    if exists(notes):
        record = read_json(notes)
        if not isinstance(record, dict) or "not held" not in record:
            raise MachineError(
                f"{notes}: not replaced, because it is no report of an export; choose another --out"
            )
    elif images is not None and exists(images):
        raise MachineError(
            f"{images}: not replaced, because {notes.name} of its export is missing; choose "
            "another --out"
        )


def _write_glb(
    content: Content, outdoors: Outdoors | None, out: Path, unchanged: Callable[[], None]
) -> tuple[Path, ...]:
    data = glb_bytes(content, outdoors)
    sky = out.with_name(f"{out.stem}-sky.exr")
    with ExitStack() as files:
        files.enter_context(atomic_file(out)).write_bytes(data)
        if outdoors is not None:
            save_sky(files.enter_context(atomic_file(sky)), outdoors.sky)
        unchanged()
    if outdoors is None:
        return (out,)
    content.lost.note(
        f"glTF has no sky: it is in {sky.name}, equirectangular in cd/m^2, its middle towards +Y "
        "of the scene (-Z of the GLB); the sun is a directional light"
    )
    return (out, sky)


def _write_usd(
    lit: Lit, out: Path, variants: Sequence[Lit], unchanged: Callable[[], None]
) -> tuple[Path, ...]:
    usd = optional("pbrnet.pipeline.scene_export.usd", "usd")
    textures = out.with_name(f"{out.stem}-textures")
    with temporary_folder() as work, atomic_file(out) as file, atomic_directory(textures) as images:
        stage = work / "stage.usdc"
        usd.write_usd(lit, stage, images, textures.name, variants)
        file.write_bytes(stage.read_bytes())
        unchanged()
    return (out, textures)


def _write_usdz(
    lit: Lit, out: Path, variants: Sequence[Lit], unchanged: Callable[[], None]
) -> tuple[Path, ...]:
    usd = optional("pbrnet.pipeline.scene_export.usd", "usd")
    with temporary_folder() as work, atomic_file(out) as file:
        usd.write_usdz(lit, file, work, variants)
        unchanged()
    return (out,)


def _states(folder: Path) -> dict[Path, tuple[int, int]]:
    """Size and time of each file of a scene folder; {} for another folder."""
    if not (folder / "scene.json").is_file():
        return {}
    found = {}
    for path in folder.rglob("*"):
        with suppress(OSError):
            state = path.stat()
            found[path] = (state.st_size, state.st_mtime_ns)
    return found


def _check_unchanged(folder: Path, before: dict[Path, tuple[int, int]]) -> None:
    """Raise `InputError` if a file of the scene folder is not as it was."""
    after = _states(folder)
    changed = sorted(path for path in {*before, *after} if before.get(path) != after.get(path))
    if changed:
        raise InputError(f"{changed[0]}: changed during the export; run the same command again")
