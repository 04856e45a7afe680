"""The stamps with which the rotation rates of an IMU are most like those of the camera: another
offset, or another scale. FFTs correlate them for all offsets at once.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry.continuous import SplineMotion
from ..geometry.se3 import SE3
from .time_axis import TimeAxis

#: Rates of IMUs, of which a wrong one gives stamps of another scale; the farthest scale of a clock
#: that drifts, and what neighbouring ones are apart at the end: half a period of trembling hands.
_RATES_HZ = np.array([50.0, 100.0, 120.0, 125.0, 200.0, 250.0, 400.0, 500.0, 1000.0])
_DRIFT = 0.05
DRIFT_STEP_S = 0.04
#: The part of the readings that has to overlap the poses.
_OVERLAP = 0.5
_MOST_SAMPLES = 1 << 14


def scales_of(length_s: float) -> list[float]:
    """The scales of stamps that are tried, of a recording of this length."""
    drift = np.arange(-_DRIFT, _DRIFT, DRIFT_STEP_S / max(length_s, 1.0))
    scales = np.concatenate([np.divide.outer(_RATES_HZ, _RATES_HZ).ravel(), 1.0 + drift])
    return [float(scale) for scale in np.unique(scales)]


class ComparedRates(NamedTuple):
    """Rates (m, 3) of the IMU at equal steps by the poses, and its readings (n, 3), less their means;
    the first stamps of both, and the stamps of the readings (n,) since.
    """

    turned: np.ndarray
    read: np.ndarray
    first_s: float
    first_read_s: float
    since_s: np.ndarray
    step_s: float

    @classmethod
    def of(
        cls, stamps_s: np.ndarray, rates: np.ndarray, T_imu_camera: SE3, motion: SplineMotion
    ) -> "ComparedRates":
        first_s, last_s = motion.stamps_s[[0, -1]].tolist()
        since_s = stamps_s - stamps_s[0]
        step_s = max(float(np.median(np.diff(since_s))), (last_s - first_s) / _MOST_SAMPLES)
        times_s = np.arange(first_s, last_s, step_s)
        turned = motion.states(times_s).rate_rad_s @ T_imu_camera.rotation.T
        read = rates
        first_read_s = float(stamps_s[0])
        turned, read = turned - turned.mean(0), read - read.mean(0)
        return cls(turned, read, first_s, first_read_s, since_s, step_s)

    def best(self, scales: Sequence[float]) -> TimeAxis:
        """Of scales of the readings' stamps that with the best offset, about their middle: so a
        small change of one hardly changes the other.
        """
        _, offset_s, scale = max((*self._offset(scale), scale) for scale in scales)
        half_s = float(self.since_s[-1]) / 2
        return TimeAxis(offset_s + half_s * (scale - 1), scale, self.first_read_s + half_s)

    def _offset(self, scale: float) -> tuple[float, float]:
        """How much both correlate, -1 to 1, with the best offset of the first stamp, and this."""
        own_s = self.since_s * scale
        grid_s = np.arange(0.0, min(own_s[-1], 2 * self.step_s * len(self.turned)), self.step_s)
        read = np.stack([np.interp(grid_s, own_s, column) for column in self.read.T], -1)
        size = 1 << (len(self.turned) + len(read)).bit_length()

        def spectrum(values: np.ndarray) -> np.ndarray:
            return np.fft.rfft(values, size, axis=0)

        def correlated(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return np.fft.irfft(a * b.conj(), size)

        product = (spectrum(self.turned) * spectrum(read).conj()).sum(1)
        ones = spectrum(np.ones(len(self.turned))), spectrum(np.ones(len(read)))
        energies = [spectrum((each**2).sum(1)) for each in (self.turned, read)]
        energy = correlated(energies[0], ones[1]) * correlated(ones[0], energies[1])
        enough = correlated(*ones) >= _OVERLAP * min(len(self.turned), len(read))
        likeness = np.fft.irfft(product, size) / np.sqrt(np.maximum(energy, 1e-12))
        place = int(np.where(enough, likeness, -1.0).argmax())
        lag = place - size if place > size // 2 else place
        return float(likeness[place]), self.first_s + lag * self.step_s - self.first_read_s
