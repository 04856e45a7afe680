"""One frame of a sequence: RGB and depth through a sensor's noise to the pixels that are written."""

from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..sensor.models import DepthNoise, RgbNoise, depth_model, rgb_model
from ..sensor.randomness import DEPTH, RGB, frame_generator
from .depth_units import UNITS_PER_METRE, check_units, count_invalid, depth16_from_metres, invalid_after_noise


@dataclass(frozen=True)
class SequenceSettings:
    """What decides the pixels of a sequence, given its frames. The seed also of a user's own noise."""

    depth: DepthNoise = field(default_factory=lambda: depth_model("none"))
    rgb: RgbNoise = field(default_factory=lambda: rgb_model("none"))
    seed: int = 0
    depth_units_per_metre: float = UNITS_PER_METRE

    def __post_init__(self) -> None:
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or not 0 <= self.seed < 2**63:
            raise InputError("a seed as a whole number from 0 up", found=self.seed)
        check_units(self.depth_units_per_metre)

    def to_dict(self) -> dict:
        return {
            "depth_noise": {"model": self.depth.name, **self.depth.to_dict()},
            "rgb_noise": {"model": self.rgb.name, **self.rgb.to_dict()},
            "seed": self.seed,
            "depth_units_per_metre": self.depth_units_per_metre,
        }


def noisy_images(
    rgb: np.ndarray, depth_z_m: np.ndarray, camera: PinholeCamera, number: int, settings: SequenceSettings
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """One frame: (h, w, 3) uint8 colour, (h, w) uint16 depth, and how many pixels of depth became 0, by kind.

    Nothing but the arguments decides the result. Raises InputError where a user's own noise returns something else.
    """
    invalid = count_invalid(depth_z_m, settings.depth_units_per_metre)
    image = settings.rgb.apply(rgb, frame_generator(settings.seed, number, RGB))
    noisy_z_m = settings.depth.apply(depth_z_m, camera, frame_generator(settings.seed, number, DEPTH))
    _check(settings.rgb.name, image, rgb.shape, np.dtype(np.uint8))
    _check(settings.depth.name, noisy_z_m, depth_z_m.shape, np.floating)
    invalid |= invalid_after_noise(depth_z_m, noisy_z_m, settings.depth_units_per_metre)
    return image, depth16_from_metres(noisy_z_m, settings.depth_units_per_metre), invalid


def _check(name: str, array: object, shape: tuple[int, ...], kind: type | np.dtype) -> None:
    if not isinstance(array, np.ndarray) or array.shape != shape or not np.issubdtype(array.dtype, kind):
        expected = f"an array {shape} of {'float' if kind is np.floating else kind} from the noise {name}"
        raise InputError(expected, found=f"{getattr(array, 'shape', '')} {getattr(array, 'dtype', type(array))}")
