"""`pbrnet predict`: images from the trained networks, from light transport, or from few samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from pbrnet.model.evaluation import predict as prediction
from pbrnet.model.evaluation.budget import choose, efforts_for, stopwatch
from pbrnet.model.evaluation.predict import Renderers, ViewRenderer, ViewSource
from pbrnet.model.evaluation.previews import (
    DENOISED,
    MOST_DENOISED,
    PREVIEWS,
    RADIOSITY,
    Preview,
    check_samples,
    write_rendering,
)
from pbrnet.model.evaluation.speeds import keep_seconds, known_seconds, place_of, speeds_file
from pbrnet.model.methods import MAX_SAMPLES, MIN_TILE, PREDICTABLE
from pbrnet.model.options import found_models_option
from pbrnet.pipeline.channels import Kind
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
from pbrnet.pipeline.views import View, intrinsics_of
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import load_scene, scene_folders
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, exists

if TYPE_CHECKING:
    from pbrnet.model.evaluation.inference import Networks

HYBRID, PLUS = "hybrid", "plus"


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
@click.option("--eye", metavar="X,Y,Z", help="Position of a new camera, in metres, Z up.")
@click.option("--towards", metavar="X,Y,Z", help="Viewing direction of the new camera.")
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
    wanted = PictureRequest(Renderers(request.params, request.data), **options)
    if wanted.seconds is not None:
        wanted = _within_seconds(wanted)
    elif wanted.method is None and wanted.scenes and not wanted.gives_frames:
        wanted = _with_best_method(wanted)
    pictures = _previews(wanted) if wanted.method in PREVIEWS else _predictions(wanted)
    total = len(pictures) + len(wanted.selected.failed)
    _check_out(wanted.out, total)
    failed = list(wanted.selected.failed)
    for name, message in wanted.selected.failed.items():
        say(f"Error: {name}: {message}", err=True)
    note = COMPILING if wanted.scenes else ""
    with Progress(len(pictures), "predict", note=note) as progress:
        for view, draw in pictures:
            try:
                say(*_write(wanted, view, draw(), total))
            except InputError as error:
                if total == 1:
                    raise
                failed.append(f"{view.scene_id}/{view.view_id}")
                say(f"Error: {failed[-1]}: {error}", err=True)
            progress.advance()
    if failed:
        say(f"Error: {len(failed)} of {total} failed: {_listed(failed)}", err=True)
    return 1 if failed else 0


@dataclass(frozen=True)
class PictureRequest:
    """The options of `pbrnet predict`; None or empty: not given."""

    renderers: Renderers
    models: Path | None
    scenes: tuple[Path, ...]
    views: tuple[str, ...]
    all_views: bool
    cameras: Path | None
    eye: str | None
    towards: str | None
    size: tuple[int, int] | None
    inputs: Path | None
    illumination: Path | None
    transport: Path | None
    materials: Path | None
    noisy: Path | None
    method: str | None
    spp: int | None
    quality: Quality | None
    seconds: float | None
    tile: int | None
    exr: bool
    with_truth: bool
    out: Path | None

    @property
    def gives_frames(self) -> bool:
        """True if frames are given, which replace a scene."""
        return any((self.inputs, self.illumination, self.transport, self.materials, self.noisy))

    @cached_property
    def selected(self) -> Selected:
        """The views of scenes that the options select; raises `UsageError` or `InputError`."""
        return _select(self) if self.scenes else Selected((), {}, {})

    def renderer(self, view: View) -> ViewRenderer:
        """Renderer of a view's scene."""
        return self.renderers.of(self.selected.folders[view.scene_id])

    def scene_of(self, view: View) -> Path:
        """Folder of a view's scene, which may be absent."""
        usual = self.renderers.data / "scenes" / view.scene_id
        return self.selected.folders.get(view.scene_id, usual)


@dataclass(frozen=True)
class Selected:
    """Views of scenes, and the scenes' folders by id."""

    views: tuple[View, ...]
    folders: Mapping[str, Path]
    failed: Mapping[str, str]  # messages by view or scene that cannot be used


@dataclass(frozen=True)
class Drawn:
    """A picture of a view, and what is written about it.

    `write_exr` writes linear radiance with these facts to a file and returns what to say about it.
    """

    picture: Picture
    size: tuple[int, int]
    made_by: str
    metrics: str
    write_exr: Callable[[Path, dict[str, Any]], str]


Pictures = list[tuple[View, Callable[[], Drawn]]]


def _write(request: PictureRequest, view: View, drawn: Drawn, count: int) -> list[str]:
    """Write the picture of a view, and its radiance with `--exr`; returns lines about them."""
    name, target = f"{view.scene_id}/{view.view_id}", _target(request.out, view, count)
    facts = {
        "prediction": name,
        "models": drawn.made_by,
        "words": drawn.metrics,
        "credits": _credits(request.scene_of(view)),
    }
    with atomic_file(target) as partial:
        partial.write_bytes(png_bytes(drawn.picture, facts))
    width, height = drawn.size
    lines = [f"{target}: {name}, {width}x{height} {drawn.metrics}".rstrip()]
    if request.exr:
        exr = target.with_suffix(".exr")
        lines.append(f"{exr}: {drawn.write_exr(exr, facts)}")
    return lines


def _within_seconds(request: PictureRequest) -> PictureRequest:
    """Return the request with the effort of the best picture in so many seconds, as measured."""
    seconds = request.seconds
    assert seconds is not None
    if request.method or request.spp or request.quality:
        raise click.UsageError("--seconds chooses --method and --spp; do not combine them")
    first = _preview_views(request, "--seconds")[0]
    networks: Networks | None = None
    methods = PREVIEWS if integrator.available() else (DENOISED,)
    if integrator.available():
        from pbrnet.model.evaluation.inference import load_networks
        from pbrnet.model.release.pretrained import find_models

        try:
            found = find_models(request.models, HYBRID)
        except InputError as error:
            say(f"without {HYBRID}: {error}", err=True)
        else:
            networks, methods = load_networks(found.folder, [HYBRID]), (*methods, HYBRID)
    pixels = first.width * first.height
    renderer = request.renderer(first)
    file, place = speeds_file(), place_of(renderer.scene, first)
    known = known_seconds(file, place)
    measure = stopwatch(renderer, first, networks)
    choice = choose(seconds, efforts_for(pixels, methods), measure, pixels, known)
    if choice.measured:
        keep_seconds(file, place, {**known, **choice.measured})
    how = "measured" if choice.is_measured else "expected"
    say(f"{choice.effort}: {choice.seconds:.2f} s per view, {how}")
    if choice.seconds > seconds:
        say(f"no setting takes {seconds:g} s or less; this is the fastest", err=True)
    effort = choice.effort
    quality = effort.quality if effort.method in PREVIEWS else None
    return replace(request, method=effort.method, spp=effort.spp, quality=quality)


def _with_best_method(request: PictureRequest) -> PictureRequest:
    """The request with the available method that has the lowest error in docs/results.md.

    Left out are methods that the other options do not fit; with --models, also `radiosity`, so that
    the networks of that folder draw.
    """
    networks = not request.quality and integrator.available()
    fits = {
        HYBRID: networks and not request.tile and (request.spp or 0) <= MAX_SAMPLES,
        PLUS: networks and not request.spp,
        RADIOSITY: integrator.available() and not request.tile and request.models is None,
    }
    method = next((name for name in fits if fits[name] and _is_there(request, name)), None)
    if method is None:
        return request
    say(f"method: {method}, the available one with the lowest error; the paper's: --method pbrnet")
    return replace(request, method=method)


def _is_there(request: PictureRequest, method: str) -> bool:
    if method in PREVIEWS:
        return True
    from pbrnet.model.release.pretrained import find_models

    try:
        find_models(request.models, method)
    except InputError:
        return False
    return True


def _previews(request: PictureRequest) -> Pictures:
    """Pictures of scenes' views without a network."""
    method, spp, quality = request.method, request.spp or 0, request.quality or "high"
    assert method is not None
    views = _preview_views(request, f"--method {method}")
    check_samples(method, spp)

    def draw(view: View) -> Drawn:
        preview = Preview(request.renderer(view), method, spp, quality)
        found = preview.render(view)
        picture, metrics = photograph(found.color), ""
        if request.with_truth:
            picture, metrics = preview.compare(view, found)
        write_exr = partial(write_rendering, view=view, found=found, method=method)
        return Drawn(picture, (view.width, view.height), method, metrics, write_exr)

    return [(view, partial(draw, view)) for view in views]


def _preview_views(request: PictureRequest, what: str) -> tuple[View, ...]:
    """Views of the request's scenes; raises `UsageError` for frames."""
    if not request.scenes or request.gives_frames:
        raise click.UsageError(f"{what} requires a SCENE, not frames")
    return request.selected.views


def _predictions(request: PictureRequest) -> Pictures:
    """Pictures by networks."""
    # Imported here: torch takes longer than a picture without a network.
    from pbrnet.model.evaluation.inference import load_networks
    from pbrnet.model.release.pretrained import find_models

    if request.quality:
        raise click.UsageError(f"--denoiser applies only to --method {' and '.join(PREVIEWS)}")
    if (request.spp or 0) > MAX_SAMPLES:
        raise click.UsageError(f"--spp: networks take at most {MAX_SAMPLES} samples per pixel")
    sources = _view_sources(request)
    found = find_models(request.models, request.method)
    networks = load_networks(found.folder, [found.method], request.tile or 0)
    say(f"{found.method}, networks from {found.description}")

    def draw(source: ViewSource) -> Drawn:
        example = source.load(networks.card)
        predicted = networks.predict(networks.methods[0], example)
        picture, metrics = photograph(networks.radiance(example, predicted).color), ""
        if request.with_truth:
            picture, metrics = prediction.compare(networks, example, predicted)
        height, width = predicted.color.shape[:2]
        write_exr = partial(
            prediction.write_radiance,
            networks=networks,
            view=source.view,
            example=example,
            predicted=predicted,
        )
        made_by = f"{predicted.method} of {found.folder}"
        return Drawn(picture, (width, height), made_by, metrics, write_exr)

    return [(source.view, partial(draw, source)) for source in sources]


def _view_sources(request: PictureRequest) -> list[ViewSource]:
    """The views that the options select, for networks."""
    if request.scenes:
        if request.gives_frames:
            raise click.UsageError("give a SCENE, or --inputs and --illumination, not both")
        views, spp = request.selected.views, request.spp or 0
        return prediction.from_scenes(request.renderer, views, request.with_truth, spp)
    inputs, illumination = request.inputs, request.illumination
    if inputs is None or illumination is None:
        raise click.UsageError("give a SCENE and a --view, or --inputs and --illumination")
    of_scene = (request.size, request.views, request.all_views, request.cameras, request.eye)
    if any(of_scene) or request.towards or request.spp:
        raise click.UsageError(
            "--size, --view, --all-views, --camera, --eye, --towards and --spp require a SCENE"
        )
    given: dict[Kind, Path | None] = {
        "inputs": inputs,
        "illumination": illumination,
        "transport": request.transport or _beside(illumination, "transport"),
        "materials": request.materials or _beside(illumination, "materials"),
        "visibility": _beside(illumination, "visibility"),
        "noisy": request.noisy,
    }
    paths = {kind: path for kind, path in given.items() if path}
    truth = request.renderers.data if request.with_truth else None
    return [
        prediction.from_frames(dict(zip(paths, files, strict=True)), truth)
        for files in prediction.frame_sets(*paths.values())
    ]


def _select(request: PictureRequest) -> Selected:
    """Views that the options select; of several scenes, those without are named and left out."""
    ways = (bool(request.views), request.all_views, request.eye is not None)
    if sum(ways) != 1 or (request.eye is None) != (request.towards is None):
        raise click.UsageError(
            "with SCENE, give --view (repeatable), or --all-views, or --eye and --towards"
        )
    scenes = list(dict.fromkeys(folder for path in request.scenes for folder in _scenes_at(path)))
    _check_scenes(request, scenes)
    wanted: list[tuple[Path, str | None]]
    wanted = [(scene, name) for scene in scenes for name in _names_in(scene, request.views)]
    views: list[View] = []
    folders: dict[str, Path] = {}
    failed: dict[str, str] = {}
    for scene, name in wanted or [(scene, None) for scene in scenes]:
        try:
            found = _scene_views(request, scene, name)
        except InputError as error:
            if len(scenes) == 1:
                raise
            failed[f"{scene.name}/{name}" if name else scene.name] = str(error)
            continue
        if folders.setdefault(found[0].scene_id, scene) != scene:
            raise InputError(f"{folders[found[0].scene_id]} and {scene} have the same scene id")
        views += found
    if not views:
        raise InputError(*(f"{what}: {message}" for what, message in failed.items()))
    return Selected(tuple(views), folders, failed)


def _scenes_at(path: Path) -> list[Path]:
    """Scene folders at a path: the folder itself, or those in it."""
    return [path] if exists(path / "scene.json") else scene_folders(path) or [path]


def _check_scenes(request: PictureRequest, scenes: Sequence[Path]) -> None:
    """Raise `UsageError` for options that apply to one scene only, or name one not given."""
    several = len(scenes) > 1
    if several and request.eye is not None:
        raise click.UsageError("--eye and --towards require a single SCENE")
    if several and request.cameras is not None and not request.cameras.is_dir():
        raise click.UsageError("--cameras: several scenes require a folder of files SCENE.json")
    names = {scene.name for scene in scenes}
    for view in request.views:
        scene, slash, _ = view.rpartition("/")
        if slash and scene not in names:
            raise click.UsageError(f"--view {view}: no SCENE of this name is given")


def _names_in(scene: Path, views: Sequence[str]) -> list[str]:
    """Those of `views`, VIEW or SCENE/VIEW, that select a view of this scene."""
    pairs = [view.rpartition("/") for view in views]
    return list(dict.fromkeys(view for of, _, view in pairs if of in ("", scene.name)))


def _scene_views(request: PictureRequest, scene: Path, name: str | None) -> list[View]:
    """The view of this name, all views, or the new camera of a scene."""
    eye, towards, size = request.eye, request.towards, request.size
    if eye is not None and towards is not None:
        image = request.renderers.params.image
        if size:
            image = replace(image, width=size[0], height=size[1])
        if not image.is_pinhole:
            raise InputError(
                f"--eye: image.projection is {image.projection}; pictures by networks need "
                "perspective without distortion"
            )
        place = _triple(eye, "--eye"), _triple(towards, "--towards")
        scene_id = load_scene(scene).scene_id
        return [prediction.placed_view(scene_id, *place, intrinsics_of(image))]
    cameras = request.cameras or request.renderers.data / "cameras"
    if request.cameras is None or cameras.is_dir():
        cameras /= f"{scene.name}.json"
    return prediction.find_views(scene, cameras, [name] if name else [], size)


def _listed(names: Sequence[str], most: int = 8) -> str:
    """Names for a message, at most so many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _beside(illumination: Path, kind: str) -> Path | None:
    """Frames of the same views and another kind: `kind` instead of `illumination` in the path.

    None if there are none.
    """
    parts = illumination.parts
    if "illumination" not in parts:
        return None
    place = len(parts) - 1 - parts[::-1].index("illumination")
    found = Path(*parts[:place], kind, *parts[place + 1 :])
    exists = any(found.rglob("*.exr")) if found.is_dir() else found.is_file()
    return found if exists else None


def _check_out(out: Path | None, count: int) -> None:
    if count > 1 and out is not None and out.suffix.lower() in (".png", ".exr"):
        raise click.BadParameter(f"{out}: {count} views need a folder", param_hint="--out")


def _target(out: Path | None, view: View, count: int) -> Path:
    name = f"{view.scene_id}--{view.view_id}.png"
    if out is None:
        return Path("predictions") / name
    if count > 1 or out.is_dir() or not out.suffix:
        return out / name
    if out.suffix.lower() != ".png":
        raise click.BadParameter(f"{out}: the file name must end in .png", param_hint="--out")
    return out


def _credits(scene: Path) -> list[str]:
    """Title, author and licence of each part of a scene; empty without its folder."""
    if not (scene / "scene.json").is_file():
        return []
    credits = load_scene(scene).credits
    return list(dict.fromkeys(f"{c.title} by {c.author}, {c.licence}" for c in credits))


def _triple(text: str, option: str) -> Float64Array:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise click.BadParameter(f"{text!r}: write it like 1,2,1.6", param_hint=option)
    return numbers
