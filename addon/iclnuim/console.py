"""Output of a command: results go to standard output, notes and progress to standard error."""

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from datetime import timedelta
from html import escape
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
        self.at_end = ExitStack()
        #: The clock of rates and times left, in seconds.
        self.clock: Callable[[], float] = time.monotonic

    def result(self, values: dict, text: str) -> None:
        """Print the result of a command: `values` with --json, `text` without."""
        if self.as_json:
            text = json_text(values, ascii=True)
        print(text, flush=True)

    def note(self, text: str) -> None:
        """Print additional information to standard error."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, total: int, label: str, unit: str = "frames", there: int = 0) -> "Progress":
        """there: so many of the total are there already."""
        return Progress(total, label, unit, not self.quiet, self.clock, there)


class Progress:
    """Progress display: count done, rate and time left.

    On a terminal one line is redrawn, in a notebook one bar; in a log a line is printed every ten
    seconds.
    """

    def __init__(
        self,
        total: int,
        label: str,
        unit: str,
        enabled: bool,
        clock: Callable[[], float] = time.monotonic,
        there: int = 0,
    ) -> None:
        self.total = total
        self.label = label
        self.unit = unit
        self.enabled = enabled
        self.there = there
        self.done = there
        self.clock = clock
        self.started = clock()
        self.last = 0.0
        self.terminal = sys.stderr.isatty()
        self._bar = _Bar() if enabled and in_notebook() else None
        self._pause_s = 0.1 if self.terminal or self._bar else 10.0

    def begin(self) -> None:
        """Start the clock.

        Preparation before this call is not counted, as it would falsify the time left.
        """
        if self.done == self.there:
            self.started = self.clock()

    def advance(self, count: int = 1) -> None:
        self.done += count
        now = time.monotonic()
        ended = self.done >= self.total
        if not self.enabled or not (ended or now - self.last > self._pause_s):
            return
        self.last = now
        text = f"{self.label}: {self.done}/{self.total} {self.unit}, {self._speed()}"
        if self._bar:
            self._bar.show(self.done, self.total, text)
            return
        if self.terminal:
            text = f"\r\x1b[K{text}"
        if ended or not self.terminal:
            text += "\n"
        print(text, end="", file=sys.stderr, flush=True)

    def _speed(self) -> str:
        rate = (self.done - self.there) / max(self.clock() - self.started, 1e-9)
        left_s = max(0, round((self.total - self.done) / rate))
        left = str(timedelta(seconds=left_s)).removeprefix("0:")
        return f"{rate:.3g}/s, {left} left"


class _Bar:
    """A bar in the output of a notebook's cell, redrawn in its place."""

    def __init__(self) -> None:
        self._shown: Any = None

    def show(self, done: int, total: int, text: str) -> None:
        bar = f'<progress value="{done}" max="{total}"></progress> {escape(text)}'
        content = {"text/html": bar, "text/plain": text}
        if self._shown is None:
            from IPython.display import display

            self._shown = display(content, raw=True, display_id=True)
        else:
            self._shown.update(content, raw=True)


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
