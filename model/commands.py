"""`pbrnet backbone`, `train`, `evaluate`, `predict` and `export`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from model import evaluation
from model import predict as prediction
from model.backbone import make_backbone
from model.export import INPUTS, export_onnx
from model.inference import load_networks
from model.methods import BASELINES, METHODS
from model.metrics import NAMES
from model.training import Folders, train_network
from pipeline.frames import read_frame
from pipeline.options import common_options
from pipeline.params import Params
from pipeline.pictures import png_bytes
from pipeline.tonemap import to_bytes
from pipeline.views import View
from scenes.checked import build
from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.files import atomic_file

_FOLDER = click.Path(path_type=Path, file_okay=False)
_FILE = click.Path(path_type=Path, dir_okay=False)


def _models_option(help_text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    return click.option(
        "--models",
        type=_FOLDER,
        default=Path("models"),
        show_default=True,
        help=help_text,
    )


@click.command(
    epilog="""\b
Examples:
  pbrnet backbone                      VGG-19 if its weights are here, else EfficientNet-Lite0
  pbrnet backbone --models /tmp/other  write it elsewhere

params.yaml, section backbone: `network`, `weights` (a VGG-19 file with torchvision's names),
`download` (whether VGG-19 may be fetched)."""
)
@_models_option("Where backbone.safetensors and backbone.json go.")
@common_options
def backbone(params: Params, data: Path, models: Path) -> None:
    """Get the pretrained features that the perceptual loss compares."""
    card = make_backbone(params.backbone, models)
    click.echo(f"backbone: {card.network} from {card.source}, in {models}")


@click.group(
    epilog="""\b
Examples:
  pbrnet train shading                 first stage
  pbrnet train composition             second stage, on the fixed shading network
  pbrnet train baselines               those they are compared with
  pbrnet train pix2pix                 one of those, trained with our loss
  pbrnet train pix2pix_own             and with its paper's
  pbrnet train shading --data data/room --models models/room \\
      --from models/shading.safetensors      fine-tune on another dataset

A training that was stopped goes on from its last checkpoint when started again."""
)
def train() -> None:
    """Train a network; each has its own section in params.yaml, train.NAME."""


def _train_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.option(
            "--from",
            "start",
            type=_FILE,
            default=None,
            metavar="MODEL",
            help="Start from this model's weights (fine-tuning) instead of random ones.",
        ),
        click.option(
            "--backbone",
            "backbone_folder",
            type=_FOLDER,
            default=Path("models"),
            show_default=True,
            help="Folder with the perceptual loss's backbone.",
        ),
        _models_option("Where models are read and written; metrics and plots go along."),
    ):
        command = option(command)
    return common_options(command)


def _train(
    name: str, params: Params, data: Path, models: Path, backbone: Path, start: Path | None
) -> None:
    folders = Folders.beside(data, models, backbone)
    card = train_network(name, params, folders, start)
    loss = card.metrics["validation_loss"]
    seen = "" if loss is None else f", validation loss {loss:.2f}"
    click.echo(f"{models}/{name}.safetensors: {card.parameters / 1e6:.2f} M parameters{seen}")


@train.command("shading", epilog="Example: pbrnet train shading --seed 3")
@_train_options
def train_shading(
    params: Params, data: Path, models: Path, backbone_folder: Path, start: Path | None
) -> None:
    """First stage: shading from depth, normal and panorama."""
    _train("shading", params, data, models, backbone_folder, start)


@train.command("composition", epilog="Example: pbrnet train composition")
@_train_options
def train_composition(
    params: Params, data: Path, models: Path, backbone_folder: Path, start: Path | None
) -> None:
    """Second stage: colour from the fixed network's shading and reflectance."""
    _train("composition", params, data, models, backbone_folder, start)


def _baseline_command(name: str) -> click.Command:
    @train.command(
        name, help=f"Baseline: {METHODS[name].title}.", epilog=f"Example: pbrnet train {name}"
    )
    @_train_options
    def command(
        params: Params, data: Path, models: Path, backbone_folder: Path, start: Path | None
    ) -> None:
        _train(name, params, data, models, backbone_folder, start)

    return command


for _name in BASELINES:
    _baseline_command(_name)


@train.command(
    "baselines",
    epilog="""\b
Examples:
  pbrnet train baselines               those that params.yaml names: train.baselines
  dvc repro train_baselines            the same, each only if it is out of date""",
)
@_train_options
def train_baselines(
    params: Params, data: Path, models: Path, backbone_folder: Path, start: Path | None
) -> None:
    """Every network of train.baselines, one after the other."""
    if start is not None and len(params.train.baselines) > 1:
        raise click.UsageError("--from fits one network; train the baselines one by one")
    for name in params.train.baselines:
        _train(name, params, data, models, backbone_folder, start)


@click.command(
    epilog="""\b
Examples:
  pbrnet evaluate                      the split that params.yaml names (evaluate.split)
  pbrnet evaluate --models models/room --data data/room

Refused if a test scene, or another scene of its floor plan, was trained on.""",
)
@_models_option("Trained networks.")
@common_options
def evaluate(params: Params, data: Path, models: Path) -> None:
    """Measure the networks beside reflectance x shading and every baseline that is trained."""
    result = evaluation.evaluate(params, Folders.beside(data, models, models))
    click.echo(f"{result['views']} views of {result['scenes']} {result['split']} scenes")
    for method in evaluation.METHODS:
        if method in result["methods"]:
            click.echo(_line(method, result["methods"][method]))


def _line(method: str, values: dict[str, Any]) -> str:
    parts = []
    for name in NAMES:
        if values[name] is not None:
            low, high = values[name]["low"], values[name]["high"]
            around = "" if low is None else f" ({low:.3f} to {high:.3f})"
            parts.append(f"{name.upper()} {values[name]['mean']:.3f}{around}")
    return f"{method:>14}: {', '.join(parts)}"


@click.command(
    epilog="""\b
Examples:
  pbrnet predict data/scenes/home-0000 --view VIEW
  pbrnet predict data/scenes/home-0000 --view VIEW --size 640x480 --compare
  pbrnet predict data/scenes/home-0000 --view VIEW --method hybrid
  pbrnet predict --inputs in.exr --illumination panorama.exr --out picture.png

VIEW is a view_id of the camera file, data/cameras/SCENE.json unless --camera names another.
--compare reads the truth from the data folder, or renders it, and puts it beside the
prediction with the error. `pbrnet report` shows all that lies in predictions/.""",
)
@click.argument("scene", type=_FOLDER, required=False)
@click.option("--view", "view_id", default=None, help="View of the camera file.")
@click.option("--camera", type=_FILE, default=None, help="Camera file of the scene.")
@click.option("--inputs", type=_FILE, default=None, help="Frame with depth, normal, reflectance.")
@click.option("--illumination", type=_FILE, default=None, help="Frame with the panorama.")
@click.option("--noisy", type=_FILE, default=None, help="Frame of few samples, for hybrid.")
@click.option(
    "--method",
    type=click.Choice([prediction.PAIR, *BASELINES]),
    default=prediction.PAIR,
    show_default=True,
    help="Both networks, or another method that is trained.",
)
@click.option("--size", default=None, metavar="WxH", help="Render the inputs at this size.")
@click.option("--compare", "with_truth", is_flag=True, help="Put truth and error beside it.")
@click.option(
    "--out", type=_FILE, default=None, help="PNG to write.  [default: predictions/SCENE--VIEW.png]"
)
@_models_option("Trained networks.")
@common_options
def predict(
    params: Params,
    data: Path,
    models: Path,
    scene: Path | None,
    view_id: str | None,
    camera: Path | None,
    inputs: Path | None,
    illumination: Path | None,
    noisy: Path | None,
    method: str,
    size: str | None,
    with_truth: bool,
    out: Path | None,
) -> None:
    """Make an image through the trained networks, from SCENE or from frames."""
    networks = load_networks(models, () if method == prediction.PAIR else (method,))
    if scene is not None:
        if view_id is None or inputs or illumination or noisy:
            raise click.UsageError("with SCENE, name a --view, and no frames")
        camera = camera or data / "cameras" / f"{scene.name}.json"
        view = prediction.find_view(scene, camera, view_id, parse_size(size))
        example = prediction.from_scene(scene, view, params, networks, data, with_truth, method)
    else:
        if inputs is None or illumination is None:
            raise click.UsageError("name a SCENE and a --view, or --inputs and --illumination")
        if size or view_id or camera:
            raise click.UsageError("--size, --view and --camera need a SCENE")
        frame = read_frame(inputs)
        truth = None
        if with_truth:
            shown = build(View, frame.meta["view"], str(inputs), InputError)
            truth = prediction.known_truth(data, shown)
            if truth is None:
                raise InputError(
                    f"{data}: no shading and colour frames of {shown.scene_id}/{shown.view_id} to "
                    "compare with; render them, or predict from the scene"
                )
        samples = read_frame(noisy) if noisy else None
        example = prediction.from_frames(frame, read_frame(illumination), networks, truth, samples)
    result = prediction.predict(networks, example, method)
    picture, words = to_bytes(result.color), ""
    if with_truth:
        picture, words = prediction.compare(networks, example, result)
    facts = {
        "prediction": example.name,
        "models": str(models),
        "words": words,
        "credits": _credits(scene or data / "scenes" / example.scene_id),
    }
    out = out or Path("predictions") / f"{example.scene_id}--{example.view_id}.png"
    with atomic_file(out) as partial:
        partial.write_bytes(png_bytes(picture, facts))
    click.echo(f"{out}: {example.name}, {result.color.shape[1]}x{result.color.shape[0]} {words}")


@click.command(
    epilog="""\b
Examples:
  pbrnet export --onnx model.onnx
  python examples/consume/with_onnx.py model.onnx data/dataset

The file takes the dataset's columns as they are, at any size, and gives shading and colour as
display values. Needs the extra packages: pip install 'pbrnet[onnx]'"""
)
@click.option("--onnx", "out", type=_FILE, required=True, metavar="FILE", help="ONNX to write.")
@_models_option("Trained networks.")
@common_options
def export(params: Params, data: Path, models: Path, out: Path) -> None:
    """Write both trained networks as one file for other programs."""
    export_onnx(load_networks(models), out)
    click.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB, {', '.join(INPUTS)} to shading, color")


def _credits(scene: Path) -> list[str]:
    """Whose work a scene is and on what terms, as far as its folder is there."""
    if not (scene / "scene.json").is_file():
        return []
    credits = load_scene(scene).credits
    return list(dict.fromkeys(f"{c.title} by {c.author}, {c.licence}" for c in credits))


def parse_size(text: str | None) -> tuple[int, int] | None:
    """(width, height) from the words of a `--size` option; None where there are none."""
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", text)
    if match is None or min(int(match[1]), int(match[2])) < 1:
        raise click.BadParameter(f"{text!r} is no size; write it like 640x480", param_hint="--size")
    return int(match[1]), int(match[2])
