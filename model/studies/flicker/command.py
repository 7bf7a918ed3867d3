"""`pbrnet study flicker`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.evaluation.predict import ViewRenderer
from pbrnet.model.evaluation.selection import find_views
from pbrnet.model.methods import PREDICTABLE
from pbrnet.model.options import found_models_option, methods_option
from pbrnet.model.release.pretrained import find_models
from pbrnet.model.studies.files import write_result
from pbrnet.model.studies.flicker.results import FlickerResult
from pbrnet.model.studies.flicker.study import FlickerConfig, FlickerMeasurement, measure_move
from pbrnet.pipeline.commands.options import (
    FILE,
    FOLDER,
    NumberRange,
    Request,
    common_options,
    size_option,
)
from pbrnet.pipeline.images import png_bytes
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.errors import InputError


@click.command(
    "flicker",
    epilog="""\b
Examples:
  pbrnet study flicker data/scenes/home-0000 --view VIEW
  pbrnet study flicker data/scenes/home-0000 --view VIEW --move pan --step 1 --frames 12
  pbrnet study flicker data/scenes/home-0000 --view VIEW --method pbrnet --method plus

Renders inputs and ground truth of every frame. The measure is the mean absolute difference of
display values between neighbouring frames, over the pixels that both frames see. Lower is more
stable; compare with the value of the renderer. A contact sheet is written beside the JSON.""",
)
@click.argument("scene", type=FOLDER, metavar="SCENE")
@click.option("--view", "view_id", required=True, help="View at the start of the move.")
@click.option("--camera", type=FILE, help="Camera file.  [default: DATA/cameras/SCENE.json]")
@click.option(
    "--move",
    type=click.Choice(["dolly", "truck", "pan", "still"]),
    default="dolly",
    help="Move forward, to the right, turn to the right, or stand still.",
)
@click.option("--frames", type=click.IntRange(2, 240), default=8, help="Number of frames.")
@click.option(
    "--step",
    type=NumberRange(0, 90),
    help="Metres per frame, or degrees for pan.  [default: 0.02 m, 0.5 degrees]",
)
@size_option("Image size.  [default: as in the camera file]")
@methods_option(
    PREDICTABLE, "Method to measure (repeatable).  [default: pbrnet, or the trained method]"
)
@click.option(
    "--out", type=FILE, default=Path("metrics/studies/flicker.json"), help="JSON to write."
)
@found_models_option()
@common_options
def command(
    request: Request,
    scene: Path,
    view_id: str,
    camera: Path | None,
    size: tuple[int, int] | None,
    methods: tuple[str, ...],
    out: Path,
    models: Path | None,
    step: float | None,
    **options: Any,
) -> None:
    """Measure temporal stability along a short camera move, for networks and renderer.

    SCENE is a scene's folder, or the id of one in the data folder.
    """
    scene = scene if scene.is_dir() else request.data / "scenes" / scene
    if out.suffix != ".json":
        raise click.BadParameter(f"{out}: the file name must end in .json", param_hint="--out")
    found = [find_models(models, name) for name in dict.fromkeys(methods)] or [
        find_models(models, None)
    ]
    networks = [load_networks(one.folder, [one.method]) for one in found]
    if len({(n.card.exposure, tuple(sorted(n.card.tone.items()))) for n in networks}) > 1:
        raise InputError(
            "these methods use different exposure or tone mapping; measure them one at a time"
        )
    camera = camera or request.data / "cameras" / f"{scene.name}.json"
    (view,) = find_views(scene, camera, (view_id,), size)
    default_step = 0.5 if options["move"] == "pan" else 0.02
    config = FlickerConfig(step=default_step if step is None else step, **options)
    params = request.params
    study = measure_move(networks, ViewRenderer(scene, params), view, config)
    result = FlickerResult(
        scene_id=view.scene_id,
        view_id=view.view_id,
        width=view.width,
        height=view.height,
        seed=params.seed,
        move=config.move,
        frames=config.frames,
        step=config.step,
        spp=params.groundtruth.spp,
        denoise=params.groundtruth.denoise,
        visible=study.visible,
        methods=study.methods,
        weights={
            one.method: {name: card.sha256 for name, card in each.cards.items()}
            for one, each in zip(found, networks, strict=True)
        },
    )
    write_result(out, result, png_bytes(study.sheet))
    for line in _lines(study):
        say(line)
    say(f"{out}, {out.with_suffix('.png')}")


def _lines(study: FlickerMeasurement) -> list[str]:
    truth = study.methods["renderer"].mean
    lines = [f"{study.visible:.1%} of the pixels are visible in both neighbouring frames"]
    for name, one in study.methods.items():
        ratio = "" if name.startswith("renderer") or truth == 0 else f", {one.mean / truth:.2f}x"
        lines.append(f"{name:>22}: {one.mean:.5f}{ratio}")
    return lines
