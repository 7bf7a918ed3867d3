"""Command line and progress of the tasks in this folder."""

import argparse
import sys
import time


def arguments(about, **optional):
    """Values of the command line: the folder of a dataset, then these with their defaults."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=form)
    parser.add_argument("FOLDER", help="a dataset, such as examples/sample")
    for name, value in optional.items():
        shown = f"by default {value}" if value else None
        parser.add_argument(name, nargs="?", type=type(value), default=value, help=shown)
    return list(vars(parser.parse_args()).values())


def counted(items, what):
    """The items; every three seconds a line on standard error says how many there were."""
    start = told = time.monotonic()
    for number, item in enumerate(items, 1):
        yield item
        if time.monotonic() > told + 3:
            told = time.monotonic()
            print(f"{number} {what} in {told - start:.0f} s", file=sys.stderr, flush=True)
