"""Depth noise as the paper writes it: shift, disparity noise, rounding (equation 3), a step along the normal."""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from .noise_model import NoiseModel, parameter
from .normals import Normals, ray_slopes, surface_normals
from .randomness import gaussian
from .sampling import as_depth, bands, pixel_grid, sample_within_surface

#: Paper, equation 3, from the Kinect's baseline (Barron and Malik 2013): disparity = 35130 / Z with Z in centimetres.
KINECT_CM_PX = 35130.0
_NGUYEN = (
    "the paper prints none; least-squares bilinear fit, over 0..75 degrees and 0.5..4.5 m, of the part of the axial "
    "noise that grows with the angle, 0.0001 / sqrt(z) * angle^2 / (pi/2 - angle)^2 m (Nguyen, Izadi, Lovell 2012); "
    "its other part, which grows with the distance, is what equation 3 makes"
)


@dataclass(frozen=True)
class PaperDepthNoise(NoiseModel):
    """Section V.A. sigma_theta = a + b angle + c z + d angle z, never below 0, angle between normal and camera ray."""

    name = "paper"
    summary = "the paper's model: lateral shift, disparity noise and quantisation"

    sigma_s_px: float = parameter(0.5, "shift in u and v", unit="px", low=0.0, source="paper, footnote 4")
    sigma_d: float = parameter(1 / 6, "disparity noise", unit="disparity steps", low=0.0, source="paper, footnote 4")
    disparity_cm: float = parameter(
        KINECT_CM_PX, "disparity times depth", unit="cm x disparity steps", low=1e-3, source="paper, equation 3"
    )
    edge_share: float = parameter(
        0.1,
        "neighbours that differ by more are another surface",
        unit="share of depth",
        low=1e-6,
        source="own choice: 89 degrees at this camera",
    )
    lateral: bool = parameter(True, "the step along the normal", source="paper, section V.A, last paragraph")
    sigma_theta_m: float = parameter(-4.04e-4, "step along the normal, constant term", unit="m", source=_NGUYEN)
    sigma_theta_m_per_rad: float = parameter(1.118e-3, "its growth with the angle", unit="m/rad", source=_NGUYEN)
    sigma_theta_m_per_m: float = parameter(6.26e-5, "its growth with the depth", unit="m/m", source=_NGUYEN)
    sigma_theta_m_per_rad_m: float = parameter(-1.732e-4, "with both", unit="m/(rad m)", source=_NGUYEN)
    missing_angle_deg: float = parameter(
        82.0,
        "pixels seen more obliquely go missing",
        unit="degrees",
        low=0.0,
        high=90.0,
        source="the angle measured on the released frames",
    )

    def apply(self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_true_m = as_depth(depth_z_m)
        depth_z_m = self.shifted(depth_true_m, rng)
        depth_z_m = quantised(depth_z_m, self.disparity_cm, self.sigma_d, rng)
        if not self.lateral:
            return depth_z_m
        normals = surface_normals(depth_true_m, camera)
        depth_z_m = self.moved_along_normals(depth_z_m, normals, camera, rng)
        depth_z_m[normals.secant > 1 / np.cos(np.radians(self.missing_angle_deg))] = 0
        return depth_z_m

    def shifted(self, depth_z_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Z(x + n_x, y + n_y) of equation 3, with (n_x, n_y) ~ N(0, sigma_s^2 I)."""
        u, v = pixel_grid(depth_z_m)
        sigma = np.float32(self.sigma_s_px)
        u = u + sigma * gaussian(rng, depth_z_m.shape)
        v = v + sigma * gaussian(rng, depth_z_m.shape)
        return sample_within_surface(depth_z_m, u, v, self.edge_share)

    def sigma_theta(self, angle_rad: np.ndarray, depth_z_m: np.ndarray) -> np.ndarray:
        """Metres, (h, w)."""
        at_zero = self.sigma_theta_m + self.sigma_theta_m_per_m * depth_z_m
        slope = self.sigma_theta_m_per_rad + self.sigma_theta_m_per_rad_m * depth_z_m
        return np.maximum(at_zero + slope * angle_rad, 0)

    def moved_along_normals(
        self, depth_z_m: np.ndarray, normals: Normals, camera: PinholeCamera, rng: np.random.Generator
    ) -> np.ndarray:
        """Each vertex moves along its normal by N(0, sigma_theta^2) and is projected again.

        A vertex lands on the pixel nearest to its projection; of several the nearest to the camera stays, and a pixel
        where none lands is missing. Vertices without a normal go missing.
        """
        x, y = ray_slopes(camera)
        noise = gaussian(rng, depth_z_m.shape)
        moved_z_m, shift_u, shift_v = (np.empty_like(depth_z_m) for _ in range(3))
        for rows in bands(len(depth_z_m)):
            z, n = depth_z_m[rows], normals[rows]
            step_m = self.sigma_theta(n.angle_rad(), z) * noise[rows]
            step_m = step_m * np.sqrt(1 + x * x + y[rows] * y[rows]) / n.secant  # over |N|, which is not of length one
            with np.errstate(invalid="ignore", divide="ignore"):
                moved = z + step_m * n.z
                shift_u[rows] = np.float32(camera.fx) * step_m * (n.x - x * n.z) / moved
                shift_v[rows] = np.float32(camera.fy) * step_m * (n.y - y[rows] * n.z) / moved
                moved_z_m[rows] = np.where((z > 0) & (moved > 0), moved, np.float32(0))
        return _projected(moved_z_m, shift_u, shift_v)


def quantised(
    depth_z_m: np.ndarray, disparity_cm: float, sigma_d: float, rng: np.random.Generator, bias: float = 0.0
) -> np.ndarray:
    """Depth to disparity, plus N(bias, sigma_d^2), to the nearest integer, back to depth; 0 stays 0.

    Equation 3 of the paper: floor(d + noise + 0.5) is the rounding itself. (Rounding that sum again is the bias of the
    released frames.) Float32 in metres, (h, w). A disparity of 0 or less is no measurement.
    """
    disparity_m = np.float32(disparity_cm / 100)
    with np.errstate(divide="ignore"):
        steps = disparity_m / depth_z_m
        steps += np.float32(sigma_d) * gaussian(rng, depth_z_m.shape) + np.float32(bias)
        steps = np.floor(steps + np.float32(0.5))
        quantised_m = disparity_m / steps
    quantised_m[~((steps > 0) & (steps < np.inf))] = 0
    return quantised_m


def _projected(depth_z_m: np.ndarray, shift_u: np.ndarray, shift_v: np.ndarray) -> np.ndarray:
    """Each pixel's depth on the pixel nearest to where it was shifted; what leaves the image is lost."""
    height, width = depth_z_m.shape
    leaving = ((np.abs(shift_u) > 0.5) | (np.abs(shift_v) > 0.5)) & (depth_z_m > 0)
    result = depth_z_m.copy()
    result[leaving] = 0
    source = np.flatnonzero(leaving)
    source = source[np.argsort(-depth_z_m.ravel()[source], kind="stable")]  # the nearest last, so that it stays
    column = source % width + np.rint(np.clip(shift_u.ravel()[source], -width, width)).astype(np.intp)
    row = source // width + np.rint(np.clip(shift_v.ravel()[source], -height, height)).astype(np.intp)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    arrived = np.zeros_like(depth_z_m)
    arrived[row[inside], column[inside]] = depth_z_m.ravel()[source[inside]]
    in_front = (arrived > 0) & ((result == 0) | (arrived < result))
    result[in_front] = arrived[in_front]
    return result
