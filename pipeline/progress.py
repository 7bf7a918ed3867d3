"""Progress of a long task: a bar on a terminal, plain lines elsewhere, on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping
from statistics import fmean
from types import TracebackType

from tqdm import tqdm

from pbrnet.pipeline.terminal import counted, say, visible

FIRST, EVERY = 3.0, 10.0  # seconds until the first line, and between lines
COMPILING = "compiling or loading kernels"  # a note for what renders
_TRUSTED = 0.2  # share of the work after which the forecast counts no more
_FEW = 3  # items that tell how long the others take


class Pace:
    """Seconds left of items of several sorts, by the seconds that others of each sort took.

    `items` counts the items of each sort, `workers` make them side by side. The first item of a
    worker, which compiles kernels, counts until there are others. While none of a sort has ended,
    its items take as long as others for their `sizes`.
    """

    def __init__(
        self, items: Mapping[str, int], sizes: Mapping[str, float], workers: int = 1
    ) -> None:
        self.left, self.sizes, self.workers = dict(items), sizes, workers
        self._needed = {sort: min(_FEW, count) for sort, count in items.items()}
        self._spent: dict[str, list[float]] = {sort: [] for sort in items}
        self._latest = time.monotonic()

    def ended(self, sort: str, seconds: float) -> None:
        """Count an item that took so many seconds. Any thread may call it."""
        self._spent[sort].append(seconds)
        self.dropped(sort)

    def dropped(self, sort: str) -> None:
        """Count an item that is not made."""
        self.left[sort] = max(0, self.left[sort] - 1)
        self._latest = time.monotonic()

    @property
    def is_rough(self) -> bool:
        """True until a few items of each sort that is left have ended."""
        due = [sort for sort, count in self.left.items() if count]
        return any(len(self._spent[sort]) < self._needed[sort] for sort in due)

    @property
    def is_new(self) -> bool:
        """True while no item of a sort that is left has ended."""
        return any(count and not self._spent[sort] for sort, count in self.left.items())

    def seconds_left(self) -> float | None:
        """Return the estimate; None until an item has ended, and when a rough estimate is over."""
        means = {
            sort: fmean(spent[self.workers :] or spent)
            for sort, spent in self._spent.items()
            if spent
        }
        if not means:
            return None
        rate = fmean(mean / self.sizes[sort] for sort, mean in means.items())
        spent = sum(n * means.get(sort, rate * self.sizes[sort]) for sort, n in self.left.items())
        left = spent / self.workers - (time.monotonic() - self._latest)
        return None if left <= 0 and self.is_rough else max(0.0, left)


class Progress:
    """Counter of finished items, as a context manager.

    On a terminal a bar with rate and remaining time is redrawn in place; elsewhere a line is
    printed after `FIRST` seconds, then every `EVERY` seconds, and once at the end, whether or not
    items are finished meanwhile. `unit` is a plural noun. `kept` of the `total` items were there
    before. `expected` is the forecast of the task's seconds; without one, `pace` estimates the time
    left if it is set, else the time that a few items took after the first. `note` is shown beside
    the numbers until an item brings another, and while no item of a sort of `pace` has ended.
    """

    def __init__(
        self,
        total: int,
        label: str,
        unit: str = "views",
        kept: int = 0,
        expected: float | None = None,
        note: str = "",
    ) -> None:
        self.total, self.label, self.unit = total, label, unit
        self.kept, self.expected = kept, expected
        self.done = kept
        self.pace: Pace | None = None
        self._first: tuple[float, int] | None = None  # when some were finished, and how many
        self._note = self._new = note  # the latest, and that of items of a new sort
        self._ahead: dict[str, int] = {}  # finished on workers, in batches that are not back yet
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._started = time.monotonic()
        self._printed = self._started + FIRST - EVERY
        self._bar = (
            tqdm(
                total=total, initial=kept, desc=label, unit=unit.removesuffix("s"), file=sys.stderr
            )
            if sys.stderr.isatty()
            else None
        )
        if self._bar is not None:
            self._bar.set_postfix_str(note, refresh=False)

    def __enter__(self) -> Progress:
        threading.Thread(target=self._beat, name="progress", daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        if self._bar is not None:
            self._bar.close()
        else:
            self._print()

    def advance(self, count: int = 1, note: str = "", of: str = "") -> None:
        """Count `count` more finished items; `note` is shown beside the bar.

        `of` is the name under which `announce` has counted them before.
        """
        with self._lock:
            self._note = note
            self.done += count
            known = self._ahead.pop(of, 0)
            self._start_clock()
        if self._bar is not None:
            self._bar.set_postfix_str(visible(note), refresh=False)
            self._bar.update(count - known)
        else:
            self._print_if_due()

    def announce(self, of: str, count: int) -> None:
        """Count items that are finished on a worker; `advance` follows. Any thread may call it."""
        with self._lock:
            if of in self._ahead:
                return
            self._ahead[of] = count
            self._start_clock()
        if self._bar is not None:
            self._bar.update(count)

    def write(self, line: str) -> None:
        """Print a line without disturbing the bar."""
        if self._bar is not None:
            self._bar.write(visible(line), file=sys.stderr)
        else:
            say(line, err=True)

    def seconds_left(self) -> float | None:
        """Return the estimated seconds left: the forecast at first, then by what is finished."""
        now, shown = time.monotonic(), self.done + sum(self._ahead.values())
        if shown >= self.total:
            return None
        if self.expected is None:
            if self.pace is not None:
                return self.pace.seconds_left()
            since, before = self._first or (now, shown)
            after = shown - before
            return (self.total - shown) * (now - since) / after if after >= _FEW else None
        elapsed = now - self._started
        share = (shown - self.kept) / max(1, self.total - self.kept)
        measured = elapsed / share if share > 0 else 0.0
        trust = min(1.0, share / _TRUSTED)
        return max(0.0, trust * measured + (1 - trust) * self.expected - elapsed)

    def _start_clock(self) -> None:
        if self._first is None:
            self._first = time.monotonic(), self.done + sum(self._ahead.values())

    def _beat(self) -> None:
        """Redraw the bar or print a line when one is due, until the task ends."""
        while not self._ended.wait(1.0):
            if self._bar is None:
                self._print_if_due()
            else:
                self._bar.refresh()

    def _print_if_due(self) -> None:
        if time.monotonic() - self._printed >= EVERY:
            self._print(self._note)

    def _print(self, note: str = "") -> None:
        self._printed = time.monotonic()
        seconds = self._printed - self._started
        shown, left = self.done + sum(self._ahead.values()), self.seconds_left()
        note = self._new if note and self.pace is not None and self.pace.is_new else note
        parts = [f"{self.label}: {shown}/{self.total} {self.unit}"]
        if shown > self.kept and seconds > 0:
            rate = (shown - self.kept) / seconds
            parts.append(f"{rate:.2f}/s" if rate >= 0.1 else f"{1 / rate:.0f} s each")
        rough = self.expected is None and self.pace is not None and self.pace.is_rough
        if left is not None:
            parts.append(f"{'roughly ' if rough else ''}{span(left)} left")
        elif not self._ended.is_set():
            parts.append(f"{span(seconds)} so far")
        say(", ".join([*parts, note] if note else parts), err=True)


def span(seconds: float) -> str:
    """Return a duration in words: `1 second`, `12 minutes`, `1.6 hours`."""
    if seconds < 90:
        return counted(round(seconds), "second")
    return f"{seconds / 60:.0f} minutes" if seconds < 5400 else f"{seconds / 3600:,.1f} hours"
