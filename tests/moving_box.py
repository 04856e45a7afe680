"""Depth of a camera that moves by hand in a box with a step in a corner, by numpy alone."""

import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

CAMERA = PinholeCamera.parse("160x120")
#: Lower and upper corners of the room and of a block in it.
ROOM = np.array([[-2.0, -1.3, -2.5], [2.3, 1.2, 2.8]])
BLOCK = np.array([[0.4, 0.2, 1.2], [1.3, 1.2, 2.1]])


def hand_held(frames: int, seed: int, extent: float = 1.0) -> SE3:
    """(frames,) smooth camera-to-world poses at 30 Hz near the middle of the room."""
    return hand_held_at(np.arange(frames) / 30, seed, extent)


def hand_held_at(times_s: np.ndarray, seed: int, extent: float = 1.0) -> SE3:
    """(n,) poses of the same motion at other times (n,): three harmonics in each direction."""
    rng = np.random.default_rng(seed)
    t = times_s[:, None, None]
    rates = rng.uniform(0.5, 3, (3, 6))
    phases = rng.uniform(0, 2 * np.pi, (3, 6))
    sizes = rng.uniform(0.3, 1, (3, 6)) * [0.25, 0.15, 0.25, 0.2, 0.25, 0.1] / rates
    twists = extent * (sizes * np.sin(rates * t + phases)).sum(1)
    start = SE3.exp(np.array([0.1, -0.2, -0.6, 0.1, 0.3, -0.1]))
    return start @ SE3.exp(twists)


def depth_z_m(T_world_camera: SE3, camera: PinholeCamera = CAMERA) -> np.ndarray:
    """(h, w) planar depth of the room."""
    rays = camera.rays() @ T_world_camera.rotation.T
    with np.errstate(divide="ignore"):
        planes = [(corner - T_world_camera.translation) / rays for corner in (*ROOM, *BLOCK)]
    wall = np.maximum(planes[0], planes[1]).min(-1)
    enter = np.minimum(planes[2], planes[3]).max(-1)
    leave = np.maximum(planes[2], planes[3]).min(-1)
    return np.where((enter < leave) & (enter > 0), np.minimum(enter, wall), wall)


def kinect(depth_m: np.ndarray, seed: int) -> np.ndarray:
    """Depth with the noise and steps of a Kinect's disparity: one sixth and one of 1/351.3 per
    metre.
    """
    disparity = 351.3 / depth_m + np.random.default_rng(seed).normal(0, 1 / 6, depth_m.shape)
    return 351.3 / np.rint(disparity)


def distance_m(points: np.ndarray) -> np.ndarray:
    """(n,) distance of points (n, 3) to the surfaces of the room."""
    found = []
    for low, high in (ROOM, BLOCK):
        outside = np.maximum(low - points, points - high)
        beside = np.linalg.norm(np.maximum(outside, 0), axis=-1)
        found.append(np.abs(beside + np.minimum(outside.max(-1), 0)))
    return np.minimum(*found)
