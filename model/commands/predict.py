"""`pbrnet predict`: images from the trained networks, from light transport, or from few samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from pbrnet.model.data.encoding import MAX_SAMPLES
from pbrnet.model.evaluation import predict as prediction
from pbrnet.model.evaluation.budget import Effort, choose, efforts_for, stopwatch
from pbrnet.model.evaluation.inference import PREDICTABLE, Networks, load_networks
from pbrnet.model.evaluation.predict import ViewSource
from pbrnet.model.evaluation.previews import (
    DENOISED,
    MOST_DENOISED,
    PREVIEWS,
    Preview,
    write_rendering,
)
from pbrnet.model.networks.tiles import MIN_TILE
from pbrnet.model.options import FILE, FOLDER, found_models_option, size_option
from pbrnet.model.release.pretrained import find_models
from pbrnet.pipeline.commands.options import common_options
from pbrnet.pipeline.images import png_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.views import View, intrinsics_of
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file

HYBRID = "hybrid"
_EITHER = click.Path(path_type=Path)


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
  pbrnet predict --inputs in.exr --illumination panorama.exr --out picture.png
  pbrnet predict --inputs data/inputs/home-0000 --illumination data/illumination/home-0000

VIEW is a view_id in the camera file, by default data/cameras/SCENE.json.
The networks are those in models/, or the pretrained networks of pbrnet if that has none.
--method radiosity takes none: a preview by light transport, of any scene and size. Nor does
--method denoised: samples of our path tracer and Open Image Denoise, for comparison.
--seconds measures on the first view what fits, which takes longer than the pictures, and keeps
to it for all.
--compare reads the true images from the data folder, or renders them.
docs/use.md describes the values of --exr. `pbrnet report` shows all images in predictions/."""
)
@click.argument("scene", type=FOLDER, required=False)
@click.option("--view", "views", multiple=True, help="View of the camera file (repeatable).")
@click.option("--all-views", is_flag=True, help="All views of the camera file.")
@click.option("--camera", type=FILE, default=None, help="Camera file of the scene.")
@click.option("--eye", metavar="X,Y,Z", help="Position of a new camera, in metres, Z up.")
@click.option("--towards", metavar="X,Y,Z", help="Viewing direction of the new camera.")
@click.option("--inputs", type=_EITHER, help="Frame of depth, normal, reflectance, or a folder.")
@click.option("--illumination", type=_EITHER, help="Frame of the panorama, or a folder.")
@click.option("--transport", type=_EITHER, help="Frame of light transport, or a folder.")
@click.option("--materials", type=_EITHER, help="Frame of materials, or a folder.")
@click.option("--noisy", type=_EITHER, help="Frame of noisy samples, or a folder (for hybrid).")
@click.option(
    "--spp",
    type=click.IntRange(1, MOST_DENOISED),
    default=None,
    help="Samples per pixel of hybrid (1 to 8), radiosity (1, 2, 4, 8, 16, 64) or denoised.  "
    "[default: as it was trained, by the image's size, 16]",
)
@click.option(
    "--denoiser",
    "quality",
    type=click.Choice(["high", "balanced", "fast"]),
    default=None,
    help="Quality of Open Image Denoise, for radiosity and denoised; fast takes a quarter of the "
    "time.  [default: high]",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0, min_open=True),
    default=None,
    help="The best picture in so many seconds a view: choose --method, --spp and --denoiser.",
)
@size_option("Render the inputs at this size.")
@click.option(
    "--method",
    type=click.Choice((*PREDICTABLE, *PREVIEWS)),
    default=None,
    help="Method that predicts colour.  [default: pbrnet, else a trained method]",
)
@click.option(
    "--tile",
    type=click.IntRange(MIN_TILE),
    default=None,
    metavar="N",
    help="Predict large images in tiles of N pixels a side, with less memory.",
)
@click.option("--exr", is_flag=True, help="Also write linear radiance as OpenEXR.")
@click.option(
    "--compare", "with_truth", is_flag=True, help="Show the truth and the error next to it."
)
@click.option(
    "--out",
    type=_EITHER,
    default=None,
    help="PNG to write, or a folder for several views.  [default: predictions/SCENE--VIEW.png]",
)
@found_models_option()
@common_options
def predict(
    params: Params,
    data: Path,
    models: Path | None,
    method: str | None,
    quality: Quality | None,
    tile: int | None,
    exr: bool,
    with_truth: bool,
    out: Path | None,
    seconds: float | None,
    **source: Any,
) -> int:
    """Predict images with the trained networks, from SCENE or from frames."""
    if seconds is not None:
        if method or source["spp"] or quality:
            raise click.UsageError("--seconds chooses --method and --spp; give one or the other")
        effort = _within(seconds, params, data, models, **source)
        method, source["spp"], quality = effort.method, effort.spp, effort.quality
    if method in PREVIEWS:
        how = quality or "high"
        return _predict_preview(params, data, method, how, exr, with_truth, out, **source)
    if quality and seconds is None:
        raise click.UsageError(f"--denoiser is for --method {' and '.join(PREVIEWS)}")
    if (source["spp"] or 0) > MAX_SAMPLES:
        raise click.UsageError(f"--spp: networks take at most {MAX_SAMPLES} samples per pixel")
    views = _view_sources(params, data, with_truth, **source)
    _check_out(out, len(views))
    found = find_models(models, method)
    networks = load_networks(found.folder, [found.method], tile or 0)
    click.echo(f"{found.method}, networks from {found.description}")
    scene = source["scene"]
    failed = 0
    with Progress(len(views), "predict") as progress:
        for each in views:
            folder = scene or data / "scenes" / each.view.scene_id
            target = _target(out, each.view, len(views))
            try:
                message = _predict_view(
                    networks, each, target, folder, exr, with_truth, str(found.folder)
                )
            except InputError as error:
                if len(views) == 1:
                    raise
                failed += 1
                click.echo(f"Error: {each.name}: {error}", err=True)
            else:
                click.echo(message)
            progress.advance()
    return 1 if failed else 0


def _within(
    seconds: float,
    params: Params,
    data: Path,
    models: Path | None,
    scene: Path | None,
    spp: int | None,
    **chosen: Any,
) -> Effort:
    """Return the effort of the best picture in so many seconds, measured on a view."""
    scene, views = _preview_views(params, data, scene, "--seconds", **chosen)
    opened = Preview(scene, params, data).scene
    networks: Networks | None = None
    methods = PREVIEWS if integrator.available() else (DENOISED,)
    if integrator.available():
        try:
            found = find_models(models, HYBRID)
        except InputError as error:
            click.echo(f"without {HYBRID}: {error}", err=True)
        else:
            networks, methods = load_networks(found.folder, [HYBRID]), (*methods, HYBRID)
    efforts = efforts_for(views[0].width * views[0].height, methods)
    choice = choose(seconds, efforts, stopwatch(opened, views[0], params, networks))
    click.echo(f"{choice.effort}: {choice.seconds:.2f} s a view here, of {choice.tried} measured")
    if choice.seconds > seconds:
        click.echo(f"nothing takes {seconds:g} s or less; this is the fastest", err=True)
    return choice.effort


def _predict_preview(
    params: Params,
    data: Path,
    method: str,
    quality: Quality,
    exr: bool,
    with_truth: bool,
    out: Path | None,
    scene: Path | None,
    spp: int | None,
    **chosen: Any,
) -> int:
    """Write pictures of a scene's views without a network; return the exit code."""
    scene, views = _preview_views(params, data, scene, f"--method {method}", **chosen)
    _check_out(out, len(views))
    preview = Preview(scene, params, data, method, spp or 0, quality)
    with Progress(len(views), "predict") as progress:
        for view in views:
            target = _target(out, view, len(views))
            found = preview.render(view)
            picture, metrics = photograph(found.color), ""
            if with_truth:
                picture, metrics = preview.compare(view, found)
            name = f"{view.scene_id}/{view.view_id}"
            facts = {
                "prediction": name,
                "models": method,
                "words": metrics,
                "credits": _credits(scene),
            }
            with atomic_file(target) as partial:
                partial.write_bytes(png_bytes(picture, facts))
            click.echo(f"{target}: {name}, {view.width}x{view.height} {metrics}".rstrip())
            if exr:
                write_rendering(target.with_suffix(".exr"), view, found, method, facts)
            progress.advance()
    return 0


def _preview_views(
    params: Params,
    data: Path,
    scene: Path | None,
    what: str,
    inputs: Path | None,
    illumination: Path | None,
    transport: Path | None,
    materials: Path | None,
    noisy: Path | None,
    **chosen: Any,
) -> tuple[Path, list[View]]:
    """Scene and views that the options select; raises `UsageError` for frames."""
    if scene is None or any((inputs, illumination, transport, materials, noisy)):
        raise click.UsageError(f"{what} computes from a SCENE, not from frames")
    return scene, _scene_views(params, data, scene, **chosen)


def _predict_view(
    networks: Networks,
    source: ViewSource,
    out: Path,
    scene: Path,
    exr: bool,
    with_truth: bool,
    models: str,
) -> str:
    """Write the image of a view, and its radiance with `exr`; returns a message."""
    example = source.load(networks.card)
    predicted = networks.predict(networks.methods[0], example)
    picture, metrics = photograph(networks.radiance(example, predicted).color), ""
    if with_truth:
        picture, metrics = prediction.compare(networks, example, predicted)
    facts = {
        "prediction": example.name,
        "models": f"{predicted.method} of {models}",
        "words": metrics,
        "credits": _credits(scene),
    }
    with atomic_file(out) as partial:
        partial.write_bytes(png_bytes(picture, facts))
    height, width = predicted.color.shape[:2]
    message = f"{out}: {example.name}, {width}x{height} {metrics}".rstrip()
    if exr:
        target = out.with_suffix(".exr")
        about = prediction.write_radiance(target, networks, source.view, example, predicted, facts)
        message += f"\n{target}: {about}"
    return message


def _view_sources(
    params: Params,
    data: Path,
    with_truth: bool,
    scene: Path | None,
    views: tuple[str, ...],
    all_views: bool,
    camera: Path | None,
    eye: str | None,
    towards: str | None,
    inputs: Path | None,
    illumination: Path | None,
    transport: Path | None,
    materials: Path | None,
    noisy: Path | None,
    spp: int | None,
    size: tuple[int, int] | None,
) -> list[ViewSource]:
    """The views that the options select."""
    if scene is None:
        if inputs is None or illumination is None:
            raise click.UsageError("give a SCENE and a --view, or --inputs and --illumination")
        if size or views or all_views or camera or eye or towards or spp:
            raise click.UsageError(
                "--size, --view, --all-views, --camera, --eye, --towards and --spp need a SCENE"
            )
        paths = {
            "transport": transport or _beside(illumination, "transport"),
            "materials": materials or _beside(illumination, "materials"),
            "noisy": noisy,
        }
        optional = {name: path for name, path in paths.items() if path}
        frames = prediction.frame_sets(inputs, illumination, *optional.values())
        truth = data if with_truth else None
        return [
            prediction.from_frames(
                *files[:2], truth=truth, **dict(zip(optional, files[2:], strict=True))
            )
            for files in frames
        ]
    if any((inputs, illumination, transport, materials, noisy)):
        raise click.UsageError("give a SCENE, or --inputs and --illumination, not both")
    chosen = _scene_views(params, data, scene, views, all_views, camera, eye, towards, size)
    return prediction.from_scene(scene, chosen, params, data, with_truth, spp or 0)


def _scene_views(
    params: Params,
    data: Path,
    scene: Path,
    views: tuple[str, ...],
    all_views: bool,
    camera: Path | None,
    eye: str | None,
    towards: str | None,
    size: tuple[int, int] | None,
) -> list[View]:
    """The views of a scene that the options select."""
    if sum((bool(views), all_views, eye is not None)) != 1 or (eye is None) != (towards is None):
        raise click.UsageError(
            "with SCENE, give --view (repeatable), or --all-views, or --eye and --towards"
        )
    if eye is not None and towards is not None:
        image = replace(params.image, width=size[0], height=size[1]) if size else params.image
        placed = prediction.placed_view(
            scene, _triple(eye, "--eye"), _triple(towards, "--towards"), intrinsics_of(image)
        )
        return [placed]
    camera = camera or data / "cameras" / f"{scene.name}.json"
    return prediction.find_views(scene, camera, views, size)


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
    if count > 1 or out.is_dir():
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


def _triple(text: str, option: str) -> Any:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise click.BadParameter(f"{text!r}: write it like 1,2,1.6", param_hint=option)
    return numbers
