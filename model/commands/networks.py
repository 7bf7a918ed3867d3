"""Commands that train, evaluate, pack and export networks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.evaluation import evaluate as evaluation
from pbrnet.model.evaluation import reference as kept
from pbrnet.model.evaluation.inference import load_networks, needed
from pbrnet.model.evaluation.metrics import NAMES
from pbrnet.model.methods import BASELINES, PREDICTABLE
from pbrnet.model.options import (
    folders_options,
    found_models_option,
    methods_option,
    models_option,
)
from pbrnet.model.release.onnx_export import EXPORTABLE, OUTPUTS, export_onnx, exported_inputs
from pbrnet.model.release.pretrained import DEPTH, DEPTH_FILES, find_models, pack
from pbrnet.model.titles import NETWORK_TITLES
from pbrnet.model.training.backbone import make_backbone
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.commands.options import FILE, FOLDER, Request, common_options
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.terminal import say, views_of
from pbrnet.scenes.files import atomic_file, write_json


@click.command(
    epilog="""\b
Examples:
  pbrnet backbone                      VGG-19 if its weights are available, or EfficientNet-Lite0
  pbrnet backbone --models /tmp/other  write to another folder

Section backbone of params.yaml: `network`, `weights` (a VGG-19 file with torchvision's names),
`download` (whether to download the weights of VGG-19)."""
)
@models_option("Folder for backbone.safetensors and backbone.json.")
@common_options
def backbone(request: Request, models: Path) -> None:
    """Prepare the pretrained feature extractor of the perceptual loss."""
    card = make_backbone(request.params.backbone, models)
    say(f"backbone: {card.network} from {card.source}, in {models}")


@click.group(
    epilog="""\b
Examples:
  pbrnet train shading                 first stage
  pbrnet train composition             second stage, on the fixed shading network
  pbrnet train baselines               the baselines for comparison
  pbrnet train pix2pix                 one baseline, trained with our loss
  pbrnet train pix2pix_own             the same with the loss of its paper
  pbrnet train shading --data data/room --models models/room \\
      --from models/shading.safetensors      fine-tune on another dataset

An interrupted training resumes from its last checkpoint."""
)
def train() -> None:
    """Train a network with the parameters in section train.NAME of params.yaml."""


def _training(name: str, about: str, epilog: str) -> None:
    """Add `pbrnet train NAME`, which trains a network, or all those in `train.baselines`."""

    @train.command(name, help=about, epilog=epilog)
    @models_option("Folder of trained networks, to read and to write.")
    @click.option(
        "--backbone",
        type=FOLDER,
        default=Path("models"),
        help="Folder of the backbone of the perceptual loss.",
    )
    @click.option(
        "--from",
        "start",
        type=FILE,
        metavar="MODEL",
        help="Initialise with the weights of this model (fine-tuning).",
    )
    @common_options
    def command(request: Request, models: Path, backbone: Path, start: Path | None) -> None:
        names = request.params.train.baselines if name == "baselines" else (name,)
        if start is not None and len(names) > 1:
            raise click.UsageError("--from applies to one network; train the baselines one by one")
        for one in names:
            folders = Folders.beside(request.data, models, backbone)
            with data_lock(models / "checkpoints", f"train {one}", f".{one}.lock", "--models"):
                card = train_network(one, request.params, folders, start)
            loss = card.metrics["validation_loss"]
            seen = "" if loss is None else f", validation loss {loss:.2f}"
            size = f"{card.parameters / 1e6:.2f} M parameters"
            say(f"{models}/{one}.safetensors: {size}{seen}")


_training(
    "shading",
    "First stage: shading from depth, normal and panorama.",
    "Example: pbrnet train shading --seed 3",
)
_training(
    "composition",
    "Second stage: colour from reflectance and the predicted shading.",
    "Example: pbrnet train composition",
)
for _name in BASELINES:
    _training(_name, f"{NETWORK_TITLES[_name]}.", f"Example: pbrnet train {_name}")
_training(
    "baselines",
    "All networks in train.baselines, one after another.",
    """\b
Examples:
  pbrnet train baselines               the networks in train.baselines of params.yaml
  dvc repro train_baselines            the same, but only those that are out of date""",
)


@click.command(
    epilog="""\b
Examples:
  pbrnet evaluate                      on the split evaluate.split of params.yaml
  pbrnet evaluate --models models/room --data data/room
  pbrnet evaluate --models weights --data data/room     the pretrained networks

Evaluates every method whose networks are in the folder. Fails if a network was trained on a scene
of the split or on another scene with its floor plan.""",
)
@folders_options()
def evaluate(request: Request, folders: Folders) -> None:
    """Evaluate the trained networks, the baselines, and reflectance x shading."""
    result = evaluation.evaluate(request.params, folders)
    say(views_of(result["views"], result["scenes"], result["split"]))
    for method in evaluation.EVALUATED_METHODS:
        if method in result["methods"]:
            say(_line(method, result["methods"][method]))


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
  pbrnet pretrained                        pack the two networks of models/ into weights/
  pbrnet pretrained --method plus --method hybrid     networks of other methods
  pbrnet pretrained --from models/room --out /tmp/room --metrics models/room
  pbrnet pretrained --depth data/studies/photographs/ROW/0     the network of `pbrnet depth`

Stores each network in half precision with its card, and writes a README.md with training data,
licences and results. Fails if predictions would change visibly or the folder would exceed 16 MB.
`pbrnet predict` uses weights/ if models/ has no networks."""
)
@click.option(
    "--from", "source", type=FOLDER, default=Path("models"), help="Folder of trained networks."
)
@click.option(
    "--out",
    type=FOLDER,
    default=Path("weights"),
    help="Folder to write; packed networks in it are replaced.",
)
@methods_option(PREDICTABLE, "Method whose networks to pack (repeatable).", default=["pbrnet"])
@click.option(
    "--metrics",
    type=FOLDER,
    default=Path("metrics"),
    help="Folder with evaluation.json or photographs.json, for the results in the model card.",
)
@click.option(
    "--depth",
    "training",
    type=FOLDER,
    metavar="FOLDER",
    help="Pack this training of `pbrnet study photographs` instead.",
)
@common_options
def pretrained(
    request: Request,
    source: Path,
    out: Path,
    methods: tuple[str, ...],
    metrics: Path,
    training: Path | None,
) -> None:
    """Pack trained networks for release, in half precision and with a model card."""
    if training is not None:
        from pbrnet.model.studies.photographs.release import pack_depth

        card = pack_depth(training, metrics, out)
        say(f"{out / DEPTH_FILES[0]}: {card.row}, {card.pictures} pictures")
        return
    for difference in pack(source, out, methods, request.data, metrics):
        say(
            f"{', '.join(needed(difference.method))}: on {difference.views} views predictions "
            f"differ by at most {difference.worst:.5f}, on average by {difference.mean:.6f}"
        )
    size = sum(file.stat().st_size for file in out.iterdir()) / 1e6
    say(f"{out}: {size:.1f} MB")


@click.command(
    epilog="""\b
Examples:
  pbrnet reference                                      metrics/reference.json
  pbrnet reference --sheet best-to-worst.png --method plus --method hybrid
  python -c "import json; print(json.load(open('metrics/reference.json'))['methods']['plus'])"

Reads the results of `pbrnet evaluate` and, for the sheet, the dataset. The sheet has a row for each
view, from the best to the worst of the first method, with the ground truth on the left."""
)
@click.option(
    "--out", type=FILE, help="JSON to write.  [default: reference.json beside evaluation.json]"
)
@click.option("--sheet", type=FILE, metavar="FILE", help="Contact sheet to write.")
@methods_option(
    evaluation.EVALUATED_METHODS, "Column of the sheet (repeatable).", default=["pbrnet"]
)
@click.option("--views", type=click.IntRange(1, 100), default=8, help="Rows of the sheet.")
@folders_options()
def reference(
    request: Request,
    folders: Folders,
    out: Path | None,
    sheet: Path | None,
    methods: tuple[str, ...],
    views: int,
) -> None:
    """Write the figures of all methods to one flat JSON file, and draw a contact sheet."""
    target, params = out or folders.metrics / "reference.json", request.params
    write_json(target, kept.summary(folders, params.seed))
    say(f"{target}: written")
    if sheet is not None:
        picture = kept.sheet(params.evaluate.split, params.tone, folders, methods, views)
        with atomic_file(sheet) as partial:
            partial.write_bytes(picture)
        say(f"{sheet}: written")


@click.command(
    epilog="""\b
Examples:
  pbrnet export --onnx model.onnx
  pbrnet export --method plus --onnx plus.onnx
  pbrnet export --method depth --onnx depth.onnx      the network of `pbrnet depth`
  python examples/consume/with_onnx.py model.onnx data/dataset
  python examples/onnx_predict.py model.onnx data/inputs/S/V.exr data/illumination/S/V.exr

The model takes columns of the dataset, at any image size, and returns shading and colour as display
values, or radiance and colour for plus and hybrid. Requires: pip install 'pbrnet[onnx]'"""
)
@click.option("--onnx", "out", type=FILE, required=True, metavar="FILE", help="File to write.")
@click.option(
    "--method",
    type=click.Choice((*EXPORTABLE, DEPTH)),
    default="pbrnet",
    help="Method to export.",
)
@found_models_option()
@common_options
def export(request: Request, models: Path | None, method: str, out: Path) -> None:
    """Export the trained networks of a method as one ONNX file."""
    if method == DEPTH:
        from pbrnet.model.studies.photographs.release import export_depth, load_depth

        export_depth(load_depth(models and models / DEPTH_FILES[0]), out)
        say(f"{out}: {out.stat().st_size / 1e6:.1f} MB, image, rays to depth, normal, classes")
        return
    found = find_models(models, method)
    networks = load_networks(found.folder, [method])
    export_onnx(networks, out)
    names = ", ".join(exported_inputs(networks))
    say(f"{out}: {out.stat().st_size / 1e6:.1f} MB, {names} to {', '.join(OUTPUTS[method])}")
    say(f"{method}, networks from {found.description}")
