"""Stamps and frame numbers of files: their units, their limits, and their text."""

from decimal import Decimal

import numpy as np

from ..errors import InputError
from ..geometry.trajectory import STAMP_DIGITS, frames_of_stamps, stamps_of_frames
from .columns import NumberTable

#: Larger stamps (three thousand years) and frame numbers are rejected as damaged.
LARGEST_STAMP_S = 1e11
LARGEST_FRAME = 10**9
#: A stamp may differ from its frame's time by this share of a frame.
STAMP_SLACK = 0.01
#: Stamps whose median step is longer are nanoseconds (10,000 frames per second), not seconds (one
#: frame per day).
LONGEST_STEP_S = 1e5
#: Whole numbers whose median step is shorter (10,000 frames per second) are no nanoseconds.
SHORTEST_STEP_NS = 1e5


def stamp_ticks(stamps: np.ndarray) -> float:
    """Ticks per second of stamps (n,): 1, or 1e9 if the median step, or a single stamp, is far too
    large for seconds.
    """
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if steps.size:
        return 1e9 if np.median(steps) > LONGEST_STEP_S else 1.0
    return 1e9 if np.abs(stamps).max(initial=0) > LARGEST_STAMP_S else 1.0


def seconds_of(
    table: NumberTable, values: np.ndarray, rate_hz: float, hint: str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) seconds of a file's stamps, or of its frame numbers if the table has no ticks, and the
    rows (m,) they belong to. A stamp that repeats the previous one is left out: some systems write
    it for a frame that they lost.

    Raises InputError for implausible or decreasing stamps, for a repeated frame number, and if most
    stamps repeat. `hint`: for the error of an invalid frame number.
    """
    if table.ticks is None:
        what = "frame number"
        good = (values == np.rint(values)) & (values >= 0) & (values <= LARGEST_FRAME)
        expected = f"a frame number, 0 to {LARGEST_FRAME}"
    else:
        what = "stamp"
        values = values / table.ticks
        good = np.abs(values) <= LARGEST_STAMP_S
        expected = f"a stamp in seconds, at most {LARGEST_STAMP_S:g}"
        hint = None
    if not good.all():
        row = int(good.argmin())
        raise table.error(row, expected, f"{values[row]:.10g}", hint)
    rows = _rows_in_order(table, values, what)
    seconds = stamps_of_frames(values, rate_hz) if table.ticks is None else values
    return seconds[rows], rows


def _rows_in_order(table: NumberTable, values: np.ndarray, what: str) -> np.ndarray:
    """The rows (m,) whose stamps or frame numbers do not repeat the previous one. Raises
    InputError if one is below the previous one, or if most repeat.
    """
    steps = np.diff(values, prepend=-np.inf)
    repeated = (steps == 0) & (table.ticks is not None)
    late = np.flatnonzero((steps <= 0) & ~repeated)
    if late.size:
        row = int(late[0])
        previous = f"the {values[row - 1]:.15g} of line {table.place(row - 1)[1]}"
        found = f"{values[row]:.15g}"
        hint = "a file of a single run, in the order of time"
        if values[row] == values[row - 1]:
            found += " again"
            hint = "removing one of the two lines"
        raise table.error(row, f"a {what} above {previous}", found, hint)
    rows = np.flatnonzero(~repeated)
    if 2 * len(rows) < len(values):
        found = f"{len(values) - len(rows)} of {len(values)} that repeat the previous stamp"
        hint = "writing six digits after the decimal point"
        raise table.error(0, "stamps with all their digits", found, hint)
    return rows


def stamp_text(stamp_s: float) -> str:
    """The text of a stamp in seconds: six digits after the decimal point, up to nine if six are not
    exact.
    """
    text = f"{stamp_s:.{STAMP_DIGITS}f}"
    if float(text) == stamp_s:
        return text
    return _nine_digits(Decimal(repr(float(stamp_s))))


def stamp_text_of_ns(nanoseconds: int) -> str:
    """The text in seconds of a stamp in nanoseconds, with six to nine digits after the decimal
    point.
    """
    return _nine_digits(Decimal(nanoseconds).scaleb(-9))


def _nine_digits(stamp_s: Decimal) -> str:
    text = f"{stamp_s:.9f}"
    return text[:-3] + text[-3:].rstrip("0")


def nanoseconds_of(stamp_s: float) -> int:
    """Nanoseconds of the shortest decimal text of a stamp in seconds."""
    return round(Decimal(repr(stamp_s)) * 10**9)


def frame_numbers(stamps_s: np.ndarray, rate_hz: float) -> np.ndarray:
    """Frame numbers (n,) of stamps (n,): (stamp - 1) * rate.

    Raises InputError if a stamp is between two frames or before frame 0.
    """
    frames = frames_of_stamps(stamps_s, rate_hz)
    numbers = np.rint(frames)
    between = ~(np.abs(frames - numbers) <= STAMP_SLACK)
    bad = np.flatnonzero(between | (numbers < 0) | (np.diff(numbers, prepend=-1.0) <= 0))
    if bad.size:
        whole = f"stamps of whole frame numbers, 1 + number / {rate_hz:g} s"
        found = f"{stamps_s[bad[0]]:.15g} s"
        raise InputError(f"{whole}, to write frame numbers", found=found, hint="{restamp}")
    return numbers.astype(np.int64)
