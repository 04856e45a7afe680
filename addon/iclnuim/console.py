"""Output of a command: results go to standard output, notes and progress to standard error."""

import json
import sys
import time
from datetime import timedelta


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
        print(json.dumps(values, indent=2, allow_nan=False) if self.as_json else text, flush=True)

    def note(self, text: str) -> None:
        """Print additional information to standard error."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, total: int, label: str, unit: str = "frames") -> "Progress":
        return Progress(total, label, unit, enabled=not self.quiet)


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
        self.last = 0.0
        self.terminal = sys.stderr.isatty()

    def begin(self) -> None:
        """Start the clock.

        Preparation before this call is not counted, as it would falsify the time left.
        """
        if not self.done:
            self.started = time.monotonic()

    def advance(self, count: int = 1) -> None:
        self.done += count
        now = time.monotonic()
        if self.enabled and (
            now - self.last > (0.1 if self.terminal else 10.0) or self.done >= self.total
        ):
            self.last = now
            rate = self.done / max(now - self.started, 1e-9)
            left = str(
                timedelta(seconds=max(0, round((self.total - self.done) / rate)))
            ).removeprefix("0:")
            text = f"{self.label}: {self.done}/{self.total} {self.unit}, {rate:.3g}/s, {left} left"
            end = "\n" if not self.terminal or self.done >= self.total else ""
            print(
                ("\r\x1b[K" if self.terminal else "") + text, end=end, file=sys.stderr, flush=True
            )
