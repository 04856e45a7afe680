"""Depth noise as the released noisy frames of the original really contain it, measured on office kt3."""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from .depth_paper import KINECT_CM_PX, quantised
from .noise_model import NoiseModel, parameter
from .normals import backward_normals
from .randomness import gaussian
from .sampling import as_depth, pixel_grid, sample_with_zeros

_MEASURED = "measured on the official noisy office kt3 frames"


@dataclass(frozen=True)
class ReleasedDepthNoise(NoiseModel):
    """Beside the paper's words: a wider shift, half a pixel of offset, zeros that mix in, disparity biased by 1/2."""

    name = "released"
    summary = "the noise found in the released ICL-NUIM frames"

    sigma_s_px: float = parameter(1.15, "shift in u and v", unit="px", low=0.0, source=_MEASURED)
    offset_px: float = parameter(-0.5, "mean of the shift", unit="px", source=_MEASURED)
    missing_angle_deg: float = parameter(
        82.0, "pixels seen more obliquely go missing", unit="degrees", low=0.0, high=90.0, source=_MEASURED
    )
    sigma_d: float = parameter(
        1 / 6,
        "disparity noise",
        unit="disparity steps",
        low=0.0,
        source="paper, footnote 4; holds in the released frames too",
    )
    disparity_bias: float = parameter(
        0.5,
        "mean of the disparity noise",
        unit="disparity steps",
        source=_MEASURED + ": the sum of equation 3 rounded again",
    )
    disparity_cm: float = parameter(
        KINECT_CM_PX, "disparity times depth", unit="cm x disparity steps", low=1e-3, source="paper, equation 3"
    )
    input_step_m: float = parameter(0.01, "rounding before the disparity", unit="m", low=1e-6, source=_MEASURED)
    output_step_m: float = parameter(0.001, "steps that depth is cut to after it", unit="m", low=1e-6, source=_MEASURED)

    def apply(self, depth_z_m: np.ndarray, camera: PinholeCamera, rng: np.random.Generator) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32."""
        depth_z_m = self.without_oblique(as_depth(depth_z_m), camera)
        u, v = pixel_grid(depth_z_m)
        sigma, offset = np.float32(self.sigma_s_px), np.float32(self.offset_px)
        u = u + (offset + sigma * gaussian(rng, depth_z_m.shape))
        v = v + (offset + sigma * gaussian(rng, depth_z_m.shape))
        depth_z_m = sample_with_zeros(depth_z_m, u, v)
        depth_z_m = np.rint(depth_z_m / np.float32(self.input_step_m)) * np.float32(self.input_step_m)
        depth_z_m = quantised(depth_z_m, self.disparity_cm, self.sigma_d, rng, self.disparity_bias)
        return np.floor(depth_z_m / np.float32(self.output_step_m)) * np.float32(self.output_step_m)

    def without_oblique(self, depth_z_m: np.ndarray, camera: PinholeCamera) -> np.ndarray:
        """Pixels without a normal (first row and column) or seen at more than the limit become 0."""
        normals = backward_normals(depth_z_m, camera)
        return depth_z_m * (normals.secant <= 1 / np.cos(np.radians(self.missing_angle_deg)))
