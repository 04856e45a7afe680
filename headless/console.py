"""Output of commands: results on standard output, notes and progress on standard error."""

import json
import sys
import time
from datetime import timedelta


class Console:
    """`quiet` drops notes and progress; `json` turns results into one JSON object on standard output."""

    def __init__(self, quiet: bool = False, json: bool = False) -> None:
        self.quiet, self.as_json = quiet, json

    def result(self, values: dict, text: str) -> None:
        """The figures a command was asked for: `values` with --json, `text` without."""
        print(json.dumps(values, indent=2, allow_nan=False) if self.as_json else text, flush=True)

    def note(self, text: str) -> None:
        """Something worth knowing beside the result."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, total: int, label: str, unit: str = "frames") -> "Progress":
        return Progress(total, label, unit, enabled=not self.quiet)


class Progress:
    """Done, rate and time left: one line redrawn on a terminal, a plain line every ten seconds in a log."""

    def __init__(self, total: int, label: str, unit: str, enabled: bool) -> None:
        self.total, self.label, self.unit, self.enabled = total, label, unit, enabled
        self.done, self.started, self.last = 0, time.monotonic(), 0.0
        self.terminal = sys.stderr.isatty()

    def begin(self) -> None:
        """Start the clock: what came before was preparation, which tells nothing about the time left."""
        if not self.done:
            self.started = time.monotonic()

    def advance(self, count: int = 1) -> None:
        self.done += count
        now = time.monotonic()
        if self.enabled and (now - self.last > (0.1 if self.terminal else 10.0) or self.done >= self.total):
            self.last = now
            rate = self.done / max(now - self.started, 1e-9)
            left = str(timedelta(seconds=round((self.total - self.done) / rate))).removeprefix("0:")
            text = f"{self.label}: {self.done}/{self.total} {self.unit}, {rate:.3g}/s, {left} left"
            end = "\n" if not self.terminal or self.done >= self.total else ""
            print(("\r\x1b[K" if self.terminal else "") + text, end=end, file=sys.stderr, flush=True)
