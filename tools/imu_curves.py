"""Draws docs/pictures/imu.png: readings on the path of kt2 without noise, with that of a sensor, and
on a spline through its poses; the Allan deviations of the sensors: `python tools/imu_curves.py`.
"""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from iclnuim.sensor.imu import ImuStream
from iclnuim.sensor.imu_noise import imu_noise
from iclnuim.sequences.imu import imu_of
from iclnuim.trajectory_files.trajectories import read_trajectory
from matplotlib.axes import Axes

OUT = Path(__file__).resolve().parents[1] / "docs/pictures/imu.png"
RATE_HZ = 200.0
HOURS = 2
SHOWN_S = (5.0, 5.8)
SENSORS = {"bmi055": "tab:orange", "adis16448": "tab:blue"}


def main() -> None:
    figure, axes = plt.subplots(2, 2, figsize=(10, 5.6), constrained_layout=True)
    exact = imu_of("kt2", RATE_HZ)
    noisy = imu_of("kt2", RATE_HZ, "bmi055")
    spline = imu_of(read_trajectory("kt2").trajectory, RATE_HZ)
    still = np.arange(int(HOURS * 3600 * RATE_HZ)) * round(1e9 / RATE_HZ)
    rest = ImuStream(still, np.zeros((len(still), 6)), RATE_HZ)
    of_rest = {name: imu_noise(name).apply(rest, 0).readings for name in SENSORS}
    rows = ((0, "rotation rate x", "rad/s", 0), (1, "specific force x", "m/s$^2$", 3))
    for row, title, unit, column in rows:
        left, right = axes[row]
        shown = (exact.stamps_s > SHOWN_S[0]) & (exact.stamps_s < SHOWN_S[1])
        seconds = exact.stamps_s[shown]
        left.plot(seconds, exact.readings[shown, column], color="0.1", label="exact")
        left.plot(seconds, spline.readings[shown, column], "--", color="tab:red", label="spline")
        left.plot(seconds, noisy.readings[shown, column], ".", color="tab:orange", label="bmi055")
        left.set(title=f"kt2, {title}", xlabel="s", ylabel=unit)
        left.legend(fontsize=8)
        for name, colour in SENSORS.items():
            _draw_allan(right, of_rest[name][:, column], name, colour)
        right.set(title=f"Allan deviation at rest, {title}", xlabel="averaged over s", ylabel=unit)
        right.grid(alpha=0.3, which="both")
        right.legend()
    figure.savefig(OUT, dpi=90)


def _draw_allan(axes: Axes, readings: np.ndarray, name: str, colour: str) -> None:
    counts = np.unique(np.geomspace(1, len(readings) / 9, 40).astype(int))
    deviations = [_allan(readings, count) for count in counts]
    axes.loglog(counts / RATE_HZ, deviations, color=colour, label=name)


def _allan(readings: np.ndarray, count: int) -> float:
    """The overlapping Allan deviation of means over so many readings."""
    sums = np.concatenate([[0.0], np.cumsum(readings)])
    means = (sums[count:] - sums[:-count]) / count
    return float(np.sqrt(0.5 * np.mean((means[count:] - means[:-count]) ** 2)))


if __name__ == "__main__":
    main()
