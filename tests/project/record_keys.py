"""Record of the code behind each key of `keys.yaml`, so that a change of it asks for a decision.

    python -m tests.project.record_keys [--same KEY ...]

records the code anew. Where it makes other frames, scenes, cameras, rows, exports or weights than
those recorded under the same key, the key must be raised first. Of keys without recorded output,
or with a sample that reaches a part of their code, `--same` says that the rest stays as it was.
"""

import argparse
import ast
import json
import sys
import tomllib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from pbrnet.model.studies.registry import STUDIES
from pbrnet.model.studies.trials.words import COMPARISONS
from pbrnet.pipeline.keys import table
from pbrnet.pipeline.passes.registry import TRACES
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.scenes.files import digest_bytes, write_text
from pbrnet.scenes.models.options import READERS
from pbrnet.scenes.registry import SOURCES
from tests.fixtures import recorded
from tests.fixtures.outputs import OUTPUTS, differing, output
from tests.fixtures.paths import ROOT
from tests.project.imports import import_closure

FILE = Path(__file__).with_name("keys.json")
# Code that decides no byte of what is made, or only through parameters.
PLUMBING = (
    "model/settings.py",
    "pipeline/cameras/settings.py",
    "pipeline/costs",
    "pipeline/farm",
    "pipeline/keys.py",
    "pipeline/params.py",
    "pipeline/passes/settings.py",
    "pipeline/progress.py",
    "pipeline/records.py",
    "pipeline/transport/settings.py",
    "scenes/arrays.py",
    "scenes/errors.py",
)
SAMPLES = ("scenes.imports", "dataset", "exports", "train")  # recorded in part
_NETWORKS = {
    "shading": "networks/pbrnet",
    "composition": "networks/pbrnet",
    "plus": "networks/plus",
    "hybrid": "networks/hybrid",
    "can_own": "baselines/can",
    "pix2pix_own": "baselines/pix2pix",
    "cyclegan_own": "baselines/cyclegan",
}


def _module(reference: str) -> str:
    """The file below `pbrnet` of "pbrnet.package.module:name"."""
    return reference.partition(":")[0].removeprefix("pbrnet.").replace(".", "/") + ".py"


def entries() -> dict[str, tuple[str, ...]]:
    """The modules that make what each key stands for; what they import belongs to it."""
    passes = [name for name in table() if (ROOT / f"pipeline/passes/{name}.py").is_file()]
    networks = [name for name in table() if name.startswith("networks.")]
    names = {name: name.removeprefix("networks.") for name in networks}
    importers = {_module(source.importer): None for source in SOURCES.values()}
    return {
        "assets": ("scenes/sweethome/catalogue/convert.py",),
        "scenes.homes": ("scenes/procedural/home.py",),
        "scenes.imports": (
            "scenes/registry.py",
            "scenes/variants/vary.py",
            *importers,
            *map(_module, READERS.values()),
        ),
        "cameras": ("pipeline/cameras/camera_files.py", "pipeline/cameras/shared_cameras.py"),
        "walks": ("pipeline/cameras/walks.py",),
        "trajectories": ("pipeline/cameras/trajectory_files.py",),
        "render": ("pipeline/render/scene.py",),
        "guides": ("pipeline/transport/guides.py",),
        **{name: (f"pipeline/passes/{name}.py",) for name in passes},
        "groundtruth": ("pipeline/passes/truth.py",),
        "dataset": ("pipeline/dataset/pack.py",),
        "exports": ("pipeline/export/registry.py",),
        "backbone": ("model/training/backbone.py",),
        "train": ("model/training/train.py",),
        **{
            name: (f"model/{_NETWORKS.get(names[name], f'baselines/{names[name]}')}.py",)
            for name in networks
        },
        "evaluate": ("model/evaluation/evaluate.py", "model/evaluation/reference.py"),
        "studies.trials": tuple(f"model/studies/{name}.py" for name in COMPARISONS),
        **{
            f"studies.{name}": (f"model/studies/{name}/study.py",)
            for name in ("photographs", "illumination", "time", "flicker")
        },
        "report": (
            "model/report/page.py",
            *(f"model/studies/{name}/results.py" for name in STUDIES if name not in COMPARISONS),
        ),
    }


def code_of(modules: Iterable[str], left_out: Iterable[str] = ()) -> str:
    """Return a digest of modules, of all that they import and of the tables beside these.

    Comments and docstrings do not count.
    """
    code = ROOT / "pbrnet"
    found = import_closure(
        [code / one for one in modules], ROOT, [code / one for one in (*PLUMBING, *left_out)]
    )
    tables = [table for path in found if (table := path.with_suffix(".yaml")).is_file()]
    content = [repr(yaml.safe_load(table.read_bytes())).encode() for table in tables]
    tables = [table for path in found if (table := path.with_suffix(".toml")).is_file()]
    content += [repr(tomllib.loads(table.read_text("utf-8"))).encode() for table in tables]
    return digest_bytes(*(_normalised(path) for path in found), *content)[:16]


def codes() -> dict[str, str]:
    """Return the digest of the code behind each key."""
    found = entries()
    networks = {one for key, modules in found.items() if "networks." in key for one in modules}
    parts = [f"model/{part.name}" for part in (ROOT / "model").iterdir() if part.name != "studies"]
    # Their fingerprints have the keys of what they render, train and measure with.
    apart = dict.fromkeys(
        ("studies.trials", "studies.illumination", "studies.time", "studies.flicker"),
        ("pipeline", "scenes", *parts),
    )
    left_out = {"train": networks, **apart}
    return {key: code_of(modules, left_out.get(key, ())) for key, modules in found.items()}


@lru_cache(maxsize=1024)
def _normalised(path: Path) -> bytes:
    return repr(list(_words(ast.parse(path.read_bytes())))).encode()


def _words(node: ast.AST) -> Iterator[Any]:
    """Yield what a syntax tree says, in its order, but for docstrings and annotations of calls."""
    yield type(node).__name__
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_comment") and not isinstance(
            node, ast.AnnAssign
        ):
            continue
        parts = value if isinstance(value, list) else [value]
        for part in parts:
            if isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant):
                continue
            if isinstance(part, ast.AST):
                yield from _words(part)
            elif part is not None:
                yield part


def known() -> dict[str, dict[str, Any]]:
    """Return what is recorded of each key: its number, the digest of its code, its output."""
    found: dict[str, dict[str, Any]] = json.loads(FILE.read_text())
    return found


def of(parts: list[str]) -> str:
    """Return the names of the parts of an output that differ, in brackets."""
    return f" ({', '.join(parts)})" if any(parts) else ""


def faults(changed: set[str], raised: set[str], same: set[str]) -> list[str]:
    """Say which keys with changed code must be raised, or need a decision."""
    pixels = {"render"}.union(*(names for trace in TRACES for names in trace.keys.values()))
    wrong = [
        f"{name}: another output under the same key: raise it in keys.yaml{of(parts)}"
        for name in OUTPUTS
        if name in changed and (parts := differing(known()[name]["output"], output(name)))
    ]
    if changed & pixels and "render" not in raised:
        found, before = recorded.frames(), recorded.known()
        under = [kind for kind in before if not raised & {*recorded.keys_of(kind)}]
        wrong += filter(None, (recorded.fault(kind, before[kind], found[kind]) for kind in under))
    undecided = sorted(changed - pixels - {*OUTPUTS} | changed & {*SAMPLES})
    if set(undecided) - same:
        wrong.append(
            "changed code: raise in keys.yaml what now makes other things; then\n"
            f"python -m tests.project.record_keys --same {' '.join(undecided)}"
        )
    return wrong


def main(words: list[str] | None = None) -> int:
    """Record keys and codes; returns 1 and changes nothing where a decision is missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("--same", nargs="+", default=[], choices=list(table()), metavar="KEY")
    same = set(parser.parse_args(words).same)
    before = known() if FILE.exists() else {}
    now, numbers = codes(), table()
    raised = {name for name in now if before.get(name, {}).get("key") != numbers[name]}
    changed = {name for name in now if name not in raised and before[name]["code"] != now[name]}
    set_variant("auto")
    wrong = faults(changed, raised, same)
    if wrong:
        sys.stderr.write("\n".join([*wrong, ""]))
        return 1
    recorded.record(everything="render" in raised)
    rows = {}
    for name, code in now.items():
        rows[name] = before.get(name, {}) | {"key": numbers[name], "code": code}
        if name in OUTPUTS and name in raised:
            rows[name]["output"] = output(name)
    lines = (f" {json.dumps(name)}: {json.dumps(row)}" for name, row in rows.items())
    write_text(FILE, "{\n" + ",\n".join(lines) + "\n}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
