"""Structured-light disparity: depth in whole steps of baseline x focal length / depth."""

from __future__ import annotations

import numpy as np

from .randomness import gaussian

#: Paper, equation 3, from the Kinect's baseline (Barron and Malik 2013): disparity = 35130 / Z with Z in centimetres.
KINECT_CM_PX = 35130.0


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
