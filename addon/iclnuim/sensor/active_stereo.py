"""Depth noise of an active stereo camera, by its published characterisation: the RealSense D435.

Left and right imager look at a scene with a projected infrared pattern. Depth belongs to the left
one. What follows from the geometry of two imagers (error that grows with Z^2, shortest distance,
shadow of the baseline, band at the left edge) is computed; what is only known to happen (fat edges,
lost matches on dark, oblique and shining surfaces) has parameters that are guesses where the source
says so.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from ..settings import parameter, same_as
from . import depth_image as images
from .appearance import WHITE_ALBEDO, SurfaceAppearance, required
from .depth import PaperDepthNoise
from .noise_model import NoiseModel, gaussian
from .windows import correlated, largest

_TUNING = (
    "A. Grunnet-Jepsen, J. N. Sweetser, J. Woodfill: Tuning depth cameras for best performance, "
    "Intel"
)
_SUBPIXEL = "A. Grunnet-Jepsen and others: Subpixel linearity improvement for D400, Intel"
_DATASHEET = "Intel RealSense D400 series data sheet"
_RANGE = (
    "Keselman, Woodfill, Grunnet-Jepsen, Bhowmik, CVPR Workshops 2017, section 4.2.8, of the R200: "
    "the range grows with the root of albedo times cosine"
)
_HALMETSCHLAGER = (
    "Halmetschlager-Funek, Suchi, Kampel, Vincze, IEEE Robotics and Automation Magazine 2019, "
    "table 2"
)


@dataclass(frozen=True)
class D435DepthNoise(NoiseModel):
    """sigma_Z = Z^2 s / (f b) with focal length f and baseline b of the device, also on images of
    another camera; lengths in pixels are scaled by the ratio of the focal lengths.
    """

    name = "d435"
    summary = "active stereo, RealSense D435 by published characterisation (asks for colour)"
    asks_appearance = True

    focal_px: float = parameter(
        424.0,
        "f of the device",
        unit="px",
        low=1.0,
        source=_TUNING + ": 848 / 2 / tan(90 degrees / 2)",
    )
    baseline_m: float = parameter(
        0.05, "b of the device", unit="m", low=1e-4, source=_TUNING + ": 50 mm"
    )
    subpixel_px: float = parameter(
        0.08,
        "s, standard deviation of a match",
        unit="px",
        low=0.0,
        source=_TUNING + ": the curves' value; below 0.1 on good texture, 0.2 asks for calibration",
    )
    step_px: float = parameter(
        1 / 32, "rounding of the disparity", unit="px", low=1e-6, source=_SUBPIXEL
    )
    depth_step_m: float = parameter(
        0.001, "rounding of the depth", unit="m", low=1e-6, source=_DATASHEET + ": depth units"
    )
    window_px: float = parameter(
        9.0,
        "side of the matching window, over which the error is correlated",
        unit="px",
        low=1.0,
        high=64.0,
        source="censususize of Intel's presets; that the error is correlated over it: a guess",
    )
    search_px: float = parameter(
        126.0,
        "largest disparity: nearer than f b / this is missing",
        unit="px",
        low=1.0,
        source=_TUNING,
    )
    far_m: float = parameter(
        10.0, "farther is missing", unit="m", low=1e-3, source=_DATASHEET + ": range"
    )
    pattern_range_m: float = parameter(
        10.0,
        "distance at which the pattern is just seen on a white wall",
        unit="m",
        low=1e-3,
        source="a guess: the data sheet's range; its law: " + _RANGE,
    )
    illumination: float = parameter(
        0.4,
        "brightness of a white surface, where no albedo is given",
        unit="share of white",
        low=1e-3,
        source="a guess: rooms reflect about 0.45, and frames of the office are 0.17 bright",
    )
    texture: float = parameter(
        0.1,
        "change of brightness within the window that is matched without a pattern",
        unit="share of the brightness",
        low=0.0,
        source="a guess",
    )
    fat_px: float = parameter(
        2.0,
        "growth of foreground edges",
        unit="px",
        low=0.0,
        high=64.0,
        source="a guess: half of half a window",
    )
    ragged_px: float = parameter(
        1.0,
        "lateral noise of edges",
        unit="px",
        low=0.0,
        source=_HALMETSCHLAGER + ": 1 px below 0.7 m; farther: a guess",
    )
    missing_angle_deg: float = parameter(
        80.0,
        "pixels at a larger angle between normal and ray are missing",
        unit="degrees",
        low=0.0,
        high=90.0,
        source="a guess",
    )
    edge_share: float = same_as(PaperDepthNoise, "edge_share")

    def apply(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance | None = None,
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32. Raises
        InputError without `appearance`.
        """
        appearance = required(appearance, self.name)
        depth_true_m = images.as_depth(depth_z_m)
        scale = camera.fx / self.focal_px
        ragged = [self.ragged_px * gaussian(rng, depth_true_m.shape) for _ in range(2)]
        error = correlated(rng, depth_true_m.shape, self.window_px * scale)
        matched = self.is_matched(depth_true_m, camera, appearance)
        depth_z_m, source = self.with_fat_edges(depth_true_m, ragged, scale)
        seen = matched.ravel().take(source) & self.is_seen_twice(depth_z_m, camera)
        return np.where(seen, self.measured(depth_z_m, error), np.float32(0))

    def measured(self, depth_z_m: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Depth of the disparity with error times s, rounded; 0 beyond the device's range."""
        f_b = np.float32(self.focal_px * self.baseline_m)
        step_px = np.float32(self.step_px)
        step_m = np.float32(self.depth_step_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            disparity = f_b / depth_z_m + np.float32(self.subpixel_px) * error
            disparity = np.rint(disparity / step_px) * step_px
            noisy_m = np.rint(f_b / disparity / step_m) * step_m
        inside = (disparity > 0) & (disparity <= self.search_px) & (noisy_m <= self.far_m)
        return np.where(inside, noisy_m, np.float32(0))

    def is_matched(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, appearance: SurfaceAppearance
    ) -> np.ndarray:
        """Whether a surface (h, w) shows the pattern or a texture, and neither shines nor is too
        oblique.
        """
        cosine = appearance.cosine(depth_z_m, camera)
        pattern_m2 = np.float32(self.pattern_range_m**2 / WHITE_ALBEDO)
        reflected = appearance.reflectance(self.illumination) * cosine
        matched = depth_z_m * depth_z_m <= pattern_m2 * reflected
        if not matched[depth_z_m > 0].all():
            reach = max(1, round(self.window_px * camera.fx / self.focal_px / 2))
            matched |= self.has_texture(appearance.brightness, reach)
        matched &= cosine >= np.cos(np.radians(self.missing_angle_deg))
        return matched & ~appearance.saturated

    def has_texture(self, brightness: np.ndarray, reach: int) -> np.ndarray:
        """Whether the brightness (h, w) changes along the row, the direction of the search, by more
        than a share of itself within `reach` pixels.
        """
        darkest = -largest(-brightness, reach)
        return largest(brightness, reach) - darkest > self.texture * brightness

    def with_fat_edges(
        self, depth_z_m: np.ndarray, ragged: list[np.ndarray], scale: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Foreground grown over the background and ragged, (h, w), and the index of the pixel that
        each depth is from. A surface itself stays as it is.
        """
        height, width = depth_z_m.shape
        reach = round(self.fat_px * scale)
        own = np.arange(height * width).reshape(height, width)
        with np.errstate(divide="ignore"):
            nearness = np.where(depth_z_m > 0, 1 / depth_z_m, np.float32(0))
        share = np.float32(1 + self.edge_share)
        zone = largest(nearness, reach + round(4 * self.ragged_px * scale)) > nearness * share
        place = np.flatnonzero(zone)
        if not place.size:
            return depth_z_m, own
        row, column = np.divmod(place, width)
        shift_u, shift_v = (np.rint(shift.ravel()[place] * scale).astype(int) for shift in ragged)
        best = place.copy()
        flat = nearness.ravel()
        for dv in range(-reach, reach + 1):
            for du in range(-reach, reach + 1):
                v = np.clip(row + shift_v + dv, 0, height - 1)
                u = np.clip(column + shift_u + du, 0, width - 1)
                other = v * width + u
                best = np.where(flat[other] > flat[best] * share, other, best)
        own.ravel()[place] = best
        return depth_z_m.ravel().take(own), own

    def is_seen_twice(self, depth_z_m: np.ndarray, camera: PinholeCamera) -> np.ndarray:
        """Whether the right imager sees a point (h, w) too: not outside its image, at the left
        edge, and not behind a nearer surface, whose shadow is on its left side.

        Of the points of a row that land on the same pixel of the right image, the rightmost is the
        nearest one, and is written last.
        """
        height, width = depth_z_m.shape
        f_b = np.float32(camera.fx * self.baseline_m)
        known = depth_z_m > 0
        disparity = np.divide(f_b, depth_z_m, out=np.zeros_like(depth_z_m), where=known)
        right_u = np.arange(width, dtype=np.float32) - disparity
        inside = known & (right_u >= 0)
        nearest = np.zeros(height * (width + 1), np.float32)
        place = np.maximum(right_u, 0).astype(np.intp)
        place += (width + 1) * np.arange(height)[:, None]
        written = place[inside]
        front = nearest.copy()
        front[written] = disparity[inside]
        nearest[written + 1] = disparity[inside]
        np.maximum(front, nearest, out=front)
        # neighbours on one surface differ by less than a pixel of disparity
        hidden = np.maximum(front.take(place), front.take(place + 1)) > disparity + 1
        return inside & ~hidden
