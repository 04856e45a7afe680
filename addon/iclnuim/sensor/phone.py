"""Depth of a phone with LiDAR: a small, smooth image that is filled from a grid of dots along the
edges of the colour image. Apple prints little of it: most numbers here are guesses and say so.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera, nearest_pixels
from ..settings import parameter, same_as
from . import depth_image as images
from .active_stereo import D435DepthNoise
from .appearance import SurfaceAppearance, required
from .noise_model import NoiseModel, gaussian

_LUETZENBURG = (
    "Luetzenburg, Kroon, Bjork: Evaluation of the Apple iPhone 12 Pro LiDAR, Scientific Reports "
    "2021, 11:22221"
)
#: Confidence of a pixel, as ARKit numbers it.
LOW = 0
MEDIUM = 1
HIGH = 2


@dataclass(frozen=True)
class PhoneDepthNoise(NoiseModel):
    """Dots have sigma = a + b r on a ray of length r. The inverse depth of a pixel is a mean of the
    nine nearest dots, weighted by a quadratic B-spline of the distance, which keeps planes as they
    are, and by the likeness of their brightness.
    """

    name = "phone"
    summary = "LiDAR of a phone, 256 x 192 (asks for colour; most numbers are guesses)"
    asks_appearance = True
    gives_confidence = True

    size: str = parameter(
        "image",
        "size of the depth image",
        choices={"image": "that of the given depth", "native": "the phone's own, for arrays"},
        source="own choice",
    )
    width: int = parameter(
        256,
        "width of the phone's depth image; its height is in proportion, 192 for 4:3",
        unit="px",
        low=2,
        high=8192,
        source="Apple: ARKit's sceneDepth",
    )
    dots: int = parameter(
        24,
        "dots in a row and in a column",
        low=2,
        high=512,
        source="576 dots, " + _LUETZENBURG + "; as a square grid: published teardowns",
    )
    sigma_m: float = parameter(
        0.004,
        "sigma of a dot: constant part",
        unit="m",
        low=0.0,
        source="a guess, within the 1 cm that Luetzenburg and others print",
    )
    sigma_per_m: float = parameter(
        0.004,
        "sigma of a dot: part that grows with the distance",
        unit="m/m",
        low=0.0,
        source="a guess",
    )
    range_m: float = parameter(
        5.0,
        "distance to which dots return from a surface of albedo 0.2; others in proportion to the "
        "root",
        unit="m",
        low=1e-3,
        source=_LUETZENBURG + ": 5 m; its albedo and law: a guess",
    )
    illumination: float = same_as(D435DepthNoise, "illumination")
    likeness: float = parameter(
        0.08,
        "difference of brightness at which a dot counts e^-1/2",
        unit="share of white's square root",
        low=1e-4,
        source="a guess",
    )
    high_spread: float = parameter(
        0.03,
        "dots that differ less have high confidence",
        unit="share of depth",
        low=0.0,
        source="a guess: Apple prints no meaning of its three levels",
    )
    low_spread: float = parameter(
        0.1,
        "dots that differ more have low confidence",
        unit="share of depth",
        low=0.0,
        source="a guess",
    )

    def apply(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance | None = None,
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> float32 of the same size, each pixel that
        of the phone's nearest one, or of the phone's size. Raises InputError without `appearance`.
        """
        return self.measured(depth_z_m, camera, rng, appearance)[0]

    def measured(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """What `apply` returns, and its confidence, uint8, of the same size."""
        small_m, confidence = self.with_confidence(depth_z_m, camera, rng, appearance)
        if self.size == "native":
            return small_m, confidence
        rows, columns = (
            nearest_pixels(here, there)
            for here, there in zip(small_m.shape, depth_z_m.shape, strict=True)
        )
        place = np.ix_(rows, columns)
        return small_m[place], confidence[place]

    def with_confidence(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth in metres and confidence (0 low, 1 medium, 2 high) of the phone's size, float32 and
        uint8.
        """
        appearance = required(appearance, self.name)
        depth_z_m = images.as_depth(depth_z_m)
        inverse, light = self.dots_of(depth_z_m, camera, rng, appearance)
        native = self.native_camera(camera)
        rows = nearest_pixels(camera.height, native.height)
        columns = nearest_pixels(camera.width, native.width)
        guide = np.sqrt(appearance.brightness[np.ix_(rows, columns)])
        return self.filled(inverse, light, guide)

    def native_camera(self, camera: PinholeCamera) -> PinholeCamera:
        """The camera of the phone's image, which is not larger than the given one."""
        return camera.narrowed(self.width)

    def share_of_variance(self, camera: PinholeCamera) -> np.ndarray:
        """(h, w) of the image's size: the variance of a pixel's inverse depth by that of a dot, on
        a wall of one brightness; NaN at the border, where the grid is extended.
        """
        native = self.native_camera(camera)
        shares = []
        for length, small in ((camera.height, native.height), (camera.width, native.width)):
            nearest, weights = _spline(small, self.dots)
            share = np.square(weights).sum(0)
            share[(nearest == 0) | (nearest == self.dots - 1)] = np.nan
            shares.append(share[nearest_pixels(small, length)])
        return shares[0][:, None] * shares[1]

    def dots_of(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inverse depth in 1/m (dots, dots), 0 where none returns, and the root of the brightness
        there.
        """
        grid = np.ix_(
            nearest_pixels(camera.height, self.dots), nearest_pixels(camera.width, self.dots)
        )
        x, y = images.ray_slopes(camera)
        ray_length = np.sqrt(1 + x * x + y * y)[grid]
        z = depth_z_m[grid]
        range_m = z * ray_length
        reflected = appearance.reflectance(self.illumination)[grid]
        reflected = reflected * appearance.cosine(depth_z_m, camera)[grid]
        returns = (z > 0) & (reflected * self.range_m**2 >= 0.2 * range_m**2)
        sigma_m = self.sigma_m + self.sigma_per_m * range_m
        noisy_m = (range_m + sigma_m * gaussian(rng, z.shape)) / ray_length
        returns &= noisy_m > 0
        inverse = np.divide(1, noisy_m, out=np.zeros_like(z), where=returns)
        return inverse, np.sqrt(appearance.brightness[grid])

    def filled(
        self, inverse: np.ndarray, light: np.ndarray, guide: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth in metres and confidence, of the size of `guide`, from the dots."""
        height, width = guide.shape
        v, row_weights = _spline(height, self.dots)
        u, column_weights = _spline(width, self.dots)
        inverse = _extended(inverse)
        light = np.pad(light, 1, mode="edge")
        steep = np.float32(-0.5 / self.likeness**2)
        total, support, mean, square = (np.zeros(guide.shape, np.float32) for _ in range(4))
        for i in range(3):
            for j in range(3):
                grid = np.ix_(v + i, u + j)
                dot = inverse[grid]
                near = row_weights[i][:, None] * column_weights[j] * (dot > 0)
                unlike = guide - light[grid]
                weight = near * np.exp(np.maximum(steep * unlike * unlike, np.float32(-30)))
                support += near
                total += weight
                mean += weight * dot
                square += weight * dot * dot
        some = total > 0
        total = np.where(some, total, np.float32(1))
        mean /= total
        depth_z_m = np.divide(1, mean, out=np.zeros_like(mean), where=mean > 0)
        variance = np.maximum(square / total - mean * mean, 0)
        spread = np.sqrt(variance) * depth_z_m
        return depth_z_m, self.confidence(spread, support)

    def confidence(self, spread: np.ndarray, support: np.ndarray) -> np.ndarray:
        """Of the relative spread of the dots and the share of them that returned."""
        level = np.full(spread.shape, MEDIUM, np.uint8)
        level[(spread < self.high_spread) & (support > 0.75)] = HIGH
        level[(spread > self.low_spread) | (support < 0.25)] = LOW
        return level


def _spline(length: int, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """For each of `length` pixels the nearest of `count` dots, and the weights of the dot before,
    that one and the dot after: a quadratic B-spline.
    """
    place = (np.arange(length) + 0.5) * count / length - 0.5
    nearest = np.clip(np.rint(place), 0, count - 1).astype(np.intp)
    off = (place - nearest).astype(np.float32)
    return nearest, [(0.5 - off) ** 2 / 2, 0.75 - off**2, (0.5 + off) ** 2 / 2]


def _extended(inverse: np.ndarray) -> np.ndarray:
    """(n, n) -> (n + 2, n + 2): the grid goes on in a straight line; 0 where a dot is missing."""
    for _ in range(2):
        first = np.where((inverse[0] > 0) & (inverse[1] > 0), 2 * inverse[0] - inverse[1], 0)
        last = np.where((inverse[-1] > 0) & (inverse[-2] > 0), 2 * inverse[-1] - inverse[-2], 0)
        inverse = np.vstack([np.maximum(first, 0), inverse, np.maximum(last, 0)]).T
    return inverse.astype(np.float32)
