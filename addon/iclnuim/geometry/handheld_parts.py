"""The parts of hand-held motion, each a function of time with its first two derivatives: a C2
spline, progress along it with smooth starts and stops, and band-limited shake.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

#: Times for which a shake is evaluated at once: its cosines take some 10 MB.
_BLOCK = 2048


class NaturalSpline:
    """The natural cubic spline through `values` (n, d) at increasing `knots` (n,), n >= 2.

    It is C2, with zero curvature at its ends; outside them the first and last pieces are
    extrapolated.
    """

    def __init__(self, knots: np.ndarray, values: np.ndarray) -> None:
        self._knots = knots
        self._values = values
        self._h = np.diff(knots)
        self._curvatures = _spline_curvatures(self._h, np.diff(values, axis=0) / self._h[:, None])

    def at(self, at: np.ndarray) -> np.ndarray:
        """The values (m, d) at (m,)."""
        piece, h, a, b = self._places(at)
        values, curvatures = self._values, self._curvatures
        curve = (a * a * a - a) * curvatures[piece] + (b * b * b - b) * curvatures[piece + 1]
        return a * values[piece] + b * values[piece + 1] + curve * (h * h) / 6.0

    def jet(self, at: np.ndarray) -> np.ndarray:
        """The values and their first two derivatives (3, m, d) at (m,)."""
        piece, h, a, b = self._places(at)
        before, after = self._curvatures[piece], self._curvatures[piece + 1]
        slope = (self._values[piece + 1] - self._values[piece]) / h
        slope += ((3.0 * b * b - 1.0) * after - (3.0 * a * a - 1.0) * before) * h / 6.0
        return np.stack([self.at(at), slope, a * before + b * after])

    def _places(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The pieces (m,), their lengths (m, 1), and the shares (m, 1) of their ends."""
        piece = np.clip(np.searchsorted(self._knots, at, side="right") - 1, 0, len(self._h) - 1)
        b = ((at - self._knots[piece]) / self._h[piece])[:, None]
        return piece, self._h[piece][:, None], 1.0 - b, b


def _spline_curvatures(h: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Second derivatives (n, d) at the knots, by plain elimination, which does the same operations
    on every machine.
    """
    n = len(h) + 1
    curvatures = np.zeros((n, slopes.shape[1]))
    diagonal = np.zeros(n)
    for k in range(1, n - 1):
        diagonal[k] = 2.0 * (h[k - 1] + h[k])
        curvatures[k] = 6.0 * (slopes[k] - slopes[k - 1])
        if k > 1:
            factor = h[k - 1] / diagonal[k - 1]
            diagonal[k] -= factor * h[k - 1]
            curvatures[k] -= factor * curvatures[k - 1]
    for k in range(n - 2, 0, -1):
        following = h[k] * curvatures[k + 1] if k < n - 2 else 0.0
        curvatures[k] = (curvatures[k] - following) / diagonal[k]
    return curvatures


class EasedProgress:
    """Progress along a trajectory in 0 to `duration_s`: from 0 to sum(legs), at a constant rate,
    and at rest during each dwell, before the start and after the end.

    `legs` (n-1,) are the lengths between n stops in any unit, `dwells_s` (n,) the rests at the
    stops. Starts and stops take `ease_s` and follow a quintic step, so that the progress is C3 in
    time. Raises InputError if the rests leave no time for motion.
    """

    def __init__(
        self, legs: np.ndarray, dwells_s: np.ndarray, ease_s: float, duration_s: float
    ) -> None:
        moving_s = duration_s - ease_s - dwells_s.sum()
        if moving_s <= 0:
            found = f"{dwells_s.sum():.1f} of {duration_s:.1f} s"
            raise InputError("dwells shorter than the whole", found=found)
        self._ease_s = ease_s
        rate = legs.sum() / moving_s
        #: Times at which the rate changes, and the change.
        self._changes: list[tuple[float, float]] = []
        clock_s = ease_s / 2
        for leg, dwell_s in zip([0.0, *legs], dwells_s, strict=True):
            clock_s += leg / rate
            if leg:
                self._changes.append((clock_s, -rate))
            clock_s += dwell_s
            self._changes.append((clock_s, rate))
        self._changes.append((clock_s, -rate))  # no start after the last stop

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """The progress (m,) at (m,)."""
        progress = np.zeros(len(times_s))
        for clock_s, change in self._changes:
            progress = progress + change * self._ramp(times_s - clock_s)
        return progress

    def jet(self, times_s: np.ndarray) -> np.ndarray:
        """The progress and its first two derivatives (3, m) at (m,)."""
        jet = np.stack([self.at(times_s), np.zeros(len(times_s)), np.zeros(len(times_s))])
        for clock_s, change in self._changes:
            x = np.clip((times_s - clock_s) / self._ease_s + 0.5, 0.0, 1.0)
            jet[1] += change * x * x * x * ((6.0 * x - 15.0) * x + 10.0)
            jet[2] += change * 30.0 * (x * (1.0 - x)) ** 2 / self._ease_s
        return jet

    def _ramp(self, t: np.ndarray) -> np.ndarray:
        """max(t, 0), smoothed over |t| < ease/2: the integral of the step 6x^5 - 15x^4 + 10x^3."""
        x = np.clip(t / self._ease_s + 0.5, 0.0, 1.0)
        rounded = self._ease_s * x * x * x * x * ((x - 3.0) * x + 2.5)
        return np.where(t > self._ease_s / 2, t, rounded)


@dataclass(frozen=True, eq=False)
class BandNoise:
    """Periodic random motion of several channels: a sum of cosines at the frequencies k / duration
    of a band, whose `phasors` (channels, k) are amplitude and phase.
    """

    count: int
    rate_hz: float
    frequencies_hz: np.ndarray
    phasors: np.ndarray

    @classmethod
    def drawn(
        cls,
        count: int,
        rate_hz: float,
        band_hz: tuple[float, float],
        slope: float,
        channels: int,
        rng: np.random.Generator,
    ) -> "BandNoise":
        """Random phases, power proportional to f^-slope in the band, and an RMS of 1 in each
        channel, which is exact over `count` frames.

        Raises InputError if the band contains no such frequency.
        """
        low_hz, high_hz = band_hz
        all_hz = np.arange(count // 2 + 1) * rate_hz / count
        inside = (all_hz >= low_hz) & (all_hz <= high_hz) & (all_hz < rate_hz / 2)
        if not inside.any():
            raise InputError(
                f"a band that contains a frequency of {count} frames",
                found=f"{low_hz:g}..{high_hz:g} Hz",
            )
        amplitudes = (all_hz[inside] / low_hz) ** (-slope / 2)
        amplitudes *= np.sqrt(2.0 / (amplitudes * amplitudes).sum())
        phases = 2.0 * np.pi * rng.random((channels, len(amplitudes)))
        phasors = amplitudes * (np.cos(phases) + 1j * np.sin(phases))
        return cls(count, rate_hz, all_hz[inside], phasors)

    def of_frames(self) -> np.ndarray:
        """The motion (count, channels) at the frames."""
        spectrum = np.zeros((len(self.phasors), self.count // 2 + 1), complex)
        numbers = np.rint(self.frequencies_hz * self.count / self.rate_hz).astype(int)
        spectrum[:, numbers] = self.phasors * (self.count / 2)
        return np.fft.irfft(spectrum, self.count).T

    def jet(self, times_s: np.ndarray) -> np.ndarray:
        """The motion and its first two derivatives (3, m, channels) at (m,), frame 0 at 0 s."""
        turns = 2j * np.pi * self.frequencies_hz
        orders = np.concatenate([self.phasors * turns**k for k in range(3)]).T
        blocks = [
            (np.exp(np.outer(times_s[k : k + _BLOCK], turns)) @ orders).real
            for k in range(0, len(times_s), _BLOCK)
        ]
        found = np.concatenate(blocks) if blocks else np.zeros((0, orders.shape[1]))
        return np.moveaxis(found.reshape(len(times_s), 3, len(self.phasors)), 1, 0)
