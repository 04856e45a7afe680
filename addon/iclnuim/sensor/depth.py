"""Depth noise models: the paper's, that of the released frames, none, Nguyen's Kinect model, and
the Redwood simulation.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from ..settings import parameter, same_as
from . import depth_image as images
from .noise_model import NoiseModel, gaussian

#: Paper, equation 3, from the Kinect's baseline (Barron and Malik 2013): disparity = 35130 / Z with
#: Z in centimetres.
KINECT_CM_PX = 35130.0
_FITTED = (
    "the paper prints none; least-squares bilinear fit, over 0..75 degrees and 0.5..4.5 m, of the "
    "part of the axial noise that grows with the angle, "
    "0.0001 / sqrt(z) * angle^2 / (pi/2 - angle)^2 m (Nguyen, Izadi, Lovell 2012); "
    "its other part, which grows with the distance, is modelled by equation 3"
)
_NGUYEN = "C. V. Nguyen, S. Izadi, D. Lovell: Modeling Kinect sensor noise ..., 3DIMPVT 2012"
_REDWOOD = (
    "S. Choi, Q.-Y. Zhou, V. Koltun: Robust reconstruction of indoor scenes, CVPR 2015, "
    "simulated depth of its data set"
)
_MEASURED = "measured on the official noisy office kt3 frames"
_OBLIQUE = "pixels at a larger angle between normal and ray are missing"
_EDGE = "neighbours whose depth differs by more belong to another surface"


@dataclass(frozen=True)
class PaperDepthNoise(NoiseModel):
    """Section V.A. sigma_theta = a + b angle + c z + d angle z, at least 0; `angle` is between
    normal and camera ray.
    """

    name = "paper"
    summary = "the paper's model: lateral shift, disparity noise and quantisation"

    sigma_s_px: float = parameter(
        0.5, "shift in u and v", unit="px", low=0.0, source="paper, footnote 4"
    )
    sigma_d: float = parameter(
        1 / 6, "disparity noise", unit="disparity steps", low=0.0, source="paper, footnote 4"
    )
    disparity_cm: float = parameter(
        KINECT_CM_PX,
        "disparity times depth",
        unit="cm x disparity steps",
        low=1e-3,
        source="paper, equation 3",
    )
    edge_share: float = parameter(
        0.1, _EDGE, unit="share of depth", low=1e-6, source="own choice: 89 degrees here"
    )
    lateral: bool = parameter(
        True, "move each vertex along its normal", source="paper, section V.A, last paragraph"
    )
    sigma_theta_m: float = parameter(
        -4.04e-4, "sigma_theta: constant term", unit="m", source=_FITTED
    )
    sigma_theta_m_per_rad: float = parameter(
        1.118e-3, "sigma_theta: factor of angle", unit="m/rad", source=_FITTED
    )
    sigma_theta_m_per_m: float = parameter(
        6.26e-5, "sigma_theta: factor of depth", unit="m/m", source=_FITTED
    )
    sigma_theta_m_per_rad_m: float = parameter(
        -1.732e-4, "sigma_theta: factor of angle times depth", unit="m/(rad m)", source=_FITTED
    )
    missing_angle_deg: float = parameter(
        82.0, _OBLIQUE, unit="degrees", low=0.0, high=90.0, source=_MEASURED
    )

    def apply(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_true_m = images.as_depth(depth_z_m)
        # Z(x + n_x, y + n_y) of equation 3
        u, v = shifted_grid(depth_true_m, np.float32(self.sigma_s_px), rng)
        depth_z_m = images.sample_within_surface(depth_true_m, u, v, self.edge_share)
        depth_z_m = quantised(depth_z_m, self.disparity_cm, self.sigma_d, rng)
        if not self.lateral:
            return depth_z_m
        normals = images.surface_normals(depth_true_m, camera)
        depth_z_m = self.moved_along_normals(depth_z_m, normals, camera, rng)
        depth_z_m[normals.secant > 1 / np.cos(np.radians(self.missing_angle_deg))] = 0
        return depth_z_m

    def sigma_theta(self, angle_rad: np.ndarray, depth_z_m: np.ndarray) -> np.ndarray:
        """The standard deviation of the movement along the normal in metres, (h, w)."""
        at_zero = self.sigma_theta_m + self.sigma_theta_m_per_m * depth_z_m
        slope = self.sigma_theta_m_per_rad + self.sigma_theta_m_per_rad_m * depth_z_m
        return np.maximum(at_zero + slope * angle_rad, 0)

    def moved_along_normals(
        self,
        depth_z_m: np.ndarray,
        normals: images.Normals,
        camera: PinholeCamera,
        rng: np.random.Generator,
    ) -> np.ndarray:
        """Move each vertex along its normal by N(0, sigma_theta^2) and project it again.

        A vertex is assigned to the pixel nearest to its projection. If there are several, the one
        nearest to the camera is kept. A pixel without a vertex is missing. Vertices without a
        normal are missing.
        """
        x, y = images.ray_slopes(camera)
        noise = gaussian(rng, depth_z_m.shape)
        moved_z_m = np.empty_like(depth_z_m)
        shift_u = np.empty_like(depth_z_m)
        shift_v = np.empty_like(depth_z_m)
        for rows in images.bands(len(depth_z_m)):
            z = depth_z_m[rows]
            n = normals[rows]
            ray_length = np.sqrt(1 + x * x + y[rows] * y[rows])
            step_m = self.sigma_theta(n.angle_rad(), z) * noise[rows]
            # along N, which is not a unit vector: |N| = secant / ray_length
            step_m = step_m * ray_length / n.secant
            with np.errstate(invalid="ignore", divide="ignore"):
                moved = z + step_m * n.z
                shift_u[rows] = np.float32(camera.fx) * step_m * (n.x - x * n.z) / moved
                shift_v[rows] = np.float32(camera.fy) * step_m * (n.y - y[rows] * n.z) / moved
                moved_z_m[rows] = np.where((z > 0) & (moved > 0), moved, np.float32(0))
        return _projected(moved_z_m, shift_u, shift_v)


@dataclass(frozen=True)
class ReleasedDepthNoise(NoiseModel):
    """Differs from the paper: a wider shift with an offset of half a pixel, missing pixels
    interpolated as zeros, disparity biased by 1/2.
    """

    name = "released"
    summary = "the noise found in the released ICL-NUIM frames"

    sigma_s_px: float = parameter(1.15, "shift in u and v", unit="px", low=0.0, source=_MEASURED)
    offset_px: float = parameter(-0.5, "mean of the shift", unit="px", source=_MEASURED)
    missing_angle_deg: float = same_as(PaperDepthNoise, "missing_angle_deg")
    sigma_d: float = same_as(PaperDepthNoise, "sigma_d")
    disparity_bias: float = parameter(
        0.5,
        "mean of the disparity noise",
        unit="disparity steps",
        source=_MEASURED + "; equation 3 rounded again",
    )
    disparity_cm: float = same_as(PaperDepthNoise, "disparity_cm")
    input_step_m: float = parameter(
        0.01, "rounding before the disparity", unit="m", low=1e-6, source=_MEASURED
    )
    output_step_m: float = parameter(
        0.001, "steps that depth is cut to after it", unit="m", low=1e-6, source=_MEASURED
    )

    def apply(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_z_m = images.as_depth(depth_z_m)
        # the first row and column have no normals and are missing
        normals = images.surface_normals(depth_z_m, camera, backward=True)
        depth_z_m = depth_z_m * (normals.secant <= 1 / np.cos(np.radians(self.missing_angle_deg)))
        u, v = shifted_grid(depth_z_m, np.float32(self.sigma_s_px), rng, self.offset_px)
        depth_z_m = images.sample_with_zeros(depth_z_m, u, v)
        input_step_m = np.float32(self.input_step_m)
        depth_z_m = np.rint(depth_z_m / input_step_m) * input_step_m
        depth_z_m = quantised(depth_z_m, self.disparity_cm, self.sigma_d, rng, self.disparity_bias)
        output_step_m = np.float32(self.output_step_m)
        return np.floor(depth_z_m / output_step_m) * output_step_m


@dataclass(frozen=True)
class NoDepthNoise(NoiseModel):
    """Depth as rendered."""

    name = "none"
    summary = "exact planar depth"

    def apply(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same, float32."""
        return images.as_depth(depth_z_m)


@dataclass(frozen=True)
class Kinect2012DepthNoise(NoiseModel):
    """Axial sigma a + b (z - c)^2 + d / sqrt(z) t^2 / (pi/2 - t)^2, lateral sigma e + f t / (pi/2 -
    t).

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
        _OBLIQUE,
        unit="degrees",
        low=0.0,
        high=89.9,
        source="as in the model released; the formulas have a pole at 90",
    )
    edge_share: float = same_as(PaperDepthNoise, "edge_share")

    def apply(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_true_m = images.as_depth(depth_z_m)
        limit = np.float32(np.radians(self.missing_angle_deg))
        angle = images.surface_normals(depth_true_m, camera).angle_rad()
        seen = angle <= limit
        angle = np.minimum(angle, limit)
        from_grazing = np.float32(np.pi / 2) - angle
        lateral_px = self.lateral_px + self.lateral_angle_px * angle / from_grazing
        u, v = shifted_grid(depth_true_m, lateral_px, rng)
        depth_z_m = images.sample_within_surface(depth_true_m, u, v, self.edge_share)
        growth = angle / from_grazing
        root = np.sqrt(np.maximum(depth_z_m, np.float32(0.01)))
        of_distance_m = self.axial_m + self.axial_per_m * (depth_z_m - self.axial_nearest_m) ** 2
        axial_m = of_distance_m + self.axial_angle / root * growth**2
        noisy_m = depth_z_m + axial_m * gaussian(rng, depth_true_m.shape)
        return np.where(seen & (depth_z_m > 0) & (noisy_m > 0), noisy_m, np.float32(0))


@dataclass(frozen=True)
class RedwoodDepthNoise(NoiseModel):
    """Shift rounded and snapped to even pixels, disparity noise, rounding to 1/8 step.

    The simulation's distortion of a single sensor, which its authors measured, is left out.
    """

    name = "redwood"
    summary = "shift and quantisation of the Redwood simulation, Choi et al. 2015"

    sigma_s_px: float = parameter(0.25, "shift in u and v", unit="px", low=0.0, source=_REDWOOD)
    snap_px: float = parameter(
        2,
        "rows and columns are rounded down to multiples of it",
        unit="px",
        low=1.0,
        high=64.0,
        source=_REDWOOD,
    )
    far_m: float = parameter(
        10.0, "depth at or beyond this is missing", unit="m", low=1e-3, source=_REDWOOD
    )
    disparity_m: float = parameter(
        35.130, "disparity times depth", unit="m x disparity steps", low=1e-6, source=_REDWOOD
    )
    sigma_d: float = parameter(
        0.027778, "disparity noise", unit="disparity steps", low=0.0, source=_REDWOOD
    )
    steps: float = parameter(
        8.0,
        "levels that disparity is rounded to",
        unit="per disparity step",
        low=1e-3,
        source=_REDWOOD,
    )

    def apply(
        self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_z_m = self.snapped(images.as_depth(depth_z_m), rng)
        depth_z_m[depth_z_m >= self.far_m] = 0
        disparity_m = np.float32(self.disparity_m)
        steps = np.float32(self.steps)
        noise = np.float32(self.sigma_d) * gaussian(rng, depth_z_m.shape)
        with np.errstate(divide="ignore"):
            disparity = disparity_m / depth_z_m + noise
            # with the half, rounding down is rounding to the nearest level
            disparity = np.floor(disparity * steps + np.float32(0.5)) / steps
            noisy_m = disparity_m / disparity
        noisy_m[~((disparity > 0) & (disparity < np.inf))] = 0
        return noisy_m

    def snapped(self, depth_z_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Depth at the rounded shifted position, with row and column rounded down to multiples of
        `snap_px`.
        """
        height, width = depth_z_m.shape
        u, v = shifted_grid(depth_z_m, np.float32(self.sigma_s_px), rng)
        column = np.clip(np.rint(u), 0, width - 1).astype(np.intp)
        row = np.clip(np.rint(v), 0, height - 1).astype(np.intp)
        snap = int(self.snap_px)
        return depth_z_m[row - row % snap, column - column % snap]


def shifted_grid(
    depth_z_m: np.ndarray,
    sigma_px: np.ndarray | np.float32,
    rng: np.random.Generator,
    offset_px: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """u and v (h, w) of the pixel centres, with N(offset_px, sigma_px^2) added to each."""
    height, width = depth_z_m.shape
    u = np.arange(width, dtype=np.float32)[None]
    v = np.arange(height, dtype=np.float32)[:, None]
    u = u + (np.float32(offset_px) + sigma_px * gaussian(rng, depth_z_m.shape))
    return u, v + (np.float32(offset_px) + sigma_px * gaussian(rng, depth_z_m.shape))


def quantised(
    depth_z_m: np.ndarray,
    disparity_cm: float,
    sigma_d: float,
    rng: np.random.Generator,
    bias: float = 0.0,
) -> np.ndarray:
    """Convert depth to disparity, add N(bias, sigma_d^2), round to the nearest integer, and convert
    back to depth; 0 stays 0.

    Equation 3 of the paper: floor(d + noise + 0.5) is already the rounding. (Rounding that sum
    again causes the bias of the released frames.) Float32 in metres, (h, w). Pixels whose disparity
    is 0 or less are missing.
    """
    disparity_m = np.float32(disparity_cm / 100)
    with np.errstate(divide="ignore"):
        steps = disparity_m / depth_z_m
        steps += np.float32(sigma_d) * gaussian(rng, depth_z_m.shape) + np.float32(bias)
        # equation 3
        steps = np.floor(steps + np.float32(0.5))
        quantised_m = disparity_m / steps
    quantised_m[~((steps > 0) & (steps < np.inf))] = 0
    return quantised_m


def _projected(depth_z_m: np.ndarray, shift_u: np.ndarray, shift_v: np.ndarray) -> np.ndarray:
    """Move each pixel's depth to the pixel nearest to its shifted position.

    Depth that leaves the image is dropped.
    """
    height, width = depth_z_m.shape
    leaving = ((np.abs(shift_u) > 0.5) | (np.abs(shift_v) > 0.5)) & (depth_z_m > 0)
    result = depth_z_m.copy()
    result[leaving] = 0
    source = np.flatnonzero(leaving)
    # the nearest last, so that it is kept where several arrive
    source = source[np.argsort(-depth_z_m.ravel()[source], kind="stable")]
    right = np.rint(np.clip(shift_u.ravel()[source], -width, width)).astype(np.intp)
    down = np.rint(np.clip(shift_v.ravel()[source], -height, height)).astype(np.intp)
    column = source % width + right
    row = source // width + down
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    arrived = np.zeros_like(depth_z_m)
    arrived[row[inside], column[inside]] = depth_z_m.ravel()[source[inside]]
    in_front = (arrived > 0) & ((result == 0) | (arrived < result))
    result[in_front] = arrived[in_front]
    return result
