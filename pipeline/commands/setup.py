"""`pbrnet preset` and `pbrnet doctor`: parameters in place, and what this machine has."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

import click
import drjit
import psutil
import torch

from pipeline.params import Baseline, load_params
from pipeline.versions import PACKED
from scenes.errors import ParameterError
from scenes.files import write_text

NETWORKS = ("shading", "composition", *get_args(Baseline))


@click.command(
    epilog="""\b
Examples:
  pbrnet preset                list the presets
  pbrnet preset quick          ten minutes on two cores
  pbrnet preset paper --force  480x360 at the paper's scale; a cluster's work"""
)
@click.argument("name", required=False)
@click.option("--force", is_flag=True, help="Overwrite a changed parameter file.")
@click.option(
    "--presets",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("params"),
    show_default=True,
    help="Folder of presets.",
)
@click.option(
    "--params",
    "target",
    type=click.Path(path_type=Path),
    default=Path("params.yaml"),
    show_default=True,
    help="Parameter file to write.",
)
@click.option("--seed", type=click.IntRange(0), default=None, help="Root seed to write into it.")
def preset(name: str | None, force: bool, presets: Path, target: Path, seed: int | None) -> None:
    """Put the parameter preset NAME in place of params.yaml; without NAME, list them."""
    available = {path.stem: path for path in sorted(presets.glob("*.yaml"))}
    if not available:
        raise ParameterError(f"{presets}: no presets there; run this in the project's folder")
    if name is None:
        for label, path in available.items():
            first = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
            click.echo(f"{label:12} {first}")
        return
    if name not in available:
        raise ParameterError(f"{name}: no such preset (there are: {', '.join(available)})")
    text = available[name].read_text(encoding="utf-8")
    if seed is not None:
        lines = text.splitlines(keepends=True)
        text = "".join(f"seed: {seed}\n" if row.startswith("seed:") else row for row in lines)
    known = [path.read_text(encoding="utf-8") for path in available.values()]
    if target.exists() and not force:
        current = target.read_text(encoding="utf-8")
        if current != text and current not in known:
            raise ParameterError(
                f"{target}: has changes that no preset holds; "
                "keep a copy, or overwrite it with --force"
            )
    load_params(available[name])
    write_text(target, text)
    click.echo(f"{target} now holds the preset {name!r}; go on with: dvc repro")


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report; `advice` is empty where nothing needs doing."""

    topic: str
    state: str
    ok: bool
    advice: str = ""


@click.command(
    epilog="""\b
Examples:
  pbrnet doctor
  pbrnet doctor --json | jq .

Exit code 4 if something needed is missing; what is only slower or optional does not count."""
)
@click.option("--json", "as_json", is_flag=True, help="Print machine-readable JSON.")
@click.option("--seed", type=int, default=None, hidden=True)
def doctor(as_json: bool, seed: int | None) -> None:
    """Say what this machine has: variant, LLVM, GPU, threads, memory, weights, catalogues."""
    findings = examine()
    if as_json:
        click.echo(json.dumps([asdict(finding) for finding in findings], indent=1))
    else:
        for finding in findings:
            mark = (
                click.style("ok  ", fg="green") if finding.ok else click.style("look", fg="yellow")
            )
            click.echo(f"{mark} {finding.topic:12} {finding.state}")
            if finding.advice:
                click.echo(f"{'':17} {finding.advice}")
    if any(finding.topic == "packages" and not finding.ok for finding in findings):
        sys.exit(4)


def examine() -> list[Finding]:
    """Everything the doctor reports, in a fixed order."""
    cpus = len(os.sched_getaffinity(0))
    memory = psutil.virtual_memory()
    disk = shutil.disk_usage(Path.cwd())
    return [
        Finding(
            "system",
            f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
            True,
        ),
        Finding("threads", f"{cpus} allowed of {os.cpu_count()}", True),
        Finding(
            "memory",
            f"{memory.available / 2**30:.1f} of {memory.total / 2**30:.1f} GiB free",
            memory.total >= 7 * 2**30,
            "" if memory.total >= 7 * 2**30 else "8 GiB are assumed; use fewer --workers",
        ),
        Finding(
            "disk",
            f"{disk.free / 2**30:.1f} GiB free here",
            disk.free >= 4 * 2**30,
            "" if disk.free >= 4 * 2**30 else "the quick start needs about 4 GiB",
        ),
        _packages(),
        _llvm(),
        _cuda(),
        _vgg(),
        _trained(),
        _pretrained(),
        _catalogues(),
    ]


def _packages() -> Finding:
    names = ("mitsuba", "drjit", "torch", "dask", "pyarrow", "OpenEXR", "dvc")
    found, missing = [], []
    for name in names:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return Finding("packages", f"missing: {', '.join(missing)}", False, "run: make repro")
    return Finding("packages", ", ".join(found), True)


def _llvm() -> Finding:
    if drjit.has_backend(drjit.JitBackend.LLVM):
        return Finding("LLVM", "found; rendering in llvm_ad_rgb", True)
    return Finding(
        "LLVM",
        "not found; rendering in scalar_rgb, about three times slower",
        False,
        "apt-get install libllvm15, or set DRJIT_LIBLLVM_PATH to a libLLVM.so",
    )


def _cuda() -> Finding:
    render = drjit.has_backend(drjit.JitBackend.CUDA)
    train = torch.cuda.is_available()
    if render or train:
        words = [word for word, has in (("rendering", render), ("training", train)) if has]
        return Finding("GPU", f"CUDA for {' and '.join(words)}", True)
    return Finding("GPU", "none; not needed", True)


def _vgg() -> Finding:
    cache = Path(torch.hub.get_dir()) / "checkpoints"
    weights = sorted(cache.glob("vgg19-*.pth"))
    if weights:
        return Finding("VGG-19", str(weights[0]), True)
    return Finding(
        "VGG-19",
        "no weights in torch's cache; the packaged ImageNet network stands in",
        True,
        "to use VGG-19 as the paper does, set backbone.weights or backbone.download",
    )


def _trained() -> Finding:
    present = _networks_in(Path("models"))
    if present:
        return Finding("models", f"trained: {', '.join(present)}", True)
    return Finding("models", "none trained here yet", True, "they come with: dvc repro")


def _pretrained() -> Finding:
    present = _networks_in(PACKED)
    if present:
        return Finding("pretrained", f"{', '.join(present)}, in {PACKED}", True)
    return Finding(
        "pretrained",
        f"no networks in {PACKED}",
        True,
        "not needed; trained ones are packed with: pbrnet pretrained",
    )


def _networks_in(folder: Path) -> list[str]:
    return [name for name in NETWORKS if (folder / f"{name}.safetensors").is_file()]


def _catalogues() -> Finding:
    found = sorted(Path("data/assets").glob("*/"))
    if found:
        return Finding("catalogues", ", ".join(path.name for path in found), True)
    return Finding("catalogues", "none; homes use the built-in furniture", True)
