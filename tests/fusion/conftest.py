"""A small camera and surfaces whose depth follows from a formula."""

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

CAMERA = PinholeCamera(160, 120, 120.3, 120.0, 79.5, 59.5)


@pytest.fixture
def camera() -> PinholeCamera:
    return CAMERA


@pytest.fixture
def plane_depth():
    """Of the plane normal . p = normal . point, seen from T_world_camera."""

    def depth(normal, point, T_world_camera=None):
        T = SE3.identity() if T_world_camera is None else T_world_camera
        rays = CAMERA.rays() @ T.rotation.T
        z = (np.dot(normal, point) - np.dot(normal, T.translation)) / (
            rays @ np.asarray(normal, float)
        )
        return np.where(z > 0, z, 0).astype(np.float32)

    return depth


@pytest.fixture
def sphere_depth():
    """Of a sphere; 0 beside it."""

    def depth(centre, radius, T_world_camera=None):
        T = SE3.identity() if T_world_camera is None else T_world_camera
        rays = CAMERA.rays() @ T.rotation.T
        to_centre = np.asarray(centre, float) - T.translation
        a, b, c = (rays**2).sum(-1), rays @ to_centre, to_centre @ to_centre - radius**2
        inside = b * b - a * c
        return np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, 0).astype(np.float32)

    return depth


@pytest.fixture
def looking_at():
    """T_world_camera of a camera at `position` that looks at `target`, z up."""

    def pose(position, target):
        forward = np.asarray(target, float) - position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        return SE3(np.stack([right, np.cross(forward, right), forward], axis=1), position)

    return pose
