"""Run hostile inputs and print outcomes by family.

python -m tests.hostile                        all, in two processes
python -m tests.hostile --sample 100           some, drawn with a fixed seed
python -m tests.hostile --only glb --case 17   one, whose folder is kept
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.hostile.families import FAMILIES, all_cases, sample, sound_cases
from tests.hostile.runner import Runner, table


def main() -> int:
    """Run the cases that the arguments name; returns 1 if one ended as it must not."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.hostile",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", action="append", choices=[one.name for one in FAMILIES])
    parser.add_argument("--case", type=int, action="append", help="number within the family")
    parser.add_argument("--sample", type=int, help="so many cheap ones of all families")
    parser.add_argument("--sound", action="store_true", help="undamaged files instead")
    parser.add_argument("--every", type=int, default=1, help="only each n-th case")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--keep", action="store_true", help="keep all folders")
    parser.add_argument("--work", type=Path, help="folder for the cases")
    parser.add_argument("--json", type=Path, help="file for all outcomes")
    options = parser.parse_args()
    cases = sample(options.sample) if options.sample else all_cases()
    cases = sound_cases() if options.sound else cases
    cases = [
        (family, number)
        for family, number in cases
        if (not options.only or family.name in options.only)
        and (not options.case or number in options.case)
    ][:: options.every]
    work = options.work or Path(tempfile.mkdtemp(prefix="hostile-"))
    outcomes = []
    for one in Runner(work.resolve(), options.processes, options.keep).run(cases):
        outcomes.append(one)
        if one.faults or options.case:
            print(
                f"{one.name}: {'; '.join(one.faults)[:300] or one.code} | "
                f"{' '.join(one.arguments)[:200]} | {one.message}",
                flush=True,
            )
    outcomes.sort(
        key=lambda one: ([family.name for family in FAMILIES].index(one.family), one.number)
    )
    if options.json:
        options.json.write_text(json.dumps([asdict(one) for one in outcomes]), encoding="utf-8")
    print(table(outcomes))
    return any(one.faults for one in outcomes)


if __name__ == "__main__":
    sys.exit(main())
