"""Generated parts of the documentation: tables and sentences of measured figures.

`make docs` runs this. It renews what stands between `<!-- generated: NAME -->` and `<!-- end -->`:

    part of                      from                              which this writes
    results.md, README.md        metrics/reference.json, docs/data  pbrnet study all --docs docs
      the paper's light          docs/data/pbrs, pbrs-large        the commands stated there
      time budgets               docs/data/budgets.json            make bench ONLY=budgets
      time of the quick start    docs/data/quick-start.json        this, with --quick-start
    photographs.md, README.md    metrics/photographs.json          pbrnet study photographs
    benchmark.md, cluster.md     docs/data/{benchmark,plan}.json   make records
    scenes.md                    docs/data/realism.json            pbrnet inspect --realism

With `--check` nothing is written, and the exit code is 1 if a file is not up to date.

After a quick start, `--quick-start SECONDS` records its figures: the seconds that `make repro`
took, and the evaluation in `metrics/`.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from pathlib import Path
from typing import Any

from study_tables import (
    first_picture_table,
    photographs_table,
    rival_table,
    rival_words,
    study_tables,
    tried_table,
)

from pbrnet.model.benchmark.pictures import Task
from pbrnet.model.benchmark.score import METRICS as METRICS_OF_TASK
from pbrnet.model.titles import METHOD_TITLES as TITLES
from pbrnet.scenes.installation import IMPORT_FOLDER as ROOT

METRICS = {"ssim": ("SSIM", 3), "psnr": ("PSNR, dB", 1), "flip": ("FLIP (lower is better)", 3)}
QUICK_START = ROOT / "docs" / "data" / "quick-start.json"
BENCHMARK = ROOT / "docs" / "data" / "benchmark.json"
PLAN = ROOT / "docs" / "data" / "plan.json"
REALISM = ROOT / "docs" / "data" / "realism.json"
BUDGETS = ROOT / "docs" / "data" / "budgets.json"
SHORT_MEASURES = ("absrel_scaled", "normal_mean", "miou13")  # columns of the README
SHORT = ("pbrnet", "unet", "denoised", "radiosity", "plus", "hybrid")  # rows of the README


def quick_start_time(found: dict[str, Any]) -> str:
    """Sentence on the time that the first command takes."""
    minutes = math.ceil(found["repro_seconds"] / 60)
    return (
        f"On two cores `make repro` takes up to {minutes} minutes, the installation of the "
        "environment included."
    )


def reference_methods(found: dict[str, Any]) -> str:
    """Table of methods of the reference run, with intervals over scenes."""
    return _method_table(found["methods"], found["intervals"])


def reference_short(found: dict[str, Any]) -> str:
    """Table of the README: the methods that matter most, without intervals."""
    return _method_table({name: found["methods"][name] for name in SHORT}, {})


def reference_differences(found: dict[str, Any]) -> str:
    """Table of view-by-view differences of the reference run."""
    rows = [["difference", *(title for title, _ in METRICS.values()), "views improved, by FLIP"]]
    for pair, row in found["differences"].items():
        first, _, second = pair.partition(" - ")
        cells = []
        for metric, (_, digits) in METRICS.items():
            digits = {"psnr": 2}.get(metric, digits)
            one = row[metric]
            cells.append(
                f"{one['mean']:+.{digits}f} ({one['low']:+.{digits}f} to {one['high']:+.{digits}f})"
            )
        rows.append([f"`{first}` - `{second}`", *cells, f"{row['better']} of {found['views']}"])
    return _table(rows)


def _method_table(methods: dict[str, Any], intervals: dict[str, Any]) -> str:
    timed = any("seconds" in row for row in methods.values())
    rows = [["method", *(title for title, _ in METRICS.values()), *["seconds per image"][:timed]]]
    for name in sorted(methods, key=list(TITLES).index):
        row, cells = methods[name], []
        for metric, (_, digits) in METRICS.items():
            text = f"{row[metric]:.{digits}f}"
            if name in intervals:
                low, high = intervals[name][metric]
                text += f" ({low:.{digits}f} to {high:.{digits}f})"
            cells.append(text)
        if timed:
            cells.append("" if row["seconds"] is None else f"{row['seconds']:.3f}")
        rows.append([f"{TITLES[name]}, `{name}`", *cells])
    return _table(rows)


def benchmark_table(found: dict[str, Any], task: Task) -> str:
    """Table of this project's submissions to a task of the open benchmark."""
    rows = [["method", *METRICS_OF_TASK[task], "CPU seconds per view"]]
    for one in found["tasks"][task]:
        cells = []
        for metric, digits in METRICS_OF_TASK[task].items():
            value = one["metrics"][metric]
            text = "" if value is None else f"{value['mean']:.{digits}f}"
            if value is not None and value["low"] is not None:
                text += f" ({value['low']:.{digits}f} to {value['high']:.{digits}f})"
            cells.append(text)
        seconds = f"{one['seconds']:.2g}" if one["seconds"] >= 0.001 else "under 0.001"
        rows.append([f"`{one['name']}`: {one['about']['method']}", *cells, seconds])
    return _table(rows)


def budget_parts() -> str:
    """Words, tables and plots of the time budgets."""
    if not BUDGETS.is_file():
        return "Not measured for this version yet: `make bench ONLY=budgets`."
    found = json.loads(BUDGETS.read_text())
    plot = "![Lowest FLIP within each time budget, by kind of scene and size](images/budgets.png)"
    sheet = "![Reference and the best image of each renderer within a second](images/budgets.jpg)"
    parts = [
        rival_words(found),
        _table(rival_table(found)),
        plot,
        sheet,
        "What the rivals' settings were chosen from, FLIP by kind of scene and budget:",
        _table(tried_table(found)),
        "Until the first picture, from the start of a process, 160x120:",
        _table(first_picture_table(found)),
    ]
    return "\n\n".join(parts)


def realism_table(found: dict[str, Any]) -> str:
    """Table of figures of rendered views beside those of photographs, and how they were made."""
    width, height = found["size"]
    rows = [["measure per view", "5 %", "median", "95 %", "photographs"]]
    for one in found["figures"]:
        known = one["photographs"].replace("no published figure found", "")
        rows.append([one["figure"], *(f"{one[q]:g}" for q in ("5 %", "median", "95 %")), known])
    classes = ", ".join(f"{one['class']} {one['share']}" for one in found["classes"][:12])
    about = (
        f"{found['views']} views of {found['homes']} homes, {width}x{height}, "
        f"{found['spp']} samples, denoised:"
    )
    return f"{about}\n\n{_table(rows)}\n\nPixels by NYU40 class: {classes}."


def photographs_part(found: dict[str, Any]) -> str:
    """Sentence and table of the study of photographs."""
    return (
        f"{found['pictures']} photographs of {found['runs']} runs, true normals in "
        f"{found['normal_coverage']:.0%} of their pixels; {found['steps']} steps of "
        f"{found['batch']} crops, seed {found['seed']}:\n\n{_table(photographs_table(found))}"
    )


def plan_table(found: dict[str, Any]) -> str:
    """Table of the forecast of a large release, by stage."""
    rows = [["stage", "core-hours", "core-seconds per view"]]
    stages = {**found["stages"], "total": found["core_hours"]}
    for stage, hours in stages.items():
        rows.append([stage, f"{hours:,.0f}", f"{3600 * hours / found['views']:.2f}"])
    error = found["relative_error"]
    within = "unknown" if error is None else f"{error:.0%}"
    return (
        f"`{found['recipe']}`: {found['views']:,} views of {found['scenes']:,} homes, measured on "
        f"{found['machine']}. Frames: {found['frame_bytes'] / 1e12:.1f} TB. In 95 % of random "
        f"splits, half of the measured homes predict the other half within {within}."
        f"\n\n{_table(rows)}"
    )


def _table(rows: list[list[str]]) -> str:
    head, *body = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])


def filled(path: Path, parts: dict[str, str]) -> str:
    """Text of a file with its generated parts replaced."""
    text = path.read_text()
    for name, part in parts.items():
        text, count = re.subn(
            rf"(<!-- generated: {name} -->\n).*?(<!-- end -->)",
            lambda found, part=part: f"{found[1]}{part}\n{found[2]}",
            text,
            flags=re.DOTALL,
        )
        if count != 1:
            raise SystemExit(f"{path}: {count} places for {name}, 1 expected")
    return text


def record_quick_start(repro: float) -> None:
    """Write `docs/data/quick-start.json` from the evaluation in `metrics/` and the duration."""
    found = json.loads((ROOT / "metrics" / "evaluation.json").read_text())
    methods = {
        name: {metric: round(row[metric]["mean"], 4) for metric in METRICS}
        | {"seconds": (seconds := row.get("seconds")) and round(seconds, 4)}
        for name, row in found["methods"].items()
    }
    record = {
        "repro_seconds": round(repro),
        "views": found["views"],
        "scenes": found["scenes"],
        "methods": methods,
    }
    QUICK_START.write_text(json.dumps(record, indent=1) + "\n")


def main() -> int:
    """Write the generated files, or compare them with `--check`."""
    parser = argparse.ArgumentParser(description="Make the generated parts of the documentation.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if outdated")
    parser.add_argument(
        "--quick-start", type=float, metavar="SECONDS", help="duration of `make repro` to record"
    )
    options = parser.parse_args()
    check = options.check
    if options.quick_start:
        record_quick_start(options.quick_start)
    quick = json.loads(QUICK_START.read_text())
    reference = json.loads((ROOT / "metrics" / "reference.json").read_text())
    photographs = json.loads((ROOT / "metrics" / "photographs.json").read_text())
    tables = study_tables(ROOT / "docs" / "data")
    for run in ("pbrs", "pbrs-large"):
        tables |= study_tables(ROOT / "docs" / "data" / run, run)
    readme, results = ROOT / "README.md", ROOT / "docs" / "results.md"
    wanted = {
        readme: filled(
            readme,
            {
                "quick-start-time": quick_start_time(quick),
                "photographs-short": _table(photographs_table(photographs, SHORT_MEASURES)),
                "reference-short": reference_short(reference),
            },
        ).encode(),
        results: filled(
            results,
            {
                "reference-methods": reference_methods(reference),
                "reference-differences": reference_differences(reference),
                **{name: _table(rows) for name, rows in tables.items()},
                "budgets": budget_parts(),
            },
        ).encode(),
    }
    missing = "Not measured for this version yet: `make records`."
    parts = dict.fromkeys((f"benchmark-{task}" for task in METRICS_OF_TASK), missing)
    views = missing
    if BENCHMARK.is_file():
        found = json.loads(BENCHMARK.read_text())
        parts = {f"benchmark-{task}": benchmark_table(found, task) for task in METRICS_OF_TASK}
        views = f"{found['views']} views of {found['scenes']} homes, version {found['version']}."
    page = ROOT / "docs" / "benchmark.md"
    wanted[page] = filled(page, {"benchmark-views": views, **parts}).encode()
    plan = plan_table(json.loads(PLAN.read_text())) if PLAN.is_file() else missing
    page = ROOT / "docs" / "cluster.md"
    wanted[page] = filled(page, {"plan": plan}).encode()
    page = ROOT / "docs" / "scenes.md"
    realism = realism_table(json.loads(REALISM.read_text()))
    wanted[page] = filled(page, {"realism": realism}).encode()
    page = ROOT / "docs" / "photographs.md"
    wanted[page] = filled(page, {"photographs": photographs_part(photographs)}).encode()
    stale = [
        path for path, data in wanted.items() if not path.is_file() or path.read_bytes() != data
    ]
    for path in stale:
        print(f"{path.relative_to(ROOT)}: {'out of date, run make docs' if check else 'written'}")
        if not check:
            path.write_bytes(wanted[path])
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
