"""An odometer of one's own, point-to-point ICP, in one table with one of ours, and its trajectory.

python examples/04_your_odometer.py out/living_room/kt2/clean odometer.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window


class PointToPoint:
    name = "point_to_point"
    reference = "frame"  # what a frame is aligned with: the one before

    def prepare(self, frame, camera):
        """What `align` needs of a frame."""
        return camera, camera.unproject(frame.depth_z_m)

    def align(self, reference, current, guess):
        camera, there = reference
        points = current[1][::4, ::4].reshape(-1, 3)
        points = points[points[:, 2] > 0]  # depth 0 is no measurement
        T = guess
        for _ in range(10):
            moved = T.apply(points)
            u, v = np.nan_to_num(camera.project(moved), nan=-1).round().astype(int).T
            seen = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
            pairs = there[v[seen], u[seen]]
            near = (pairs[:, 2] > 0) & (np.linalg.norm(pairs - moved[seen], axis=1) < 0.1)
            a, b = moved[seen][near], pairs[near]
            left, _, right = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))  # Arun 1987
            rotation = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
            T = iclnuim.SE3(rotation, b.mean(0) - rotation @ a.mean(0)) @ T
        return iclnuim.OdometryResult(T)


folder, picture = sys.argv[1:]
sequence = iclnuim.open_sequence(folder)[:30]
runs = iclnuim.run_odometers([iclnuim.odometer("icp"), PointToPoint()], sequence)
print(iclnuim.odometry_table(runs))
runs[1].plot().figure.savefig(picture)
