"""`pbrnet study flicker`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.evaluation.inference import PREDICTABLE, load_networks
from model.evaluation.predict import find_views
from model.options import FILE, FOLDER, found_models_option, size_option
from model.release.pretrained import find_models
from model.studies.flicker.results import FlickerResult
from model.studies.flicker.study import Study, Wish, measure_move
from pipeline.commands.options import common_options
from pipeline.images import png_bytes
from pipeline.params import Params
from scenes.checked import plain
from scenes.errors import InputError
from scenes.files import atomic_file, write_json


@click.command(
    epilog="""\b
Examples:
  pbrnet study flicker data/scenes/home-0000 --view VIEW
  pbrnet study flicker data/scenes/home-0000 --view VIEW --move pan --step 1 --frames 12
  pbrnet study flicker data/scenes/home-0000 --view VIEW --method pbrnet --method plus

Renders inputs and truth of every frame. Gives the mean absolute difference, as displayed, of what
two neighbouring frames both see: less is steadier, and the renderer's own is what to compare with.
A sheet of the frames is written beside the JSON."""
)
@click.argument("scene", type=FOLDER)
@click.option("--view", "view_id", required=True, help="Where the move starts.")
@click.option("--camera", type=FILE, default=None, help="Camera file of the scene.")
@click.option(
    "--move",
    type=click.Choice(["dolly", "truck", "pan", "still"]),
    default="dolly",
    show_default=True,
    help="Ahead, to the right, a turn to the right, or none.",
)
@click.option("--frames", type=click.IntRange(2, 240), default=8, show_default=True)
@click.option(
    "--step",
    type=click.FloatRange(0, 90),
    default=None,
    help="Metres a frame, or degrees of a pan.  [default: 0.02 m, 0.5 degrees]",
)
@size_option("Another size than the view's.")
@click.option(
    "--method",
    "methods",
    type=click.Choice(PREDICTABLE),
    multiple=True,
    help="A method to measure, again for more.  [default: pbrnet, or else what is trained]",
)
@click.option(
    "--out",
    type=FILE,
    default=Path("metrics/studies/flicker.json"),
    show_default=True,
    help="JSON to write.",
)
@found_models_option()
@common_options
def flicker(
    params: Params,
    data: Path,
    scene: Path,
    view_id: str,
    camera: Path | None,
    size: tuple[int, int] | None,
    methods: tuple[str, ...],
    out: Path,
    models: Path | None,
    step: float | None,
    **wishes: Any,
) -> None:
    """Measure how steady predictions are along a short camera move, beside the renderer."""
    if out.suffix != ".json":
        raise click.BadParameter(f"{out}: let it end in .json", param_hint="--out")
    found = [find_models(models, name) for name in dict.fromkeys(methods)] or [
        find_models(models, None)
    ]
    networks = [load_networks(one.folder, [one.method]) for one in found]
    if len({(n.card.exposure, tuple(sorted(n.card.tone.items()))) for n in networks}) > 1:
        raise InputError(
            "these methods show their colours differently (exposure or tone); measure one by one"
        )
    camera = camera or data / "cameras" / f"{scene.name}.json"
    (view,) = find_views(scene, camera, (view_id,), size)
    usual = 0.5 if wishes["move"] == "pan" else 0.02
    wish = Wish(step=usual if step is None else step, **wishes)
    study = measure_move(networks, scene, view, wish, params)
    result = FlickerResult(
        scene_id=view.scene_id,
        view_id=view.view_id,
        width=view.width,
        height=view.height,
        seed=params.seed,
        move=wish.move,
        frames=wish.frames,
        step=wish.step,
        spp=params.groundtruth.spp,
        denoise=params.groundtruth.denoise,
        visible=study.visible,
        methods=study.methods,
        weights={
            one.method: {name: card.sha256 for name, card in each.cards.items()}
            for one, each in zip(found, networks, strict=True)
        },
    )
    write_json(out, plain(result))
    with atomic_file(out.with_suffix(".png")) as partial:
        partial.write_bytes(png_bytes(study.sheet))
    for line in _lines(study):
        click.echo(line)
    click.echo(f"{out}, {out.with_suffix('.png')}")


def _lines(study: Study) -> list[str]:
    truth = study.methods["renderer"].mean
    lines = [f"{study.visible:.1%} of the pixels are seen in both of two neighbouring frames"]
    for name, one in study.methods.items():
        times = "" if name.startswith("renderer") or truth == 0 else f", {one.mean / truth:.2f}x"
        lines.append(f"{name:>22}: {one.mean:.5f}{times}")
    return lines
