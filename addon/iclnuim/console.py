"""Output of a command: results go to standard output, notes and progress to standard error."""

import sys
import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

from .formats.files import json_text


class Console:
    """Output of a command.

    `quiet` suppresses notes and progress; `json` prints results as one JSON object on standard
    output.
    """

    def __init__(self, quiet: bool = False, json: bool = False) -> None:
        self.quiet = quiet
        self.as_json = json

    def result(self, values: dict, text: str) -> None:
        """Print the result of a command: `values` with --json, `text` without."""
        if self.as_json:
            text = json_text(values, ascii=True)
        print(text, flush=True)

    def note(self, text: str) -> None:
        """Print additional information to standard error."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, total: int, label: str, unit: str = "frames") -> "Progress":
        return Progress(total, label, unit, enabled=not self.quiet)


#: The first steps of long work compile and load, so they are no part of a rate or a time left.
_WARM_UP = 2
_LONG = 20


class Progress:
    """Progress display: count done, rate and time left.

    On a terminal one line is redrawn; in a log a line is printed every ten seconds.
    """

    def __init__(self, total: int, label: str, unit: str, enabled: bool) -> None:
        self.total = total
        self.label = label
        self.unit = unit
        self.enabled = enabled
        self.done = 0
        self.started = time.monotonic()
        self.uncounted = 0
        self.last = 0.0
        self.terminal = sys.stderr.isatty() or in_notebook()
        self._pause_s = 0.1 if self.terminal else 10.0

    def begin(self) -> None:
        """Start the clock.

        Preparation before this call is not counted, as it would falsify the time left.
        """
        if not self.done:
            self.started = time.monotonic()

    def advance(self, count: int = 1) -> None:
        self.done += count
        now = time.monotonic()
        warming_up = self.done <= _WARM_UP and self.total >= _LONG
        if warming_up:
            self.started = now
            self.uncounted = self.done
        ended = self.done >= self.total
        if not self.enabled or not (ended or now - self.last > self._pause_s):
            return
        self.last = now
        text = f"{self.label}: {self.done}/{self.total} {self.unit}"
        if not warming_up:
            text += self._speed(now)
        if self.terminal:
            text = f"\r\x1b[K{text}"
        if ended or not self.terminal:
            text += "\n"
        print(text, end="", file=sys.stderr, flush=True)

    def _speed(self, now: float) -> str:
        rate = (self.done - self.uncounted) / max(now - self.started, 1e-9)
        left_s = max(0, round((self.total - self.done) / rate))
        left = str(timedelta(seconds=left_s)).removeprefix("0:")
        return f", {rate:.3g}/s, {left} left"


#: Whether progress is shown (None: in a notebook), or progress(total, label), which returns an
#: object with advance().
Meter = bool | Callable[[int, str], Any] | None


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def advance_of(
    progress: Meter, total: int, label: str, unit: str = "frames"
) -> Callable[[], object]:
    """The function to call after each of `total` steps."""
    if callable(progress):
        return progress(total, label).advance
    shown = in_notebook() if progress is None else progress
    return Progress(total, label, unit, enabled=shown).advance
