"""The base class of the noise models, and their random numbers: a generator per (sequence seed,
frame, stream), a fast Gaussian.
"""

import functools
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..geometry.se3 import read_only
from ..settings import Settings

#: Random streams of one frame. Append new ones at the end, so that the noise of existing sequences
#: does not change.
DEPTH = 0
RGB = 1
#: 2 is that of perturbations (benchmark/perturbations/segment.py).
IMU = 3
_LEVELS = 1 << 16


@dataclass(frozen=True)
class NoiseModel(Settings):
    """`name` is the model's name in settings, `summary` one line for lists.

    A subclass has a method `apply` and is listed in models.py. asks_appearance: `apply` of a depth
    noise model takes an SurfaceAppearance besides, and cannot do without. gives_confidence: it has a
    method `measured` with the arguments of `apply` that returns depth and its confidence (channels.py).
    """

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    asks_appearance: ClassVar[bool] = False
    gives_confidence: ClassVar[bool] = False

    def __init_subclass__(cls, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls.group = f"settings of the noise model {cls.name!r}"


def frame_generator(seed: int, frame: int, stream: int) -> np.random.Generator:
    """The random generator of one image. Each frame is reproducible on its own, in any order, on
    any worker.

    Raises InputError unless seed and frame are whole numbers of at least 0.
    """
    if not all(isinstance(n, int | np.integer) and n >= 0 for n in (seed, frame)):
        raise InputError("a seed and a frame of at least 0", found=f"{seed!r} and {frame!r}")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, frame, stream])))


def gaussian(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """float32 samples of N(0, 1).

    A table of the inverse normal distribution at the middle of 65536 equal steps, scaled to
    variance 1. It is four times as fast as `standard_normal`. numpy guarantees the stream of raw
    integers, but not that of `standard_normal`. The largest value is 4.32 sigma; of a million
    samples of the continuous distribution 16 are larger.
    """
    return _inverse_normal().take(rng.integers(0, _LEVELS, shape, dtype=np.uint16), mode="clip")


@functools.cache
def _inverse_normal() -> np.ndarray:
    upper = np.array(
        [NormalDist().inv_cdf((i + 0.5) / _LEVELS) for i in range(_LEVELS // 2, _LEVELS)]
    )
    table = np.concatenate([-upper[::-1], upper])
    return read_only((table / np.sqrt(np.mean(table**2))).astype(np.float32))
