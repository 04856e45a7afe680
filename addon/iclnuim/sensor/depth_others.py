"""Depth noise that users know from elsewhere: none at all, Nguyen's Kinect, the Redwood simulation."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from .noise_model import NoiseModel, parameter
from .normals import surface_normals
from .randomness import gaussian
from .sampling import as_depth, pixel_grid, sample_within_surface

_NGUYEN = "C. V. Nguyen, S. Izadi, D. Lovell: Modeling Kinect sensor noise ..., 3DIMPVT 2012"
_REDWOOD = (
    "S. Choi, Q.-Y. Zhou, V. Koltun: Robust reconstruction of indoor scenes, CVPR 2015, simulated depth of its data set"
)


@dataclass(frozen=True)
class NoDepthNoise(NoiseModel):
    """Depth as rendered."""

    name = "none"
    summary = "exact planar depth"

    def apply(self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same, float32."""
        return as_depth(depth_z_m)


@dataclass(frozen=True)
class Kinect2012DepthNoise(NoiseModel):
    """Axial sigma a + b (z - c)^2 + d / sqrt(z) t^2 / (pi/2 - t)^2, lateral sigma e + f t / (pi/2 - t).

    t is the angle between normal and camera ray.
    """

    name = "kinect2012"
    summary = "axial and lateral noise of a Kinect, Nguyen et al. 2012"

    axial_m: float = parameter(0.0012, "a", unit="m", low=0.0, source=_NGUYEN)
    axial_per_m: float = parameter(0.0019, "b", unit="1/m", low=0.0, source=_NGUYEN)
    axial_nearest_m: float = parameter(0.4, "c", unit="m", low=0.0, source=_NGUYEN)
    axial_angle: float = parameter(0.0001, "d", unit="m^(3/2)", low=0.0, source=_NGUYEN)
    lateral_px: float = parameter(0.8, "e", unit="px", low=0.0, source=_NGUYEN)
    lateral_angle_px: float = parameter(0.035, "f", unit="px", low=0.0, source=_NGUYEN)
    missing_angle_deg: float = parameter(
        82.0,
        "pixels seen more obliquely go missing, as the formulas grow without end",
        unit="degrees",
        low=0.0,
        high=89.9,
        source="limit as in the model released",
    )
    edge_share: float = parameter(
        0.1,
        "neighbours that differ by more are another surface",
        unit="share of depth",
        low=1e-6,
        source="own choice",
    )

    def apply(self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_true_m = as_depth(depth_z_m)
        limit = np.float32(np.radians(self.missing_angle_deg))
        angle = surface_normals(depth_true_m, camera).angle_rad()
        seen = angle <= limit
        angle = np.minimum(angle, limit)
        u, v = pixel_grid(depth_true_m)
        lateral = self.lateral_sigma_px(angle)
        u = u + lateral * gaussian(rng, depth_true_m.shape)
        v = v + lateral * gaussian(rng, depth_true_m.shape)
        depth_z_m = sample_within_surface(depth_true_m, u, v, self.edge_share)
        noisy_m = depth_z_m + self.axial_sigma_m(depth_z_m, angle) * gaussian(rng, depth_true_m.shape)
        return np.where(seen & (depth_z_m > 0) & (noisy_m > 0), noisy_m, np.float32(0))

    def axial_sigma_m(self, depth_z_m: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
        """Along the optical axis, metres."""
        growth = angle_rad / (np.float32(np.pi / 2) - angle_rad)
        flat = self.axial_m + self.axial_per_m * (depth_z_m - self.axial_nearest_m) ** 2
        return flat + self.axial_angle / np.sqrt(np.maximum(depth_z_m, np.float32(0.01))) * growth**2

    def lateral_sigma_px(self, angle_rad: np.ndarray) -> np.ndarray:
        """Across it, pixels."""
        return self.lateral_px + self.lateral_angle_px * angle_rad / (np.float32(np.pi / 2) - angle_rad)


@dataclass(frozen=True)
class RedwoodDepthNoise(NoiseModel):
    """Shift rounded and snapped to even pixels, distortion by a map, disparity noise, rounding to 1/8 step."""

    name = "redwood"
    summary = "distortion and quantisation of the Redwood simulation, Choi et al. 2015"

    sigma_s_px: float = parameter(0.25, "shift in u and v", unit="px", low=0.0, source=_REDWOOD)
    snap_px: float = parameter(
        2, "rows and columns are cut to multiples of it", unit="px", low=1.0, high=64.0, source=_REDWOOD
    )
    far_m: float = parameter(10.0, "nothing is measured from here on", unit="m", low=1e-3, source=_REDWOOD)
    disparity_m: float = parameter(
        35.130, "disparity times depth", unit="m x disparity steps", low=1e-6, source=_REDWOOD
    )
    sigma_d: float = parameter(0.027778, "disparity noise", unit="disparity steps", low=0.0, source=_REDWOOD)
    steps: float = parameter(8.0, "rounding of disparity", unit="per disparity step", low=1e-3, source=_REDWOOD)
    map_first_m: float = parameter(1.0, "depth of the distortion map's first layer", unit="m", low=0.0, source=_REDWOOD)
    map_step_m: float = parameter(2.0, "depth between two of its layers", unit="m", low=1e-6, source=_REDWOOD)

    def apply(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        multipliers: np.ndarray | None = None,
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32.

        `multipliers` (layers, rows, columns), the sensor's own distortion: depth is divided by the value found there,
        the nearest over the image, linear over depth. None is a sensor without distortion.
        """
        depth_z_m = self.snapped(as_depth(depth_z_m), rng)
        depth_z_m[depth_z_m >= self.far_m] = 0
        if multipliers is not None:
            depth_z_m = depth_z_m / self.distortion(depth_z_m, np.asarray(multipliers, np.float32))
        disparity_m, steps = np.float32(self.disparity_m), np.float32(self.steps)
        with np.errstate(divide="ignore"):
            disparity = disparity_m / depth_z_m + np.float32(self.sigma_d) * gaussian(rng, depth_z_m.shape)
            disparity = np.floor(disparity * steps + np.float32(0.5)) / steps
            noisy_m = disparity_m / disparity
        noisy_m[~((disparity > 0) & (disparity < np.inf))] = 0
        return noisy_m

    def snapped(self, depth_z_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The pixel at the rounded shifted position, its row and column cut to multiples of `snap_px`."""
        height, width = depth_z_m.shape
        u, v = pixel_grid(depth_z_m)
        sigma, snap = np.float32(self.sigma_s_px), int(self.snap_px)
        column = np.clip(np.rint(u + sigma * gaussian(rng, depth_z_m.shape)), 0, width - 1).astype(np.intp)
        row = np.clip(np.rint(v + sigma * gaussian(rng, depth_z_m.shape)), 0, height - 1).astype(np.intp)
        return depth_z_m[row - row % snap, column - column % snap]

    def distortion(self, depth_z_m: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """The map's value at each pixel and depth."""
        if multipliers.ndim != 3 or not (multipliers > 0).all():
            raise InputError("a distortion map (layers, rows, columns) of values > 0", found=multipliers.shape)
        layers, rows, columns = multipliers.shape
        height, width = depth_z_m.shape
        row, column = np.arange(height)[:, None] * rows // height, np.arange(width)[None] * columns // width
        layer = np.clip((depth_z_m - np.float32(self.map_first_m)) / np.float32(self.map_step_m), 0, layers - 1)
        below = np.minimum(layer.astype(np.intp), max(layers - 2, 0))
        above = np.minimum(below + 1, layers - 1)
        share: np.ndarray = layer - below.astype(np.float32)
        return multipliers[below, row, column] * (1 - share) + multipliers[above, row, column] * share
