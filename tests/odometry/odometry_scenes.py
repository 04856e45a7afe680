"""Frames made by formula: planes with a smooth texture, and a camera that moves steadily."""

from dataclasses import replace

import numpy as np
from iclnuim.benchmark.odometry.protocol import Frame
from iclnuim.benchmark.odometry.registry import odometer
from iclnuim.benchmark.odometry.track import Tracker, track
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

CAMERA = PinholeCamera.parse("160x120")
BIG = PinholeCamera.parse("320x240")
VGA = PinholeCamera.parse("640x480")
STEP = SE3.exp(np.array([0.006, -0.004, 0.005, 0.004, -0.003, 0.005]))
ROOM = ((0.8, 0.0, 0.6), (-0.8, 0.0, 0.6), (0.0, 0.8, 0.6))
WALL = ((0.0, 0.0, 1.0),)


def after(i):
    return SE3.from_matrix(np.linalg.matrix_power(STEP.matrix, i))


def view(i, planes, noise=0.0, camera=CAMERA):
    """The i-th frame of a steady motion before planes at 2 m; depth noise is a share, from a seed
    of its own.
    """
    T, rng = after(i), np.random.default_rng([5, i])
    rays = camera.rays() @ T.rotation.T
    nearest = np.full(rays.shape[:2], np.inf)
    for n in np.array(planes) / np.linalg.norm(planes, axis=1)[:, None]:
        slope = rays @ n
        nearest = np.minimum(
            nearest,
            np.where(slope > 1e-6, (2 - n @ T.translation) / np.maximum(slope, 1e-6), np.inf),
        )
    x, y, z = np.moveaxis(T.translation + rays * nearest[..., None], -1, 0)
    grey = (
        128 + 40 * np.sin(9 * x + 2 * z) + 40 * np.sin(11 * y - 3 * z) + 20 * np.sin(7 * z + 4 * x)
    )
    depth = nearest * (1 + noise * rng.standard_normal(nearest.shape))
    return Frame.of(grey + 500 * noise * rng.standard_normal(grey.shape), depth, i / 30)


def run(method, frames, camera=CAMERA):
    method = odometer(method) if isinstance(method, str) else method
    return list(track(method, camera, [(f.stamp_s, f) for f in frames]))


def error_m(found, last=None):
    true = after(len(found) - 1 if last is None else last)
    return float(np.linalg.norm(found[-1].T_world_camera.translation - true.translation))


def tracked_by(result_of, count, lost=(), against=None):
    """`count` tracked frames, of which those in `lost` have no image, if an odometer aligns frame
    `other` with frame `one` with result_of(one, other).
    """

    class Stub:
        name, reference = "stub", "frame"

        def prepare(self, frame, camera):
            return int(frame.stamp_s)

        def align(self, one, other, guess):
            return result_of(one, other)

    tracker = Tracker(Stub(), CAMERA, against=against)
    frames = [replace(view(i, ROOM), stamp_s=i) for i in range(count)]
    return [tracker.add(i, "no image" if i in lost else f) for i, f in enumerate(frames)]


def reasons_of_tracked(count, result_of, lost=()):
    return [f.result.reason for f in tracked_by(result_of, count, lost)]


def celled(i):
    """The corner in cells of random greys, which have corners to match, a little blurred by the
    pixels' 3x3 means.
    """
    frame, T = view(i, ROOM), after(i)
    fine = PinholeCamera(
        480, 360, 3 * CAMERA.fx, 3 * CAMERA.fy, 3 * CAMERA.cx + 1, 3 * CAMERA.cy + 1
    )
    points = T.apply(fine.rays() * view(i, ROOM, camera=fine).depth_z_m[..., None].astype(float))
    x, y, z = np.moveaxis(np.floor(points / 0.2 + 0.37).astype(np.int64), -1, 0)
    cell = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791)
    grey = 40 + 170 * (cell % 1000003 * 7919 % 104729) / 104729
    return Frame.of(grey.reshape(120, 3, 160, 3).mean(axis=(1, 3)), frame.depth_z_m, i / 30)
