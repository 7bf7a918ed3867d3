r"""Lines for the user: the only place that prints. Text of strangers cannot steer the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable


def visible(text: object) -> str:
    r"""Return text as one line that shows every sign, control characters as Python writes them.

    A line break becomes `\n`, a bell `\x07`, the beginning of an escape sequence `\x1b`.
    """
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in str(text)
    )


def lines_of(lines: Iterable[object]) -> str:
    """Return lines as one text, each made `visible`: only its own line breaks begin a line."""
    return "\n".join(map(visible, lines))


def say(*lines: object, err: bool = False) -> None:
    """Print lines, each made `visible`, with `err` on standard error.

    So a name in a file from outside neither forges a line, nor hides one, nor rings.
    """
    print(lines_of(lines or ("",)), file=sys.stderr if err else sys.stdout, flush=True)
