"""The base of the noise models, and their randomness: a generator per (sequence seed, frame, stream), a fast Gaussian."""

import functools
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, ClassVar

import numpy as np

from ..geometry.se3 import read_only
from ..settings import Settings

#: Streams of one frame; a new one is added at the end, so that older sequences stay as they are.
DEPTH, RGB = 0, 1
_LEVELS = 1 << 16


@dataclass(frozen=True)
class NoiseModel(Settings):
    """`name` is what users call the model, `summary` one line on it for lists; a subclass has `apply`, and is listed in models.py."""

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""

    def __init_subclass__(cls, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls.group = f"settings of the noise model {cls.name!r}"


def frame_generator(seed: int, frame: int, stream: int) -> np.random.Generator:
    """The generator of one image: any frame can be made again alone, in any order, on any worker."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, frame, stream])))


def gaussian(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """float32 samples of N(0, 1).

    The inverse of the normal distribution at the middle of 65536 equal steps, scaled to variance 1: four times as fast
    as `standard_normal`, whose stream numpy does not promise to keep, where that of raw integers it does. It reaches
    4.32 sigma; of a million samples of the continuous distribution 16 lie beyond.
    """
    return _inverse_normal().take(rng.integers(0, _LEVELS, shape, dtype=np.uint16), mode="clip")


@functools.cache
def _inverse_normal() -> np.ndarray:
    upper = np.array([NormalDist().inv_cdf((i + 0.5) / _LEVELS) for i in range(_LEVELS // 2, _LEVELS)])
    table = np.concatenate([-upper[::-1], upper])
    return read_only((table / np.sqrt(np.mean(table**2))).astype(np.float32))
