"""`pbrnet study noise`."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.model.options import FOLDER
from pbrnet.model.studies.noise.study import SAMPLES, NoisyTruthStore, noise_study
from pbrnet.model.studies.trials.options import run_or_list, trial_options, views_option
from pbrnet.model.studies.trials.plan import TrialConfig, plan
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.params import Params


@click.command(
    "noise",
    epilog="""\b
Examples:
  pbrnet study noise --dry-run                    list the renderings and trainings
  pbrnet study noise --views 60 --steps 2000      at 4, 16 and 64 samples, raw and denoised
  pbrnet study noise --spp 1 --spp 8 --seeds 3

Needs the scenes and cameras that the dataset was made from. An interrupted study resumes when the
command is run again. The frames in DATA/studies/noise may be deleted once all is trained. Writes
metrics/studies/noise.json and noise.png.""",
)
@click.option(
    "--spp",
    "samples",
    type=click.IntRange(1, 1 << 16),
    multiple=True,
    help="Samples per pixel of a noisy ground truth; repeatable.  [default: 4, 16, 64]",
)
@click.option(
    "--renders",
    type=FOLDER,
    default=None,
    help="Folder of the rendered frames.  [default: DATA/studies/noise]",
)
@views_option
@trial_options()
def command(
    params: Params,
    data: Path,
    models: Path,
    samples: tuple[int, ...],
    renders: Path | None,
    views: tuple[int, ...],
    dry_run: bool,
    seeds: int,
    steps: int | None,
) -> None:
    """Train on noisy ground truth, raw and denoised (Figure 11).

    The training views are rendered again with few samples; tests use the dataset's ground truth.
    """
    folders = Folders.beside(data, models, models)
    samples = tuple(sorted(set(samples or SAMPLES)))
    study = noise_study(samples)
    trials = plan(study, params, folders, TrialConfig(seeds, steps, views))
    scenes = {scene for trial in trials for scene in trial.scenes}
    truths = NoisyTruthStore(params, data, renders or data / "studies" / "noise", samples, scenes)
    due = {spp: len(truths.due(spp, sorted(scenes))) for spp in samples}
    lines = [f"{count} views to render with {spp} samples first" for spp, count in due.items()]
    trials = [truths.with_source(trial) for trial in trials]
    run_or_list(study, params, folders, trials, dry_run, lines)
