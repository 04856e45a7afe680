"""Cameras of POV-Ray (position, direction, up; left-handed, y up) become a trajectory.

python examples/06_pov_trajectory.py poses.txt trajectory.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window

file, picture = sys.argv[1:]
poses = []
for angle in np.linspace(0, np.pi, 60):
    position = np.array([1.5 * np.cos(angle), 1.4 + 0.1 * np.sin(5 * angle), 1.5 * np.sin(angle)])
    poses.append(iclnuim.pose_from_pov(position, -position, up=(0.0, 1.0, 0.0)))

trajectory = iclnuim.Trajectory.at_rate(iclnuim.SE3.of(poses))  # 30 Hz, the first stamp is 1 s
iclnuim.write_trajectory(file, trajectory, "tum")
read = iclnuim.read_trajectory(file)
print(f"{len(read.trajectory)} poses, {read.trajectory.length_m():.3f} m: {read.read_as.sentence}")
trajectory.plot(label="POV cameras").figure.savefig(picture)
