"""Progress of a long task: a bar on a terminal, plain lines elsewhere, on standard error."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from tqdm import tqdm

from pbrnet.pipeline.terminal import say, visible


class Progress:
    """Counter of finished items, as a context manager.

    On a terminal a bar with rate and remaining time is redrawn in place; elsewhere a line is
    printed at most every `every` seconds and once at the end. `unit` is a plural noun.
    """

    def __init__(self, total: int, label: str, unit: str = "views", every: float = 10.0) -> None:
        self.total, self.label, self.unit, self.every = total, label, unit, every
        self.done = 0
        self._started = self._printed = time.monotonic()
        self._bar = (
            tqdm(total=total, desc=label, unit=unit.removesuffix("s"), file=sys.stderr)
            if sys.stderr.isatty()
            else None
        )

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.close()
        else:
            self._print()

    def advance(self, count: int = 1, note: str = "") -> None:
        """Count `count` more finished items; `note` is shown beside the bar."""
        self.done += count
        if self._bar is not None:
            if note:
                self._bar.set_postfix_str(visible(note), refresh=False)
            self._bar.update(count)
        elif time.monotonic() - self._printed >= self.every:
            self._print(note)

    def write(self, line: str) -> None:
        """Print a line without disturbing the bar."""
        if self._bar is not None:
            self._bar.write(visible(line), file=sys.stderr)
        else:
            say(line, err=True)

    def _print(self, note: str = "") -> None:
        self._printed = time.monotonic()
        seconds = self._printed - self._started
        rate = self.done / seconds if seconds > 0 else 0.0
        left = (
            f", {(self.total - self.done) / rate:.0f} s left" if 0 < self.done < self.total else ""
        )
        text = f"{self.label}: {self.done}/{self.total} {self.unit}, {rate:.2f}/s{left}"
        say(f"{text} {note}".rstrip(), err=True)
