"""Planes seen by a camera, the analytic ground on which noise is measured."""

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera


@pytest.fixture
def camera():
    return PinholeCamera.parse("320x240")


@pytest.fixture
def plane():
    """plane(camera, angle, depth): depth image (float32) of a plane turned about the camera's y
    axis, `depth` metres away along the optical axis, its normal at `angle` degrees from that axis.
    """

    def make(camera, angle_deg, depth_m):
        normal = np.array([np.sin(np.radians(angle_deg)), 0.0, np.cos(np.radians(angle_deg))])
        along = camera.rays() @ normal
        return np.where(along > 1e-3, normal[2] * depth_m / np.maximum(along, 1e-3), 0).astype(
            np.float32
        )

    return make
