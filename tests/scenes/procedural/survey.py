"""Survey of many procedural homes: makes each and checks it, in several processes, resumable.

    python -m tests.scenes.procedural.survey --homes 1000 --processes 2 --out build/homes.jsonl

Each line of the file is the outcome of one seed; a second run continues where the first ended, and
begins anew where the generator changed. Faults are printed as they are found, then a summary.
"""

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from tests.project.record_keys import code_of
from tests.scenes.procedural import test_homes

RULES: tuple[Callable[[list[test_homes.Home]], None], ...] = (
    test_homes.test_meshes_are_sound,
    test_homes.test_rooms_are_furnished,
    test_homes.test_nothing_intersects,
    test_homes.test_furniture_leaves_room_for_skirting,
    test_homes.test_nothing_floats,
    test_homes.test_rooms_can_be_walked,
    test_homes.test_portals_lie_in_outer_walls_and_face_outdoors,
)
LIGHT_RULE = test_homes.test_light_enters_a_home_through_portals_only


def outcome(seed: int, light: bool) -> dict[str, Any]:
    """Make the home of a seed and check it; `light` traces rays from its rooms, too."""
    begun = time.process_time()
    found: dict[str, Any] = {"seed": seed, "faults": []}
    with tempfile.TemporaryDirectory(prefix="pbrnet-survey-") as folder:
        try:
            home = test_homes.home_of(Path(folder), seed)
        except Exception as error:
            found["faults"].append(f"not made: {type(error).__name__}: {error}")
            return found
        found["made_s"] = round(time.process_time() - begun, 2)
        found["style"] = home.scene.source["style"]
        found["rooms"] = [room.name for room in home.scene.rooms]
        found["objects"] = len(home.scene.objects)
        found["triangles"] = sum(
            len(home.mesh(shape).faces) for item in home.scene.objects for shape in item.shapes
        )
        for rule in (*RULES, *((LIGHT_RULE,) if light else ())):
            try:
                rule([home])
            except (Exception, test_homes.pytest.fail.Exception) as error:
                text = " ".join(str(error).split())[:300]
                found["faults"].append(f"{rule.__name__}: {type(error).__name__}: {text}")
    found["checked_s"] = round(time.process_time() - begun, 2)
    found["peak_MiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return found


def survey(
    seeds: Iterable[int], out: Path, processes: int, light: bool = False
) -> list[dict[str, Any]]:
    """Check the homes of `seeds`, keep each outcome in the file `out`, return all of them.

    Seeds whose outcome of this revision is in the file are not checked again.
    """
    revision = code_of(["scenes/procedural/home.py"])
    kept: dict[int, dict[str, Any]] = {}
    if out.is_file():
        for line in out.read_text(encoding="utf-8").splitlines():
            try:
                one = json.loads(line)
            except ValueError:  # the end of a file whose writer was stopped
                continue
            if one.get("revision") == revision and one.get("light") == light:
                kept[one["seed"]] = one
    wanted = list(seeds)
    missing = [seed for seed in wanted if seed not in kept]
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("a", encoding="utf-8") as file:

        def keep(found: dict[str, Any]) -> None:
            kept[found["seed"]] = found = {**found, "revision": revision, "light": light}
            file.write("\n" * (file.tell() > 0) + json.dumps(found))
            file.flush()
            for fault in found["faults"]:
                print(f"seed {found['seed']}: {fault}", flush=True)

        if processes == 1:
            for seed in missing:
                keep(outcome(seed, light))
        else:
            with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                for done in as_completed([pool.submit(outcome, seed, light) for seed in missing]):
                    keep(done.result())
    return [kept[seed] for seed in wanted]


def summary(found: list[dict[str, Any]]) -> str:
    """Return homes, faults, and medians and maxima of cost."""
    faulty = [one for one in found if one["faults"]]
    lines = [f"{len(found)} homes, {len(faulty)} with faults"]
    for name, unit in (("made_s", "s"), ("triangles", ""), ("peak_MiB", "MiB"), ("objects", "")):
        values = [one[name] for one in found if name in one]
        if values:
            lines.append(f"{name}: median {np.median(values):,.1f}, most {max(values):,} {unit}")
    return "\n".join(lines)


def main() -> int:
    """Run a survey from the command line; returns 1 if there are faults."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--homes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--light", action="store_true", help="trace rays for gaps, too")
    parser.add_argument("--out", type=Path, default=Path("build/homes.jsonl"))
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    seeds = range(options.first, options.first + options.homes)
    found = survey(seeds, options.out, options.processes, options.light)
    print(summary(found))
    return int(any(one["faults"] for one in found))


if __name__ == "__main__":
    sys.exit(main())
