"""A textured box seen along a hand-held sort of motion: the scene of the tests of perturbations and
of stress.
"""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed")
from iclnuim.benchmark.perturbations.segment import Segment
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, stamps_of_frames
from iclnuim.sensor.transfer import srgb8

CAMERA = PinholeCamera.parse("160x120")
FRAMES = 48


def pose_at(stamp_s):
    start = SE3.from_quat_xyzw([-0.775, 0.281, -0.193, 0.532], [0.0, 0.0, 1.4])
    return start @ SE3.exp(
        (np.asarray(stamp_s, float)[..., None] - 1) * [0.2, 0.05, 0.15, 0.05, 0.2, 0.05]
    )


def look(T_world_camera):
    """Scene-linear light and planar depth of a box of 4 x 5 x 2.5 m."""
    rays = CAMERA.rays() @ T_world_camera.rotation.T
    walls = np.where(rays > 0, [2.0, 2.5, 2.5], [-2.0, -2.5, 0.0])
    depth_z_m = ((walls - T_world_camera.translation) / rays).min(axis=-1)
    points = T_world_camera.translation + rays * depth_z_m[..., None]
    light = (
        0.4 + 0.15 * np.sin(points * [7, 9, 11]) + 0.15 * np.sin(13 * points.sum(-1, keepdims=True))
    )
    return light.astype(np.float32), depth_z_m.astype(np.float32)


@pytest.fixture(scope="session")
def truth():
    stamps_s = stamps_of_frames(np.arange(FRAMES))
    return Trajectory(stamps_s, pose_at(stamps_s))


@pytest.fixture(scope="session")
def segment(truth):
    images = {n: look(truth.T_world_camera[n]) for n in range(FRAMES)}
    load = {n: (srgb8(light), depth_z_m) for n, (light, depth_z_m) in images.items()}.__getitem__
    stamps_s = dict(enumerate(truth.stamps_s.tolist()))
    return Segment(CAMERA, CAMERA, tuple(range(4, 44)), stamps_s, truth, load, seed=3)
