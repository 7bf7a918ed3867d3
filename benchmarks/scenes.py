"""Real scenes through the whole pipeline: `python -m benchmarks.scenes FOLDER --out DIR`.

Imports every scene file below FOLDER (homes, Mitsuba scenes, houses of the PBRS release, glTF),
each in its own process, runs all stages up to the dataset at a small size, and writes a table,
DIR/scenes.md, and a sheet of each scene's colour frames. Exits with 1 if an import failed or
exceeded its time or memory, or if a stage failed.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import click
from defusedxml import ElementTree

from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import frame_path, read_frame
from pbrnet.pipeline.images import contact_sheet, png_bytes, tone_picture
from pbrnet.pipeline.inspection.sizes import triangles_of
from pbrnet.pipeline.params import load_params
from pbrnet.pipeline.render.leaks import Leak, find_leaks
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.tonemap import ToneParams, exposure_of
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.checked import build
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.files import read_json, write_json, write_text
from pbrnet.scenes.registry import scene_name

ROOT = Path(__file__).resolve().parent.parent
TEMPLATE = "main_template_color.xml"  # of a house of the PBRS release, beside other settings
SUFFIXES = (".sh3d", ".glb", ".gltf", ".xml")
PARAMETERS = """
image: {{width: {width}, height: {height}}}
scenes: {{homes: 0, imports: [below]}}
cameras: {{views_per_scene: {views}}}
groundtruth: {{spp: {spp}, block_spp: 8}}
"""
# Runs the command line and says last what memory it took at most. (The usage that a parent reads
# of its child is never below the parent's own, as both are one until the child begins.)
IMPORT = """
import atexit, sys
from pathlib import Path
from pbrnet.pipeline.cli import main
status = Path("/proc/self/status")
atexit.register(lambda: print(status.read_text().split("VmHWM:")[1].split()[0], file=sys.stderr))
sys.exit(main())
"""


@dataclass(frozen=True)
class Cost:
    """Cost of an import: processor seconds, wall seconds, peak resident MB."""

    seconds: float
    clock: float
    megabytes: float
    error: str = ""


def scene_files(folder: Path) -> list[Path]:
    """Return the scene files below `folder`; of a PBRS house only its template."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES or not path.is_file():
            continue
        if path.suffix.lower() == ".xml":
            try:
                root = ElementTree.parse(path).getroot()
            except (ElementTree.ParseError, ValueError):
                continue
            has_template = (path.parent / TEMPLATE).is_file() and path.name != TEMPLATE
            if root.tag != "scene" or has_template:
                continue
        found.append(path)
    return found


def bring(path: Path, folder: Path, out: Path) -> Cost:
    """Import `path` in its own process, so that the peak memory is that of the import."""
    command = [sys.executable, "-c", IMPORT, "import", str(path), "--out", str(out)]
    if path.suffix.lower() == ".xml":
        command += ["--root", str(folder)]
    started = time.monotonic()
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    said, _, peak = process.stderr.read().rstrip().rpartition("\n")
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    error = "" if process.returncode == 0 else (said.strip() or str(process.returncode))
    seconds = usage.ru_utime + usage.ru_stime
    kilobytes = int(peak) if peak.isdigit() else usage.ru_maxrss  # the latter where it was killed
    return Cost(seconds, time.monotonic() - started, kilobytes / 1024, error)


def leaks_of(scene: Scene) -> tuple[str, list[Leak]]:
    """Return the light that enters other than by portals: the share of the worst room, and all."""
    leaks = find_leaks(open_scene(scene))
    if not leaks:
        return "0" if scene.rooms else "-", leaks
    worst = max(leaks, key=lambda leak: leak.share)
    return f"{100 * worst.share:.2g} ({len(leaks)} of {len(scene.rooms)} rooms)", leaks


def sheet(data: Path, scene_id: str, out: Path) -> None:
    """Return the colour frames of a scene as a contact sheet."""
    views = load_cameras(data / "cameras" / f"{scene_id}.json").views
    pictures, labels = [], []
    for view in views:
        path = frame_path(data, "color", view)
        if path.is_file():
            image = read_frame(path).rgb
            pictures.append(tone_picture(image, exposure_of(image, ToneParams())))
            labels.append(f"{view.view_id}  {view.room_type}")
    out.write_bytes(png_bytes(contact_sheet(pictures, 4, labels)))


def row(data: Path, path: Path, cost: Cost, accepted: int, worst: str) -> str:
    """Return a line of the table."""
    if cost.error:
        return f"| {path.name} | refused: {cost.error.splitlines()[-1]} |" + " |" * 11
    scene = load_scene(data / "scenes" / scene_name(path))
    views = len(load_cameras(data / "cameras" / f"{scene.scene_id}.json").views)
    triangles = sum(triangles_of(file) for file in sorted((scene.folder / "meshes").glob("*.ply")))
    items = sum(not item.is_structure for item in scene.objects)
    name = path.parent.name if path.suffix.lower() == ".xml" else path.name
    return (
        f"| {name[:24]} | {cost.seconds:.1f} | {cost.megabytes:.0f} | {len(scene.rooms)} "
        f"| {items} | {len(scene.lights)} | {len(scene.portals)} | {triangles:,} | {views} "
        f"| {accepted} | {worst} | {len(scene.changes)} |"
    )


def attempt(stage: Callable[[], object]) -> bool:
    """Run a stage; print its failures and continue with the rest."""
    try:
        click.echo(str(stage()))
    except StageError as error:
        click.echo(str(error), err=True)
        return False
    return True


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--width", default=160, show_default=True)
@click.option("--height", default=120, show_default=True)
@click.option("--spp", default=16, show_default=True)
@click.option("--views", default=4, show_default=True, help="Views a scene.")
@click.option("--most-seconds", default=60.0, show_default=True, help="Of an import.")
@click.option("--most-gib", default=4.0, show_default=True, help="Of an import's memory.")
def main(
    folder: Path,
    out: Path,
    width: int,
    height: int,
    spp: int,
    views: int,
    most_seconds: float,
    most_gib: float,
) -> None:
    """Run every scene below FOLDER through the pipeline and write DIR/scenes.md."""
    data = out.resolve() / "data"
    data.mkdir(parents=True, exist_ok=True)
    parameters = out / "params.yaml"
    write_text(parameters, PARAMETERS.format(width=width, height=height, spp=spp, views=views))
    params = load_params(parameters)
    folder = folder.resolve()
    costs: dict[Path, Cost] = {}
    files = scene_files(folder)
    twice = [name for name, count in Counter(map(scene_name, files)).items() if count > 1]
    if twice:
        raise click.ClickException(
            f"several files would have the scene id {', '.join(twice)}; rename some"
        )
    for path in files:
        place = data / "scenes" / scene_name(path)
        # Keep imports and costs of an earlier run; the other stages resume as well.
        noted = out / f"cost-{place.name}.json"
        if noted.is_file() and (place / "scene.json").is_file():
            costs[path] = build(Cost, read_json(noted))
        else:
            costs[path] = bring(path, folder, place)
            write_json(noted, asdict(costs[path]))
        click.echo(f"{path.name}: {costs[path].seconds:.1f} s  {costs[path].error}")
    fine = all(
        not cost.error and cost.seconds <= most_seconds and cost.megabytes <= 1024 * most_gib
        for cost in costs.values()
    )
    for stage in (
        run_cameras,
        partial(run_frames, "inputs"),
        partial(run_frames, "illumination"),
        partial(run_frames, "groundtruth"),
    ):
        fine &= attempt(partial(stage, data, params))
    pack_dataset(data, params)
    with (data / "dataset" / "scenes.csv").open(newline="", encoding="utf-8") as stream:
        accepted = Counter({line["scene_id"]: int(line["rows"]) for line in csv.DictReader(stream)})
    set_variant("auto")
    lines = [
        "| scene | import s | MB | rooms | objects | lights | portals | triangles | views | rows "
        "| leak % | changes |",
        "|---|" + "---:|" * 11,
    ]
    found: dict[str, list[str]] = {}
    for path, cost in costs.items():
        scene_id, worst = scene_name(path), "-"
        if not cost.error:
            worst, leaks = leaks_of(load_scene(data / "scenes" / scene_id))
            found[scene_id] = [str(leak) for leak in leaks]
            sheet(data, scene_id, out / f"sheet-{scene_id}.png")
        lines.append(row(data, path, cost, accepted[scene_id], worst))
    write_text(out / "scenes.md", "\n".join(lines) + "\n")
    write_json(
        out / "scenes.json",
        {"costs": {path.name: asdict(cost) for path, cost in costs.items()}, "leaks": found},
    )
    click.echo("\n".join(lines))
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
