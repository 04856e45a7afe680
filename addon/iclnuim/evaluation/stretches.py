"""The stretches of a path that relative error is measured over: frames, seconds or metres, all or end to end."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

UNITS = ("frames", "seconds", "metres")
MEASURED_ON = ("reference", "estimate")


@dataclass(frozen=True)
class StretchSettings:
    """delta in `unit`: how far apart the two poses of a stretch are.

    all_pairs: one stretch from every pose, else each begins where the last ended. tolerance: the share of delta by
    which a stretch may be off (seconds, and metres with all pairs). measured_on: whose path the metres are counted
    along; the reference gives every estimate the same stretches, the estimate is what evo and the TUM tools take.
    """

    delta: float = 1.0
    unit: str = "frames"
    all_pairs: bool = True
    tolerance: float = 0.1
    measured_on: str = "reference"

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise InputError(f"a delta in {', '.join(UNITS)}", found=self.unit)
        if not 0 < self.delta < np.inf:
            raise InputError(f"a delta > 0 {self.unit}", found=self.delta)
        if self.unit == "frames" and self.delta != int(self.delta):
            raise InputError("a whole number of frames for delta", found=self.delta)
        if not 0 <= self.tolerance < 1:
            raise InputError("a tolerance of 0 to below 1 (a share of delta)", found=self.tolerance)
        if self.measured_on not in MEASURED_ON:
            raise InputError(f"stretches measured on {' or '.join(MEASURED_ON)}", found=self.measured_on)

    @classmethod
    def parse_delta(cls, text: str) -> tuple[float, str]:
        """`10` (frames), `0.5s` or `1m` -> number and unit."""
        match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m|s|)\s*", text)
        if match is None:
            raise InputError("a delta as 10 (frames), 0.5s (seconds) or 1m (metres)", found=text)
        return float(match[1]), {"": "frames", "s": "seconds", "m": "metres"}[match[2]]


def stretches(
    stamps_s: np.ndarray, positions_m: np.ndarray, settings: StretchSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Start and end indices (m,), start < end, of a path with stamps (n,) and positions (n, 3).

    Raises InputError where there is no such stretch.
    """
    if settings.unit == "frames":
        start, end = _by_index(len(stamps_s), int(settings.delta), settings.all_pairs)
    elif settings.unit == "seconds":
        start, end = _by_measure(stamps_s, settings)
        if not settings.all_pairs:
            start, end = _chained(start, end)
    elif settings.all_pairs:
        start, end = _by_measure(_travelled(positions_m), settings)
    else:
        start, end = _by_steps(positions_m, settings.delta)
    if len(start) == 0:
        raise _none(stamps_s, positions_m, settings)
    return start, end


def _by_index(count: int, delta: int, all_pairs: bool) -> tuple[np.ndarray, np.ndarray]:
    start = np.arange(0, max(0, count - delta), 1 if all_pairs else delta)
    return start, start + delta


def _by_measure(measure: np.ndarray, settings: StretchSettings) -> tuple[np.ndarray, np.ndarray]:
    """From every pose the later one whose measure is closest to its own + delta (ties: the earlier), within tolerance.

    measure (n,) never falls.
    """
    start, last = np.arange(len(measure) - 1), len(measure) - 1
    after = np.searchsorted(measure, measure[:-1] + settings.delta)
    # of several poses of the same measure (a camera that rests) the first one counts
    before = np.searchsorted(measure, measure[np.clip(after - 1, 0, last)])
    before, after = np.clip(before, start + 1, last), np.clip(after, start + 1, last)
    off_before, off_after = (np.abs(measure[end] - measure[start] - settings.delta) for end in (before, after))
    end, off = np.where(off_before <= off_after, before, after), np.minimum(off_before, off_after)
    good = off <= settings.tolerance * settings.delta
    return start[good], end[good]


def _chained(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of stretches ordered by start: the first, then each time the next that starts no earlier than the last ended."""
    chosen, row = [], 0
    following = np.searchsorted(start, end).tolist()
    while row < len(start):
        chosen.append(row)
        row = following[row]
    return start[chosen], end[chosen]


def _by_steps(positions_m: np.ndarray, delta_m: float) -> tuple[np.ndarray, np.ndarray]:
    """End to end: a stretch ends at the first pose by which at least delta was travelled since its start."""
    ends, travelled_m = [0], 0.0
    for index, step_m in enumerate(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).tolist(), 1):
        travelled_m += step_m
        if travelled_m >= delta_m:
            ends.append(index)
            travelled_m = 0.0
    return np.array(ends[:-1], int), np.array(ends[1:], int)


def _travelled(positions_m: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions_m, axis=0), axis=1))])


def _none(stamps_s: np.ndarray, positions_m: np.ndarray, settings: StretchSettings) -> InputError:
    whole = {
        "frames": f"{len(stamps_s)} paired poses",
        "seconds": f"{len(stamps_s)} paired poses over {stamps_s[-1] - stamps_s[0]:.3f} s",
        "metres": f"{len(stamps_s)} paired poses over {_travelled(positions_m)[-1]:.3f} m",
    }[settings.unit]
    hint = "a smaller --delta" if settings.unit == "frames" else "another --delta, or a larger --tolerance"
    return InputError(f"poses {settings.delta:g} {settings.unit} apart", found=whole, hint=hint)
