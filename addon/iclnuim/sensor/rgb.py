"""RGB noise models: none, the paper's, and that of the released frames. All convert scene-linear
light to an 8-bit image.

The paper's noise is added to the light, before the sRGB transfer function: read and shot noise
arise in the sensor, whose response the paper assumes to be linear, and only there their variances
can be added. The noise of the released frames was measured on the final 8-bit values, and is added
to these.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..settings import parameter
from .depth_image import bands
from .noise_model import NoiseModel, gaussian
from .transfer import srgb8, srgb8_in_place

#: Infinite light would have infinite noise.
_BRIGHTEST = np.float32(np.finfo(np.float16).max)
_MEASURED = "measured on 15 pairs of official clean and noisy office frames, quantisation included"
_CHOSEN = (
    "the paper prints none; such that a mid grey of 128 has the standard deviation of the released "
    "frames, 2 of 255, and black that of about one step"
)


@dataclass(frozen=True)
class NoRgbNoise(NoiseModel):
    """No noise: scene-linear RGB through the sRGB transfer function."""

    name = "none"
    summary = "scene-linear light to sRGB, nothing else"

    exposure: float = parameter(
        1.0, "gain before noise and clipping", low=1e-6, source="1: as rendered"
    )

    def apply(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) scene-linear light, 1 = white -> (h, w, 3) uint8."""
        return srgb8(_exposed(light, self.exposure))


@dataclass(frozen=True)
class PaperRgbNoise(NoiseModel):
    """Section V.B with the noise level function of its reference [5]: variance sigma_c^2 + I
    sigma_s^2, where I is linear light.
    """

    name = "paper"
    summary = "the paper's model: intensity-dependent noise through a camera response"

    exposure: float = parameter(
        1.0, "gain before noise and clipping", low=1e-6, source="1: as rendered"
    )
    sigma_c: float = parameter(0.0005, "read noise", unit="share of white", low=0.0, source=_CHOSEN)
    sigma_s: float = parameter(
        0.0156, "shot noise at white", unit="share of white", low=0.0, source=_CHOSEN
    )

    def apply(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) scene-linear light, 1 = white -> (h, w, 3) uint8."""
        light = _exposed(light, self.exposure)
        image = np.empty(light.shape, np.uint8)
        for rows in bands(len(light)):
            # NaN becomes 0
            seen = np.fmax(light[rows].astype(np.float32), np.float32(0))
            seen = np.minimum(seen, _BRIGHTEST, out=seen)
            image[rows] = srgb8_in_place(self.noisy_light(seen, rng))
        return image

    def noisy_light(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """float32 light >= 0, any shape -> the same shape with read and shot noise added."""
        sigma = np.sqrt(np.float32(self.sigma_c**2) + light * np.float32(self.sigma_s**2))
        return light + sigma * gaussian(rng, light.shape)


@dataclass(frozen=True)
class ReleasedRgbNoise(NoiseModel):
    """Variance a + b I of the 8-bit value I; neighbours in a row are correlated; values are rounded
    down.
    """

    name = "released"
    summary = "the noise found in the released ICL-NUIM frames"

    exposure: float = parameter(
        1.0, "gain before noise and clipping", low=1e-6, source="1: as rendered"
    )
    variance: tuple[float, float, float] = parameter(
        (1.48, 0.95, 1.61),
        "variance at black, in R, G, B",
        unit="8-bit steps^2",
        low=0.0,
        source=_MEASURED,
    )
    variance_per_value: tuple[float, float, float] = parameter(
        (0.0266, 0.0105, 0.0246),
        "growth of the variance with the value, in R, G, B",
        unit="8-bit steps",
        low=0.0,
        source=_MEASURED,
    )
    correlation_1px: float = parameter(
        0.6, "correlation of neighbours in a row", low=0.0, high=1.0, source=_MEASURED
    )
    correlation_2px: float = parameter(
        0.2, "correlation of pixels two apart in a row", low=0.0, high=1.0, source=_MEASURED
    )

    def apply(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) scene-linear light, 1 = white -> (h, w, 3) uint8."""
        image = srgb8(_exposed(light, self.exposure))
        noisy = np.empty_like(image)
        growth = np.outer(self.variance_per_value, np.arange(256))
        variance = growth + np.array(self.variance)[:, None]
        # (3, 256), for each value: rounding down adds the remaining variance of 1/12
        sigma = np.sqrt(np.maximum(variance - 1 / 12, 0)).astype(np.float32)
        for k in range(3):
            for rows in bands(len(image)):
                clean = np.ascontiguousarray(image[rows, :, k])
                values = sigma[k].take(clean, mode="clip") * self.noise(clean.shape, rng)
                values += clean
                # a conversion to integers cuts off what rounding down would, as nothing is below 0
                noisy[rows, :, k] = np.clip(values, 0, 255, out=values)
        return noisy

    def noise(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """(h, w) float32 samples of N(0, 1), correlated along rows: a, b, c times each of three
        neighbours, of w + 2 in a row.
        """
        a, b, c = self.neighbour_weights()
        independent = gaussian(rng, (shape[0], shape[1] + 2))
        mixed = a * independent
        # one row after the other in memory, which is twice as fast; the two sums at the end of each
        # row are not used
        mixed.ravel()[:-1] += b * independent.ravel()[1:]
        mixed.ravel()[:-2] += c * independent.ravel()[2:]
        return mixed[:, :-2]

    def neighbour_weights(self) -> tuple[np.float32, np.float32, np.float32]:
        """(a, b, c) with a^2 + b^2 + c^2 = 1, ab + bc = correlation at 1 px, ac = correlation at 2
        px.

        With s = a + c the first two give s^4 - (1 + 2 r2) s^2 + r1^2 = 0.
        """
        r1 = self.correlation_1px
        r2 = self.correlation_2px
        root = (1 + 2 * r2) ** 2 - 4 * r1 * r1
        s_squared = (1 + 2 * r2 + np.sqrt(max(root, 0))) / 2
        if root < 0 or s_squared < 4 * r2:
            raise InputError(
                "correlations that three neighbouring pixels can have", found=f"{r1:g} and {r2:g}"
            )
        s = np.sqrt(s_squared)
        a = (s + np.sqrt(s_squared - 4 * r2)) / 2
        return np.float32(a), np.float32(r1 / s), np.float32(s - a)


def _exposed(light: np.ndarray, exposure: float) -> np.ndarray:
    if light.ndim != 3 or light.shape[2] != 3:
        raise InputError("an image (h, w, 3)", found=light.shape)
    if exposure == 1:
        return light
    return np.asarray(light, np.float32) * np.float32(exposure)
