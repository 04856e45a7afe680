"""Ways to light the frames of a scene without a shipped light map, with their times and errors, and
which of them is chosen: the cheapest that holds a quality.

Errors are PSNR in dB of 8-bit sRGB, pooled over the pixels of several views: of a frame against the
one that infinitely many samples would give.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from .errors import InputError

_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_QUALITY = re.compile(r"(\d+(?:\.\d+)?) ?(dB|s|min|h)")
#: Numbers of samples of path tracing, each with twice the time of the one before. 1024 is the
#: reference in docs/measured/own_scenes.md.
PATH_SAMPLES = tuple(2**k for k in range(11))
#: Sides of light maps in texels.
MAP_SIZES = (256, 512, 1024, 2048)
#: The numbers of samples that are compared, each four times the one before: few where the look may
#: take little time.
FEW_COMPARED = (1, 4, 16)
COMPARED = (4, 16, 64)
#: Factors on the squared error for four times the samples: of independent samples, and of denoised
#: images, from 4 samples on (0.41 to 0.65 in docs/measured/own_scenes.md). That of the two
#: differences of a look tells less: a few pixels decide it, and the error left is a multiple of it.
_INDEPENDENT = 1 / 4
_DENOISED = 1 / 2
#: Squared 8-bit steps: the error of rounding two equal images, below which none is measured.
_ROUNDING = 1 / 12
#: PSNR of frames lit by a map with texels of 0.1 m, and its decrease for texels of ten times the
#: side: in the middle of the scenes of docs/measured/own_scenes.md.
_MAP_PSNR_DB = 36.0
_MAP_DB_PER_DECADE = 7.0


@dataclass(frozen=True)
class Quality:
    """What the frames of a run must hold: at least `psnr_db`, or all of them at most `time_s`
    seconds. One of them is None.
    """

    psnr_db: float | None = None
    time_s: float | None = None

    @classmethod
    def of(cls, text: str) -> Self:
        """From text such as 40dB, 90s, 10min, 2h. Raises InputError."""
        found = _QUALITY.fullmatch(text)
        if found is None or not float(found[1]):
            expected = "a PSNR such as 40dB, or a time such as 90s, 10min, 2h"
            raise InputError(expected, setting="quality", found=text)
        number = float(found[1])
        if found[2] == "dB":
            return cls(psnr_db=number)
        return cls(time_s=number * _SECONDS[found[2]])

    def is_held_by(self, way: "Way") -> bool:
        """Whether a way is expected to hold this quality."""
        if self.psnr_db is not None:
            return way.psnr_db >= self.psnr_db
        return way.time_s <= (self.time_s or 0.0)


@dataclass(frozen=True)
class Way:
    """A way to light a run: path tracing with `samples`, or a light map of `map_size` texels a
    side. time_s, psnr_db: of all its frames, as expected. core_s: its time on one core. bake_s: the
    part of time_s that is the bake of a map.
    """

    light: str
    samples: int
    map_size: int | None
    core_s: float
    time_s: float
    psnr_db: float
    bake_s: float = 0.0

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of a job that is lit in this way."""
        size = {} if self.map_size is None else {"map_size": self.map_size}
        return {"light": self.light, "samples": self.samples, **size}

    def __str__(self) -> str:
        if self.map_size is None:
            return f"path traced with {self.samples} sample{'s' * (self.samples != 1)}"
        return f"baked with a map of {self.map_size} texels a side"


def chosen(ways: Sequence[Way], quality: Quality) -> Way:
    """The cheapest way that holds a PSNR, or the best one within a time. If none holds it: the best
    way, or the fastest.
    """
    held = [way for way in ways if quality.is_held_by(way)]
    if quality.psnr_db is not None:
        return min(held, key=_cost) if held else max(ways, key=_gain)
    return max(held, key=_gain) if held else min(ways, key=_cost)


def _cost(way: Way) -> tuple[float, float]:
    return way.core_s, -way.psnr_db


def _gain(way: Way) -> tuple[float, float]:
    return way.psnr_db, -way.core_s


@dataclass(frozen=True)
class Convergence:
    """How the error of path tracing decreases: `square` is its mean squared error in 8-bit steps
    with `samples`, `ratio` the factor on it for four times the samples.
    """

    square: float
    ratio: float
    samples: int

    @classmethod
    def of(cls, images: Sequence[np.ndarray], samples: Sequence[int], denoised: bool) -> Self:
        """From 8-bit images with three numbers of samples, each four times the one before.

        The differences of later pairs are taken to continue as a geometric series, each correlated
        with the next as these two are. The error of the second image is their sum. So it is exact
        for independent samples (correlation 0), and for an error that decreases everywhere by the
        same factor (correlation 1).
        """
        few, some, many = images
        first, second = (max(square(*pair), _ROUNDING) for pair in ((few, some), (some, many)))
        ratio = _DENOISED if denoised else _INDEPENDENT
        correlation = (square(few, many) - first - second) / (2 * math.sqrt(first * second))
        shared = correlation * math.sqrt(ratio)
        sum_of_series = second / (1 - ratio) * (1 + shared) / (1 - shared)
        return cls(sum_of_series, ratio, samples[1])

    def psnr_db(self, samples: float) -> float:
        """The PSNR with this number of samples."""
        return psnr_db(self.square * self.ratio ** math.log(samples / self.samples, 4))


def psnr_db(square: float) -> float:
    """PSNR of a mean squared error of 8-bit steps; at most that of rounding two equal images."""
    return 10 * math.log10(255**2 / max(square, _ROUNDING))


def square(first: np.ndarray, second: np.ndarray) -> float:
    """The mean squared difference of two 8-bit images."""
    return float(((first.astype(np.float64) - second) ** 2).mean())


def map_psnr_db(texel_m: float) -> float:
    """The PSNR of frames lit by a map with texels of this side, before it is baked. Scenes differ by
    10 dB and more (docs/measured/own_scenes.md).
    """
    return _MAP_PSNR_DB - _MAP_DB_PER_DECADE * math.log10(texel_m / 0.1)
