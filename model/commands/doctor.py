"""`pbrnet doctor`: what this machine has and lacks."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import shutil
import sys
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import click
import psutil
import torch

from pbrnet.model.settings import Baseline
from pbrnet.pipeline.commands.options import idle_seed_option, json_option
from pbrnet.pipeline.farm.versions import PACKED
from pbrnet.pipeline.render import variants
from pbrnet.pipeline.terminal import say


@dataclass(frozen=True)
class Extra:
    """An optional part of pbrnet: its Python modules, and the package that brings them."""

    topic: str
    modules: tuple[str, ...]
    package: str  # for pip
    purpose: str
    note: str = ""
    program: str = ""  # on the PATH, which does instead of the modules
    variable: str = ""  # environment variable that names such a program


EXTRAS = (
    Extra("usd", ("pxr",), "pbrnet[usd]", "import of .usd, .usda, .usdc and .usdz"),
    Extra("ifc", ("ifcopenshell",), "pbrnet[ifc]", "import of .ifc"),
    Extra(
        "blender",
        ("bpy",),
        "pbrnet[blender]",
        "import of .blend and .fbx",
        "with Python below 3.13 install Blender itself, on the PATH or named in PBRNET_BLENDER",
        "blender",
        "PBRNET_BLENDER",
    ),
    Extra("onnx", ("onnx", "onnxruntime", "onnxscript"), "pbrnet[onnx]", "pbrnet export"),
    Extra(
        "export",
        ("h5py", "pycocotools", "fast_simplification"),
        "pbrnet[export]",
        "pbrnet export-data to HDF5 and COCO",
    ),
    Extra(
        "formats",
        ("DracoPy", "meshopt", "opengl_basisu", "collada", "javaobj"),
        "pbrnet[formats]",
        "glTF with Draco, meshopt or KTX2; .dae; .sh3d before version 5.3",
    ),
    Extra("dvc", ("dvc",), "pbrnet[dvc]", "dvc repro; without it: pbrnet run"),
)
NETWORKS = ("shading", "composition", *get_args(Baseline))


@dataclass(frozen=True)
class Finding:
    """One line of the report of `pbrnet doctor`; `advice` is empty if there is nothing to do."""

    topic: str
    state: str
    ok: bool
    advice: str = ""


@click.command(
    epilog="""\b
Examples:
  pbrnet doctor
  pbrnet doctor --json | jq .

Exit code 4 if a required package is missing; slower or optional parts do not count."""
)
@json_option
@idle_seed_option
def doctor(as_json: bool) -> None:
    """Report this machine's CPUs, memory, packages, LLVM, GPU, networks and catalogues."""
    findings = examine()
    if as_json:
        say(*json.dumps([asdict(finding) for finding in findings], indent=1).split("\n"))
    else:
        for finding in findings:
            say(f"{'ok' if finding.ok else 'warn':4} {finding.topic:12} {finding.state}")
            if finding.advice:
                say(f"{'':17} {finding.advice}")
    if any(finding.topic == "packages" and not finding.ok for finding in findings):
        sys.exit(4)


def examine() -> list[Finding]:
    """Return all findings of `pbrnet doctor`, in a fixed order."""
    cpus = len(os.sched_getaffinity(0))
    memory = psutil.virtual_memory()
    disk = shutil.disk_usage(Path.cwd())
    return [
        Finding(
            "system",
            f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
            True,
        ),
        Finding("threads", f"{cpus} of {os.cpu_count()} CPUs allowed", True),
        Finding(
            "memory",
            f"{memory.available / 2**30:.1f} of {memory.total / 2**30:.1f} GiB free",
            memory.total >= 7 * 2**30,
            ""
            if memory.total >= 7 * 2**30
            else "the default number of workers requires 8 GiB; use fewer --workers",
        ),
        Finding(
            "disk",
            f"{disk.free / 2**30:.1f} GiB free in {Path.cwd()}",
            disk.free >= 4 * 2**30,
            "" if disk.free >= 4 * 2**30 else "the quick start requires about 4 GiB",
        ),
        _packages(),
        *_extras(),
        _llvm(),
        _cuda(),
        _vgg(),
        _trained(),
        _pretrained(),
        _catalogues(),
    ]


def _packages() -> Finding:
    names = ("mitsuba", "drjit", "torch", "dask", "pyarrow", "OpenEXR")
    found, missing = [], []
    for name in names:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return Finding(
            "packages", f"missing: {', '.join(missing)}", False, "install them with: make env"
        )
    return Finding("packages", ", ".join(found), True)


def _extras() -> list[Finding]:
    """Findings on the optional dependencies and on the decoders that web models need."""
    found = []
    for extra in EXTRAS:
        missing = [module for module in extra.modules if find_spec(module) is None]
        program = os.environ.get(extra.variable) or shutil.which(extra.program or os.devnull)
        if missing and program:
            found.append(Finding(extra.topic, f"installed, {program}: {extra.purpose}", True))
            continue
        state = "installed" if not missing else f"not installed ({', '.join(missing)})"
        advice = f"pip install {extra.package!r}" if missing else ""
        if missing and extra.note:
            advice += f"; {extra.note}"
        found.append(Finding(extra.topic, f"{state}: {extra.purpose}", True, advice))
    return found


def _llvm() -> Finding:
    if variants.works("llvm_ad_rgb"):
        return Finding("LLVM", f"found; the variant is {variants.best_variant()}", True)
    slower = ", about three times slower" if variants.best_variant() == "scalar_rgb" else ""
    return Finding(
        "LLVM",
        f"not found; the variant is {variants.best_variant()}{slower}",
        False,
        "install libllvm15 (apt-get), or set DRJIT_LIBLLVM_PATH to a libLLVM.so",
    )


def _cuda() -> Finding:
    """Finding on GPUs for rendering and training; one that traces no ray is a warning."""
    cards, train = variants.cards(), torch.cuda.is_available()
    uses = [use for use, works in (("rendering", cards.usable), ("training", train)) if works]
    if not (uses or cards.memory or cards.problem):
        return Finding("GPU", "none (optional)", True)
    each = zip(cards.names, cards.memory, strict=True)
    named = ", ".join(f"{name} ({size / 2**30:.0f} GiB)" for name, size in each) or "CUDA"
    advice = [cards.problem] if cards.problem else []
    if not train:
        advice.append("training runs on the CPU: install a CUDA build of torch")
    state = f"{named}: {' and '.join(uses) or 'not used'}"
    return Finding("GPU", state, not cards.problem, "; ".join(advice))


def _vgg() -> Finding:
    cache = Path(torch.hub.get_dir()) / "checkpoints"
    weights = sorted(cache.glob("vgg19-*.pth"))
    if weights:
        return Finding("VGG-19", str(weights[0]), True)
    return Finding(
        "VGG-19",
        "no weights in torch's cache; the packaged EfficientNet-Lite0 is used instead",
        True,
        "for VGG-19 as in the paper, set backbone.weights or backbone.download",
    )


def _trained() -> Finding:
    present = _networks_in(Path("models"))
    if present:
        return Finding("models", f"trained: {', '.join(present)}", True)
    return Finding("models", "none trained yet", True, "train them with: dvc repro")


def _pretrained() -> Finding:
    present = _networks_in(PACKED)
    if present:
        return Finding("pretrained", f"{', '.join(present)}, in {PACKED}", True)
    return Finding(
        "pretrained",
        f"no networks in {PACKED}",
        True,
        "optional; pack trained networks with: pbrnet pretrained",
    )


def _networks_in(folder: Path) -> list[str]:
    return [name for name in NETWORKS if (folder / f"{name}.safetensors").is_file()]


def _catalogues() -> Finding:
    found = sorted(Path("data/assets").glob("*/"))
    if found:
        return Finding("catalogues", ", ".join(path.name for path in found), True)
    return Finding("catalogues", "none; homes use the built-in furniture", True)
