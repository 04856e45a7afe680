"""Stamps and frame numbers of files: their units, their limits, and their text."""

from collections.abc import Iterable
from decimal import Decimal
from enum import Enum

import numpy as np

from ..errors import InputError
from ..geometry.trajectory import STAMP_DIGITS, frames_of_stamps, stamps_of_frames
from .number_table import NumberTable

#: Larger stamps (three thousand years) and frame numbers are rejected as damaged.
LARGEST_STAMP_S = 1e11
LARGEST_FRAME = 10**9
#: Digits before the decimal point of stamps in names: those of a clock's seconds since 1970.
NAME_DIGITS = 10
#: A stamp may differ from its frame's time by this share of a frame.
STAMP_SLACK = 0.01
#: Stamps of a clock, 1990 to 2100 in seconds since 1970, are recognised in any unit by their size.
_CLOCK_S = (6.3e8, 4.1e9)
#: They are closer than this. Nanoseconds since a computer's start, a quarter to an hour ago, are a
#: million apart or more: as milliseconds they would be a clock's with this step.
_CLOCK_STEP_S = 1000.0
#: Other stamps are told by their median step: nanoseconds from a million (a thousand frames per
#: second), and whole microseconds from a thousand, which would be twenty minutes.
_STEP_NS = 1e6
_STEP_US = 1e3
#: Ticks per second of the units of stamps.
_TICKS = (1.0, 1e3, 1e6, 1e9)
#: Whole numbers whose median step is shorter (10,000 frames per second) are no nanoseconds.
SHORTEST_STEP_NS = 1e5


class Stamps(Enum):
    """What a format has before each pose, with the printf format that writes it: a stamp in seconds
    is a text with all its digits, the others are whole numbers.
    """

    SECONDS = "a stamp in seconds (%s)"
    NANOSECONDS = "a stamp in nanoseconds (%d)"
    FRAMES = "a frame number (%d)"
    NONE = "no stamp"

    def __str__(self) -> str:
        return self.value

    def of(self, stamps_s: np.ndarray, rate_hz: float) -> Iterable[tuple[str | int, ...]]:
        """What stands before the poses of stamps (n,). Raises InputError for frame numbers of
        stamps between two frames.
        """
        if self is Stamps.FRAMES:
            return self.of_frames(frame_numbers(stamps_s, rate_hz))
        if self is Stamps.NONE:
            return self.of_frames(np.arange(len(stamps_s)))
        form = stamp_text if self is Stamps.SECONDS else nanoseconds_of
        return ((form(stamp_s),) for stamp_s in stamps_s.tolist())

    def of_frames(self, numbers: np.ndarray) -> Iterable[tuple[int, ...]]:
        """What stands before the poses of frames (n,)."""
        return [()] * len(numbers) if self is Stamps.NONE else zip(numbers.tolist())


def stamp_ticks(stamps: np.ndarray) -> float:
    """Ticks per second of stamps (n,): 1, 1e3, 1e6 or 1e9, by their size or their median step."""
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    step = float(np.median(steps)) if steps.size else 0.0
    size = float(np.median(np.abs(stamps))) if stamps.size else 0.0
    for ticks in _TICKS:
        if _CLOCK_S[0] <= size / ticks <= _CLOCK_S[1] and step / ticks < _CLOCK_STEP_S:
            return ticks
    if step >= _STEP_NS or not steps.size and size > LARGEST_STAMP_S:
        return 1e9
    whole = bool((stamps == np.rint(stamps)).all())
    return 1e6 if whole and step >= _STEP_US and steps.size > 1 else 1.0


def ticks_unless_frames(numbers: np.ndarray) -> float | None:
    """Ticks per second of a column (n,) of stamps; None if it has frame numbers: whole numbers of
    no clock.
    """
    finite = numbers[np.isfinite(numbers)]
    ticks = stamp_ticks(finite)
    whole = (finite == np.rint(finite)).all() and finite.max(initial=0) <= LARGEST_FRAME
    return None if whole and ticks == 1.0 else ticks


def plausible(stamps: np.ndarray, ticks: float) -> bool:
    """Whether the median step of stamps (n,) in this unit is 10 microseconds to a day."""
    steps = np.diff(stamps)
    steps = steps[steps > 0] / ticks
    return not steps.size or bool(1e-5 <= np.median(steps) <= 1e5)


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
        line = table.place(row - 1)[1]
        place = f"row {row - 1}" if line is None else f"line {line}"
        previous = f"the {values[row - 1]:.15g} of {place}"
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


def seconds_of_names(numbers: list[int]) -> tuple[list[float], list[str]] | None:
    """Stamps in seconds of images named by whole numbers, and their texts; None if these are frame
    numbers. Raises InputError if they are stamps in no known unit of time.
    """
    stamps = np.sort(np.array(numbers, float))
    ticks = ticks_unless_frames(stamps)
    if ticks is None:
        return None
    if stamps[-1] / ticks > LARGEST_STAMP_S:
        expected = "images named by frame numbers, stamps in milliseconds, microseconds or "
        expected += "nanoseconds, or stamps in seconds with decimals"
        hint = "rgb.txt and depth.txt with the stamps of the images"
        raise InputError(expected, found="another unit of time", hint=hint)
    texts = [stamp_text_of_ns(number * round(1e9 / ticks)) for number in numbers]
    return [number / ticks for number in numbers], texts


def stamp_name(text: str) -> str:
    """The text of a stamp in seconds with ten digits before the decimal point, with which names
    sort as time.
    """
    whole, _, digits = text.partition(".")
    return f"{whole.zfill(NAME_DIGITS)}.{digits or '0' * STAMP_DIGITS}"


def stamp_of_name(text: str) -> str:
    """The text of a stamp of which `stamp_name` gives this one; other texts unchanged."""
    whole, point, digits = text.partition(".")
    if len(whole) != NAME_DIGITS or not (whole + digits).isdecimal():
        return text
    return f"{int(whole)}{point}{digits}"


def stamp_text_of_ns(nanoseconds: int) -> str:
    """The text in seconds of a stamp in nanoseconds, with six to nine digits after the decimal
    point.
    """
    return _nine_digits(Decimal(nanoseconds).scaleb(-9))


def _nine_digits(stamp_s: Decimal) -> str:
    text = f"{stamp_s:.9f}"
    return text[:-3] + text[-3:].rstrip("0")


def nanoseconds_of(stamp_s: float | str) -> int:
    """Nanoseconds of a stamp in seconds, by its text or the shortest one: 1305031102.175304 s does
    not become ...303936 ns.
    """
    return round(Decimal(str(stamp_s)) * 10**9)


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
