"""`pbrnet predict`: images from the trained networks, from light transport, or from few samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from pbrnet.model.evaluation import predict as prediction
from pbrnet.model.evaluation.budget import HYBRID, best_method, choose_for
from pbrnet.model.evaluation.predict import Renderers, ViewRenderer, ViewSource
from pbrnet.model.evaluation.previews import (
    MOST_DENOISED,
    PREVIEWS,
    Preview,
    write_rendering,
)
from pbrnet.model.evaluation.selection import FromFrames, FromScenes, Selected
from pbrnet.model.methods import MAX_SAMPLES, METHODS, MIN_TILE, PREDICTABLE
from pbrnet.model.options import found_models_option
from pbrnet.pipeline.commands.options import (
    FOLDER,
    PATH,
    NumberRange,
    Request,
    common_options,
    size_option,
)
from pbrnet.pipeline.images import Picture, png_bytes
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.progress import COMPILING, Progress
from pbrnet.pipeline.terminal import say
from pbrnet.pipeline.views import View
from pbrnet.scenes.contract import load_scene, scene_folders
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, exists

if TYPE_CHECKING:
    from pbrnet.model.evaluation.inference import Networks

T = TypeVar("T")


def _triple(ctx: Any, param: Any, value: str | None) -> tuple[float, ...] | None:
    """Three numbers like `1,2,1.6`; raises click's `BadParameter` for anything else."""
    with suppress(ValueError):
        numbers = tuple(float(part) for part in (value or "").split(","))
        if len(numbers) == 3 and all(map(math.isfinite, numbers)):
            return numbers
    if value is not None:
        raise click.BadParameter(f"{value!r}: write it like 1,2,1.6", ctx, param)
    return None


@dataclass(frozen=True)
class Way:
    """The method that makes pictures, or the seconds in which the best one does."""

    method: str | None
    spp: int | None
    quality: Quality | None
    seconds: float | None
    tile: int | None
    models: Path | None

    def networks_of(self, method: str, note: bool = False) -> Path | None:
        """Folder of a method's networks; None, with a `note` why, if there are none."""
        from pbrnet.model.release.pretrained import find_models

        try:
            return find_models(self.models, method).folder
        except InputError as error:
            if note:
                say(f"without {method}: {error}", err=True)
            return None


@dataclass(frozen=True)
class Drawn:
    """A picture of a view, and what is written about it.

    `write_exr` writes linear radiance with these facts to a file and returns what to say about it.
    """

    picture: Picture
    made_by: str
    metrics: str
    write_exr: Callable[[Path, dict[str, Any]], str]


Pictures = list[tuple[View, Callable[[], Drawn]]]


@dataclass(frozen=True)
class Output:
    """The place of the pictures, and what is written beside them."""

    out: Path | None
    exr: bool
    with_truth: bool

    def target(self, view: View, count: int) -> Path:
        """The file of one of so many pictures."""
        name = f"{view.scene_id}--{view.view_id}.png"
        if self.out is None:
            return Path("predictions") / name
        if count > 1 or self.out.is_dir() or not self.out.suffix:
            return self.out / name
        if self.out.suffix.lower() != ".png":
            message = f"{self.out}: the file name must end in .png"
            raise click.BadParameter(message, param_hint="--out")
        return self.out

    def write(self, view: View, drawn: Drawn, target: Path, credits: list[str]) -> list[str]:
        """Write the picture of a view, and its radiance with `--exr`; returns lines about them."""
        name = f"{view.scene_id}/{view.view_id}"
        facts = {
            "prediction": name,
            "models": drawn.made_by,
            "words": drawn.metrics,
            "credits": credits,
        }
        with atomic_file(target) as partial:
            partial.write_bytes(png_bytes(drawn.picture, facts))
        size = f"{view.width}x{view.height}"
        lines = [f"{target}: {name}, {size} {drawn.metrics}".rstrip()]
        if self.exr:
            exr = target.with_suffix(".exr")
            lines.append(f"{exr}: {drawn.write_exr(exr, facts)}")
        return lines


@click.command(
    epilog="""\b
Examples:
  pbrnet predict data/scenes/home-0000 --view VIEW
  pbrnet predict data/scenes/home-0000 --view VIEW --size 640x480 --compare
  pbrnet predict data/scenes/home-0000 --all-views --method plus
  pbrnet predict data/scenes/home-0000 --view VIEW --method hybrid --spp 2
  pbrnet predict data/scenes/home-0000 --all-views --method radiosity --size 480x360
  pbrnet predict data/scenes/home-0000 --all-views --seconds 2 --size 480x360
  pbrnet predict data/scenes/my-home --eye 1,2,1.6 --towards 1,0.3,-0.2 --size 800x600
  pbrnet predict data/scenes/my-home --view VIEW --size 3840x2880 --tile 512 --exr
  pbrnet predict data/scenes --all-views --method radiosity --out pictures
  pbrnet predict home-1 home-2 --view home-1/A --view home-2/B --cameras FOLDER --out pictures
  pbrnet predict --inputs in.exr --illumination panorama.exr --out picture.png
  pbrnet predict --inputs data/inputs/home-0000 --illumination data/illumination/home-0000

VIEW is a view_id in the camera file, by default data/cameras/SCENE.json. With several scenes, or a
folder of scenes, --view VIEW selects it in each of them, --view SCENE/VIEW in one. The scenes are
rendered one after another in this process, each opened once; failures are listed at the end, with
exit code 1, and the images of the others are kept.
Networks are read from models/, or the pretrained networks are used if it has none. Without --method
the available method with the lowest error is used, and its name is printed.
--method radiosity needs no network: a preview by light transport, for any scene and size. Nor does
--method denoised: samples of our path tracer and Open Image Denoise, for comparison.
--seconds uses times measured on this machine for similar scenes at this size; without any, it
benchmarks the first view, then reuses the chosen settings.
--compare reads the ground truth from the data folder, or renders it.
docs/use.md describes the values of --exr. `pbrnet report` shows all images in predictions/."""
)
@click.argument("scenes", type=FOLDER, nargs=-1, metavar="[SCENE]...")
@click.option(
    "--view",
    "views",
    multiple=True,
    metavar="[SCENE/]VIEW",
    help="View in the camera file (repeatable).",
)
@click.option("--all-views", is_flag=True, help="All views of the camera files.")
@click.option(
    "--camera",
    "--cameras",
    "cameras",
    type=PATH,
    help="Camera file of the scene, or a folder of files SCENE.json.",
)
@click.option(
    "--eye", callback=_triple, metavar="X,Y,Z", help="Position of a new camera, in metres, Z up."
)
@click.option(
    "--towards", callback=_triple, metavar="X,Y,Z", help="Viewing direction of the new camera."
)
@click.option("--inputs", type=PATH, help="Frame of depth, normal, reflectance, or a folder.")
@click.option("--illumination", type=PATH, help="Frame of the panorama, or a folder.")
@click.option("--transport", type=PATH, help="Frame of light transport, or a folder.")
@click.option("--materials", type=PATH, help="Frame of materials, or a folder.")
@click.option("--noisy", type=PATH, help="Frame of noisy samples, or a folder (for hybrid).")
@click.option(
    "--spp",
    type=click.IntRange(1, MOST_DENOISED),
    help="Samples per pixel of hybrid (1 to 8), radiosity (1, 2, 4, 8, 16, 64) or denoised.  "
    "[default: as trained, by image size, 16]",
)
@click.option(
    "--denoiser",
    "quality",
    type=click.Choice(["high", "balanced", "fast"]),
    help="Quality of Open Image Denoise, for radiosity and denoised; fast takes a quarter of the "
    "time.  [default: high]",
)
@click.option(
    "--seconds",
    type=NumberRange(0, min_open=True),
    help="Time budget per view: choose --method, --spp and --denoiser with the lowest error.",
)
@size_option("Render the inputs at this size.")
@click.option(
    "--method",
    type=click.Choice((*PREDICTABLE, *PREVIEWS)),
    help="Method that computes colour; pbrnet is the paper's.  [default: the available one with "
    "the lowest error, hybrid, plus or radiosity; for frames a trained one]",
)
@click.option(
    "--tile",
    type=click.IntRange(MIN_TILE),
    metavar="N",
    help="Run the network in tiles of N x N pixels to save memory (not for transport).",
)
@click.option("--exr", is_flag=True, help="Also write linear radiance as OpenEXR.")
@click.option(
    "--compare", "with_truth", is_flag=True, help="Show the ground truth and the error as well."
)
@click.option(
    "--out",
    type=PATH,
    help="PNG to write, or a folder for several views.  [default: predictions/SCENE--VIEW.png]",
)
@found_models_option()
@common_options
def predict(request: Request, **options: Any) -> int:
    """Predict images with the trained networks, from scenes or from frames."""
    way, output = _taken(Way, options), _taken(Output, options)
    selected, data = Selected(), request.data
    if any(options[field.name] for field in fields(FromFrames)):
        sources = _given_frames(way, options).select(data if output.with_truth else None)
        pictures = _predictions(sources, way, output)
    else:
        selected = _given_scenes(options).select(data, request.params.image)
        renderer_of = partial(ViewRenderer, params=request.params, data=data)
        renderers = Renderers(renderer_of, selected.folders)
        if way.seconds is not None:
            way = _within_seconds(way, renderers, selected.views[0])
        elif way.method is None:
            way = _with_best_method(way)
        if way.method in PREVIEWS:
            pictures = _previews(selected.views, renderers, way, output)
        else:
            sources = prediction.from_scenes(
                renderers, selected.views, output.with_truth, way.spp or 0
            )
            pictures = _predictions(sources, way, output)
    return _write(pictures, output, selected, data / "scenes")


def _write(pictures: Pictures, output: Output, selected: Selected, scenes: Path) -> int:
    """Draw and write the pictures; returns the exit code."""
    total = len(pictures) + len(selected.failed)
    out = output.out
    if total > 1 and out is not None and out.suffix.lower() in (".png", ".exr"):
        raise click.BadParameter(f"{out}: {total} views need a folder", param_hint="--out")
    failed = list(selected.failed)
    for name, message in selected.failed.items():
        say(f"Error: {name}: {message}", err=True)
    note = COMPILING if selected.views else ""
    with Progress(len(pictures), "predict", note=note) as progress:
        for view, draw in pictures:
            scene = selected.folders.get(view.scene_id, scenes / view.scene_id)
            try:
                drawn, target = draw(), output.target(view, total)
                say(*output.write(view, drawn, target, _credits(scene)))
            except InputError as error:
                if total == 1:
                    raise
                failed.append(f"{view.scene_id}/{view.view_id}")
                say(f"Error: {failed[-1]}: {error}", err=True)
            progress.advance()
    if failed:
        more = f" and {len(failed) - 8} more" if len(failed) > 8 else ""
        named = ", ".join(failed[:8]) + more
        say(f"Error: {len(failed)} of {total} failed: {named}", err=True)
    return 1 if failed else 0


def _taken(kind: type[T], options: Mapping[str, Any]) -> T:
    """The request object of this class, of the options that are its fields."""
    return kind(**{field.name: options[field.name] for field in fields(kind)})  # type: ignore[arg-type]


def _given_frames(way: Way, options: Mapping[str, Any]) -> FromFrames:
    """The frames that are given; raises `UsageError` for what does not go with them."""
    if options["scenes"]:
        raise click.UsageError("give a SCENE, or --inputs and --illumination, not both")
    if way.seconds is not None or way.method in PREVIEWS:
        what = f"--method {way.method}" if way.seconds is None else "--seconds"
        raise click.UsageError(f"{what} requires a SCENE, not frames")
    if not options["inputs"] or not options["illumination"]:
        raise click.UsageError("give a SCENE and a --view, or --inputs and --illumination")
    of_scene = ("size", "views", "all_views", "cameras", "eye", "towards", "spp")
    if any(options[name] for name in of_scene):
        raise click.UsageError(
            "--size, --view, --all-views, --camera, --eye, --towards and --spp require a SCENE"
        )
    return _taken(FromFrames, options)


def _given_scenes(options: Mapping[str, Any]) -> FromScenes:
    """The scenes and views that are given; raises `UsageError` for what does not fit together."""
    if not options["scenes"]:
        raise click.UsageError("give a SCENE and a --view, or --inputs and --illumination")
    views, cameras = options["views"], options["cameras"]
    eye, towards = options["eye"], options["towards"]
    ways = (bool(views), options["all_views"], eye is not None)
    if sum(ways) != 1 or (eye is None) != (towards is None):
        raise click.UsageError(
            "with SCENE, give --view (repeatable), or --all-views, or --eye and --towards"
        )
    folders = [folder for path in options["scenes"] for folder in _scenes_at(path)]
    scenes = list(dict.fromkeys(folders))
    if len(scenes) > 1 and eye is not None:
        raise click.UsageError("--eye and --towards require a single SCENE")
    if len(scenes) > 1 and cameras is not None and not cameras.is_dir():
        raise click.UsageError("--cameras: several scenes require a folder of files SCENE.json")
    names = {scene.name for scene in scenes}
    for view in views:
        scene, slash, _ = view.rpartition("/")
        if slash and scene not in names:
            raise click.UsageError(f"--view {view}: no SCENE of this name is given")
    placed = None if eye is None else (eye, towards)
    return FromScenes(scenes, views, cameras, options["size"], placed)


def _scenes_at(path: Path) -> list[Path]:
    """Scene folders at a path: the folder itself, or those in it."""
    return [path] if exists(path / "scene.json") else scene_folders(path) or [path]


def _within_seconds(way: Way, renderers: Renderers, first: View) -> Way:
    """The way of the best picture in so many seconds, as measured on the first view."""
    if way.method or way.spp or way.quality or way.tile:
        raise click.UsageError(
            "--seconds chooses --method and --spp; do not combine them or --tile"
        )
    assert way.seconds is not None
    networks: Networks | None = None
    if integrator.available() and (folder := way.networks_of(HYBRID, note=True)):
        from pbrnet.model.evaluation.inference import load_networks

        networks = load_networks(folder, [HYBRID])
    choice = choose_for(way.seconds, renderers.of(first), first, networks)
    how = "measured" if choice.is_measured else "expected"
    say(f"{choice.effort}: {choice.seconds:.2f} s per view, {how}")
    if choice.seconds > way.seconds:
        say(f"no setting takes {way.seconds:g} s or less; this is the fastest", err=True)
    effort = choice.effort
    quality = effort.quality if effort.method in PREVIEWS else None
    return replace(way, method=effort.method, spp=effort.spp, quality=quality)


def _with_best_method(way: Way) -> Way:
    """The way with the available method that has the lowest error, unless `--models` has others."""
    fits = way.spp or 0, bool(way.tile), bool(way.quality), way.models is not None
    method = best_method(lambda name: bool(way.networks_of(name)), *fits)
    if method is None:
        return way
    say(f"method: {method}, the available one with the lowest error; the paper's: --method pbrnet")
    return replace(way, method=method)


def _previews(views: Sequence[View], renderers: Renderers, way: Way, output: Output) -> Pictures:
    """Pictures of scenes' views without a network."""
    method, spp, quality = way.method or "", way.spp or 0, way.quality or "high"
    if way.tile:
        raise click.UsageError(f"--tile applies to networks, not to --method {method}")

    def draw(view: View) -> Drawn:
        preview = Preview(renderers.of(view), method, spp, quality)
        found = preview.render(view)
        picture, metrics = photograph(found.color), ""
        if output.with_truth:
            picture, metrics = preview.compare(view, found)
        write_exr = partial(write_rendering, view=view, found=found, method=method)
        return Drawn(picture, method, metrics, write_exr)

    return [(view, partial(draw, view)) for view in views]


def _predictions(sources: Sequence[ViewSource], way: Way, output: Output) -> Pictures:
    """Pictures by networks."""
    # Imported here: torch takes longer than a picture without a network.
    from pbrnet.model.evaluation.inference import load_networks
    from pbrnet.model.release.pretrained import find_models

    if way.quality:
        raise click.UsageError(f"--denoiser applies only to --method {' and '.join(PREVIEWS)}")
    if (way.spp or 0) > MAX_SAMPLES:
        raise click.UsageError(f"--spp: networks take at most {MAX_SAMPLES} samples per pixel")
    found = find_models(way.models, way.method)
    if way.spp and not (found.method in METHODS and METHODS[found.method].takes_samples):
        raise click.UsageError(f"--spp: {found.method} takes no samples")
    networks = load_networks(found.folder, [found.method], way.tile or 0)
    say(f"{found.method}, networks from {found.description}")

    def draw(source: ViewSource) -> Drawn:
        example = source.load(networks.card)
        predicted = networks.predict(networks.methods[0], example)
        picture, metrics = photograph(networks.radiance(example, predicted).color), ""
        if output.with_truth:
            picture, metrics = prediction.compare(networks, example, predicted)
        write_exr = partial(
            prediction.write_radiance,
            networks=networks,
            view=source.view,
            example=example,
            predicted=predicted,
        )
        return Drawn(picture, f"{predicted.method} of {found.folder}", metrics, write_exr)

    return [(source.view, partial(draw, source)) for source in sources]


def _credits(scene: Path) -> list[str]:
    """Title, author and licence of each part of a scene; empty without its folder."""
    if not (scene / "scene.json").is_file():
        return []
    credits = load_scene(scene).credits
    return list(dict.fromkeys(f"{c.title} by {c.author}, {c.licence}" for c in credits))
