"""The noise of an IMU: white noise, bias instability, random walk, scale error, saturation and
rounding, and the figures of two sensors.

The terms are those of IEEE Std 952-1997, annex C: white noise of density N has the Allan deviation
N / sqrt(t), bias instability B that of 0.664 B at every t, a random walk K that of K sqrt(t / 3).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..settings import parameter, same_as
from .imu import ImuStream
from .noise_model import IMU, NoiseModel, frame_generator, gaussian

_G_M_S2 = 9.80665
#: The Allan deviation of a bias instability of 1.
_FLOOR = math.sqrt(2 * math.log(2) / math.pi)
#: Time constants in seconds of the processes whose sum has the power 1/f: an octave apart, from less
#: than a step to longer than any recording.
_TIME_CONSTANTS_S = 2.0 ** np.arange(-9, 15)
#: Random streams of a sensor, each (n, 3).
_WHITE, _WALK, _SCALE, _FLICKER = range(4)
_STREAMS = _FLICKER + len(_TIME_CONSTANTS_S)
_OF_SENSOR = {"gyro": 0, "accel": 1}
#: As in Kalibr's imu.yaml.
FIGURES = {
    "gyroscope_noise_density": "gyro_noise_density",
    "gyroscope_random_walk": "gyro_random_walk",
    "accelerometer_noise_density": "accel_noise_density",
    "accelerometer_random_walk": "accel_random_walk",
}


@dataclass(frozen=True)
class ImuNoise(NoiseModel):
    """The noise of an IMU; a term of 0 is left out."""

    name = "none"
    summary = "readings without noise"

    gyro_noise_density: float = parameter(0.0, "white noise", unit="rad/s/sqrt(Hz)", low=0.0)
    gyro_bias_instability: float = parameter(0.0, "bias instability B", unit="rad/s", low=0.0)
    gyro_random_walk: float = parameter(
        0.0, "random walk of the bias", unit="rad/s^2/sqrt(Hz)", low=0.0
    )
    gyro_scale_error: float = parameter(
        0.0, "standard deviation of the factor of each axis from 1", low=0.0, high=0.5
    )
    gyro_range: float = parameter(0.0, "largest rate; 0: any", unit="rad/s", low=0.0)
    gyro_step: float = parameter(0.0, "step of the digits; 0: none", unit="rad/s", low=0.0)
    accel_noise_density: float = parameter(0.0, "white noise", unit="m/s^2/sqrt(Hz)", low=0.0)
    accel_bias_instability: float = parameter(0.0, "bias instability B", unit="m/s^2", low=0.0)
    accel_random_walk: float = parameter(
        0.0, "random walk of the bias", unit="m/s^3/sqrt(Hz)", low=0.0
    )
    accel_scale_error: float = parameter(
        0.0, "standard deviation of the factor of each axis from 1", low=0.0, high=0.5
    )
    accel_range: float = parameter(0.0, "largest specific force; 0: any", unit="m/s^2", low=0.0)
    accel_step: float = parameter(0.0, "step of the digits; 0: none", unit="m/s^2", low=0.0)

    def apply(self, imu: ImuStream, seed: int) -> ImuStream:
        """The stream with noise, which is a function of the seed and the number of the reading from
        the stream's first: it is the same in a shorter stream. Raises InputError for a seed below 0.
        """
        sensors = [
            self._sensor(name, imu.readings[:, columns], imu.rate_hz, seed)
            for name, columns in (("gyro", slice(0, 3)), ("accel", slice(3, 6)))
        ]
        readings, biases = (np.hstack(parts) for parts in zip(*sensors, strict=True))
        before = 0.0 if imu.biases is None else imu.biases
        return replace(imu, readings=readings, biases=before + biases, noise=self.figures())

    def figures(self) -> dict[str, float]:
        """Densities and walks by their names in Kalibr's imu.yaml; {} without noise."""
        found = {name: float(getattr(self, own)) for name, own in FIGURES.items()}
        return found if any(found.values()) else {}

    def _sensor(
        self, name: str, true: np.ndarray, rate_hz: float, seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """The readings (n, 3) of one sensor, and their bias (n, 3)."""
        get = {
            key.removeprefix(f"{name}_"): value
            for key, value in vars(self).items()
            if key.startswith(f"{name}_")
        }
        count = len(true)

        def drawn(stream: int, rows: int = count) -> np.ndarray:
            number = _OF_SENSOR[name] * _STREAMS + stream
            return gaussian(frame_generator(seed, number, IMU), (rows, 3)).astype(float)

        bias = np.zeros_like(true)
        if get["bias_instability"]:
            bias += get["bias_instability"] * _flicker(count, rate_hz, drawn)
        if get["random_walk"]:
            steps = get["random_walk"] / math.sqrt(rate_hz) * drawn(_WALK)
            bias += np.cumsum(steps, axis=0) - steps[:1]
        found = true * (1.0 + get["scale_error"] * drawn(_SCALE, 1)) + bias
        if get["noise_density"]:
            found += get["noise_density"] * math.sqrt(rate_hz) * drawn(_WHITE)
        if get["range"]:
            found = found.clip(-get["range"], get["range"])
        if get["step"]:
            found = get["step"] * np.rint(found / get["step"])
        return found, bias


def _flicker(count: int, rate_hz: float, drawn: Callable[[int], np.ndarray]) -> np.ndarray:
    """(count, 3) of noise with the two-sided power 1 / (2 pi f), that of a bias instability of 1: a
    sum of first-order Gauss-Markov processes, each stationary from the first sample on.

    One of the time constant T and the variance s^2 has the power 2 s^2 T / (1 + (2 pi f T)^2), which
    sums over octaves of T to s^2 / (2 f ln 2): so s^2 = ln 2 / pi.
    """
    total = np.zeros((count, 3))
    for k, constant_s in enumerate(_TIME_CONSTANTS_S.tolist()):
        kept = math.exp(-1.0 / (rate_hz * constant_s))
        noise = drawn(_FLICKER + k)
        noise[1:] *= math.sqrt(1.0 - kept * kept)
        total += _decaying_sum(noise, kept)
    return math.sqrt(math.log(2.0) / math.pi) * total


def _decaying_sum(noise: np.ndarray, kept: float) -> np.ndarray:
    """x with x[k] = kept x[k-1] + noise[k], by doubling: sums over 1, 2, 4 ... samples."""
    total = noise.copy()
    step = 1
    while step < len(total) and kept > 1e-18:
        total[step:] += kept * total[:-step].copy()
        kept *= kept
        step *= 2
    return total


def _figure(name: str, value: float, source: str) -> Any:
    """The setting of ImuNoise of this name with another default, and where it is from."""
    declaration = same_as(ImuNoise, name).metadata["setting"]
    return field(default=value, metadata={"setting": {**declaration, "source": source}})


_UNREAD = "from memory of the data sheet, not read again"
_TOLERANCE = f"tolerance of 1 %, taken as three standard deviations: {_UNREAD}"
_BMI055 = "Bosch's data sheet as quoted in CSDN 103731233; ORB-SLAM3 notes the same for the D435i"
_D435I = "the RealSense D435i's, librealsense pull request 2777"
_WALKS = "ORB-SLAM3's settings for the D435i, which name VINS-Mono as their source"


@dataclass(frozen=True)
class Bmi055ImuNoise(ImuNoise):
    """The IMU of a consumer depth camera, without bias instability: the figures quoted for it differ."""

    name = "bmi055"
    summary = "Bosch BMI055, as in the RealSense D435i"

    gyro_noise_density: float = _figure(
        "gyro_noise_density", math.radians(0.014), f"0.014 degrees/s/sqrt(Hz): {_BMI055}"
    )
    gyro_random_walk: float = _figure("gyro_random_walk", 1e-6, _WALKS)
    gyro_scale_error: float = _figure("gyro_scale_error", 0.01 / 3, _TOLERANCE)
    gyro_range: float = _figure("gyro_range", math.radians(1000.0), f"1000 degrees/s: {_D435I}")
    gyro_step: float = _figure(
        "gyro_step",
        math.radians(1.0) / 32.8,
        "32.8 steps per degree/s, twice the data sheet's 16.4 at 2000 degrees/s as quoted in"
        " Bosch's forum, topic 10266",
    )
    accel_noise_density: float = _figure(
        "accel_noise_density", 150e-6 * _G_M_S2, f"150 ug/sqrt(Hz): {_BMI055}"
    )
    accel_random_walk: float = _figure("accel_random_walk", 1e-4, _WALKS)
    accel_range: float = _figure("accel_range", 4 * _G_M_S2, f"4 g: {_D435I}")
    accel_step: float = _figure(
        "accel_step", _G_M_S2 / 512, "512 steps per g at this range: as the distributor ICGOO lists"
    )


_ADIS16448 = "Analog Devices' data sheet as quoted in Kalibr's issue 63"
_FIRST_PAGE = "the data sheet's first page"
_DRIVER = "Linux's driver adis16400.c"


@dataclass(frozen=True)
class Adis16448ImuNoise(ImuNoise):
    """The IMU with which EuRoC was recorded, with bias instability in place of random walk."""

    name = "adis16448"
    summary = "Analog Devices ADIS16448, as in EuRoC"

    gyro_noise_density: float = _figure(
        "gyro_noise_density", math.radians(0.0135), f"0.0135 degrees/s/sqrt(Hz): {_ADIS16448}"
    )
    gyro_bias_instability: float = _figure(
        "gyro_bias_instability",
        math.radians(14.5) / 3600 / _FLOOR,
        f"in-run stability of 14.5 degrees/h, the lowest Allan deviation: {_UNREAD}",
    )
    gyro_scale_error: float = _figure("gyro_scale_error", 0.01 / 3, _TOLERANCE)
    gyro_range: float = _figure(
        "gyro_range", math.radians(1000.0), f"1000 degrees/s, the widest of three: {_FIRST_PAGE}"
    )
    gyro_step: float = _figure(
        "gyro_step", math.radians(0.04), f"0.04 degrees/s per step: {_DRIVER}"
    )
    accel_noise_density: float = _figure(
        "accel_noise_density", 0.23e-3 * _G_M_S2, f"0.23 mg/sqrt(Hz): {_ADIS16448}"
    )
    accel_bias_instability: float = _figure(
        "accel_bias_instability",
        0.25e-3 * _G_M_S2 / _FLOOR,
        f"in-run stability of 0.25 mg, the lowest Allan deviation: {_UNREAD}",
    )
    accel_scale_error: float = _figure("accel_scale_error", 0.01 / 3, _TOLERANCE)
    accel_range: float = _figure("accel_range", 18 * _G_M_S2, f"18 g at least: {_FIRST_PAGE}")
    accel_step: float = _figure("accel_step", 0.833e-3 * _G_M_S2, f"0.833 mg per step: {_DRIVER}")


IMU_MODELS: dict[str, type[ImuNoise]] = {
    model.name: model for model in (ImuNoise, Bmi055ImuNoise, Adis16448ImuNoise)
}


def imu_noise(model: ImuNoise | str, settings: Mapping[str, Any] | None = None) -> ImuNoise:
    """The noise model of an IMU of this name; a model stays as it is. Raises InputError."""
    if isinstance(model, ImuNoise):
        return model.changed(**settings or {})
    if model not in IMU_MODELS:
        raise InputError(f"the noise of an IMU ({', '.join(IMU_MODELS)})", found=model)
    return IMU_MODELS[model].from_dict(settings or {})


def estimator_figures(stream: ImuStream) -> dict[str, float]:
    """The densities and walks of a stream for an estimator, by their names in Kalibr's imu.yaml.
    Those that are 0 or unknown, whose inverses an estimator weights readings by, are those of `bmi055`.
    """
    found = Bmi055ImuNoise().figures()
    return found | {name: value for name, value in stream.noise.items() if value > 0}
