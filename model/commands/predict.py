"""`pbrnet predict`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from model.evaluation import predict as prediction
from model.evaluation.inference import PREDICTABLE, Networks, load_networks
from model.evaluation.predict import Wanted
from model.networks.tiles import SMALLEST
from model.options import FILE, FOLDER, found_models_option, size_option
from model.release.pretrained import find_models
from pipeline.commands.options import common_options
from pipeline.images import png_bytes
from pipeline.params import Params
from pipeline.progress import Progress
from pipeline.tonemap import to_bytes
from pipeline.views import intrinsics_of
from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.files import atomic_file

_EITHER = click.Path(path_type=Path)


@click.command(
    epilog="""\b
Examples:
  pbrnet predict data/scenes/home-0000 --view VIEW
  pbrnet predict data/scenes/home-0000 --view VIEW --size 640x480 --compare
  pbrnet predict data/scenes/home-0000 --all-views --method plus
  pbrnet predict data/scenes/home-0000 --view VIEW --method hybrid
  pbrnet predict data/scenes/my-home --eye 1,2,1.6 --towards 1,0.3,-0.2 --size 800x600
  pbrnet predict data/scenes/my-home --view VIEW --size 3840x2880 --tile 512 --exr
  pbrnet predict --inputs in.exr --illumination panorama.exr --out picture.png
  pbrnet predict --inputs data/inputs/home-0000 --illumination data/illumination/home-0000

VIEW is a view_id of the camera file, data/cameras/SCENE.json unless --camera names another.
Networks are those in models/ or, if none are trained there, the pretrained ones that come with
pbrnet. --compare reads the truth from the data folder, or renders it, and puts it beside the
prediction with the error. --exr: docs/use.md says what its numbers mean. `pbrnet report` shows
all that lies in predictions/."""
)
@click.argument("scene", type=FOLDER, required=False)
@click.option("--view", "views", multiple=True, help="View of the camera file; again for more.")
@click.option("--all-views", is_flag=True, help="All views of the camera file.")
@click.option("--camera", type=FILE, default=None, help="Camera file of the scene.")
@click.option("--eye", metavar="X,Y,Z", help="A camera of your own: where, metres, Z up.")
@click.option("--towards", metavar="X,Y,Z", help="And in which direction it looks.")
@click.option("--inputs", type=_EITHER, help="Frame with depth, normal, reflectance, or a folder.")
@click.option("--illumination", type=_EITHER, help="Frame with the panorama, or a folder.")
@click.option("--visibility", type=_EITHER, help="Frame of shadows, or a folder, for plus.")
@click.option("--noisy", type=_EITHER, help="Frame of few samples, or a folder, for hybrid.")
@size_option("Render the inputs at this size.")
@click.option(
    "--method",
    type=click.Choice(PREDICTABLE),
    default=None,
    help="How to make the colour.  [default: pbrnet, or else what is trained]",
)
@click.option(
    "--tile",
    type=click.IntRange(SMALLEST),
    default=None,
    metavar="N",
    help="Compute large images in overlapping pieces of N pixels a side: less memory.",
)
@click.option("--exr", is_flag=True, help="Write linear radiance beside the PNG, as OpenEXR.")
@click.option("--compare", "with_truth", is_flag=True, help="Put truth and error beside it.")
@click.option(
    "--out",
    type=_EITHER,
    default=None,
    help="PNG to write; of several views, a folder.  [default: predictions/SCENE--VIEW.png]",
)
@found_models_option()
@common_options
def predict(
    params: Params,
    data: Path,
    models: Path | None,
    method: str | None,
    tile: int | None,
    exr: bool,
    with_truth: bool,
    out: Path | None,
    **source: Any,
) -> int:
    """Make images through the trained networks, from SCENE or from frames."""
    wanted = _wanted(params, data, with_truth, **source)
    if len(wanted) > 1 and out is not None and out.suffix.lower() in (".png", ".exr"):
        raise click.BadParameter(f"{out}: {len(wanted)} views need a folder", param_hint="--out")
    found = find_models(models, method)
    networks = load_networks(found.folder, [found.method], tile or 0)
    click.echo(f"{found.method}, networks from {found.words}")
    scene = source["scene"]
    failed = 0
    with Progress(len(wanted), "predict") as progress:
        for one in wanted:
            folder = scene or data / "scenes" / one.view.scene_id
            try:
                said = _predict_one(networks, one, _target(out, one, len(wanted)), folder, exr,
                                    with_truth, str(found.folder))  # fmt: skip
            except InputError as error:
                if len(wanted) == 1:
                    raise
                failed += 1
                click.echo(f"Error: {one.name}: {error}", err=True)
            else:
                click.echo(said)
            progress.advance()
    return 1 if failed else 0


def _predict_one(
    networks: Networks,
    wanted: Wanted,
    out: Path,
    scene: Path,
    exr: bool,
    with_truth: bool,
    models: str,
) -> str:
    """Write the picture of a view, and its radiance; returns what to tell."""
    example = wanted.make(networks.card)
    unshaded = bool(networks.card.training.get("shadows")) and example.visibility is None
    if unshaded:
        example = replace(example, visibility=np.ones_like(example.depth))
    made = networks.predict(networks.methods[0], example)
    picture, words = to_bytes(made.color), ""
    if with_truth:
        picture, words = prediction.compare(networks, example, made)
    facts = {
        "prediction": example.name,
        "models": f"{made.method} of {models}",
        "words": words,
        "credits": _credits(scene),
    }
    with atomic_file(out) as partial:
        partial.write_bytes(png_bytes(picture, facts))
    said = f"{out}: {example.name}, {made.color.shape[1]}x{made.color.shape[0]} {words}".rstrip()
    if unshaded:
        said += "\nwithout shadows, which the network was trained with: give --visibility too"
    if exr:
        target = out.with_suffix(".exr")
        about = prediction.write_radiance(target, networks, wanted, example, made, facts)
        said += f"\n{target}: {about}"
    return said


def _wanted(
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
    visibility: Path | None,
    noisy: Path | None,
    size: tuple[int, int] | None,
) -> list[Wanted]:
    """The views that the options name."""
    if scene is None:
        if inputs is None or illumination is None:
            raise click.UsageError("name a SCENE and a --view, or --inputs and --illumination")
        if size or views or all_views or camera or eye or towards:
            raise click.UsageError(
                "--size, --view, --all-views, --camera, --eye and --towards need a SCENE"
            )
        asked = {"visibility": visibility or _shadows_beside(illumination), "noisy": noisy}
        more = {name: path for name, path in asked.items() if path}
        frames = prediction.frame_sets(inputs, illumination, *more.values())
        truth = data if with_truth else None
        return [
            prediction.from_frames(
                *paths[:2], truth=truth, **dict(zip(more, paths[2:], strict=True))
            )
            for paths in frames
        ]
    if inputs or illumination or visibility or noisy:
        raise click.UsageError("name a SCENE, or --inputs and --illumination, not both")
    if sum((bool(views), all_views, eye is not None)) != 1 or (eye is None) != (towards is None):
        raise click.UsageError(
            "with SCENE, name a --view (again for more), or --all-views, or --eye and --towards"
        )
    if eye is not None and towards is not None:
        image = replace(params.image, width=size[0], height=size[1]) if size else params.image
        placed = prediction.placed_view(
            scene, _triple(eye, "--eye"), _triple(towards, "--towards"), intrinsics_of(image)
        )
        return prediction.from_scene(scene, [placed], params, data, with_truth)
    camera = camera or data / "cameras" / f"{scene.name}.json"
    found = prediction.find_views(scene, camera, views, size)
    return prediction.from_scene(scene, found, params, data, with_truth)


def _shadows_beside(illumination: Path) -> Path | None:
    """Frames of shadows, where the stages put them: in `visibility` beside `illumination`."""
    parts = illumination.parts
    if "illumination" not in parts:
        return None
    place = len(parts) - 1 - parts[::-1].index("illumination")
    found = Path(*parts[:place], "visibility", *parts[place + 1 :])
    there = any(found.rglob("*.exr")) if found.is_dir() else found.is_file()
    return found if there else None


def _target(out: Path | None, wanted: Wanted, count: int) -> Path:
    name = f"{wanted.view.scene_id}--{wanted.view.view_id}.png"
    if out is None:
        return Path("predictions") / name
    if count > 1 or out.is_dir():
        return out / name
    if out.suffix.lower() != ".png":
        raise click.BadParameter(f"{out}: let the picture end in .png", param_hint="--out")
    return out


def _credits(scene: Path) -> list[str]:
    """Whose work a scene is and on what terms, as far as its folder is there."""
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
