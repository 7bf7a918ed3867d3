"""`pbrnet study noise`: networks that learn from noisy truth."""

from __future__ import annotations

from pathlib import Path

import click

from model.studies.noise.study import SAMPLES, NoisyTruths, noise_study
from model.studies.trials.options import FOLDER, carry_out, one_size, trial_options
from model.studies.trials.plan import Wish, plan
from model.training.train import Folders
from pipeline.params import Params


@click.command(
    epilog="""\b
Examples:
  pbrnet study noise --dry-run                    what would be rendered and trained
  pbrnet study noise --views 60 --steps 2000      at 4, 16 and 64 samples, raw and denoised
  pbrnet study noise --spp 1 --spp 8 --seeds 3

Needs the scenes and cameras that the dataset was made of. Stopped, the same command goes on where
it was; the frames lie in DATA/studies/noise and may be deleted once all is trained. Writes
metrics/studies/noise.json and .png."""
)
@click.option(
    "--spp",
    "samples",
    type=click.IntRange(1, 1 << 16),
    multiple=True,
    help="Samples a pixel of a truth to learn from, again for each.  [default: 4, 16, 64]",
)
@click.option(
    "--renders",
    type=FOLDER,
    default=None,
    help="Where rendered frames are kept.  [default: DATA/studies/noise]",
)
@one_size
@trial_options()
def noise(
    params: Params,
    data: Path,
    models: Path,
    samples: tuple[int, ...],
    renders: Path | None,
    views: int | None,
    dry_run: bool,
    seeds: int,
    steps: int | None,
) -> None:
    """Learn from noisy truth, raw and denoised (Figure 11).

    The same views, rendered again with few samples; judged against the dataset's own truth.
    """
    folders = Folders.beside(data, models, models)
    samples = tuple(sorted(set(samples or SAMPLES)))
    study = noise_study(samples)
    trials = plan(study, params, folders, Wish(seeds, steps, () if views is None else (views,)))
    scenes = {scene for trial in trials for scene in trial.scenes}
    truths = NoisyTruths(params, data, renders or data / "studies" / "noise", samples, scenes)
    due = {spp: len(truths.due(spp, sorted(scenes))) for spp in samples}
    lines = [f"{views} views to render with {spp} samples first" for spp, views in due.items()]
    trials = [truths.with_source(trial) for trial in trials]
    carry_out(study, params, folders, trials, dry_run, lines)
