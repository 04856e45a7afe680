"""Render colour and exact depth of a scene from one pose.

python examples/05_frame_from_a_pose.py frame.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402

T_world_camera = np.eye(4)  # x right, y down, z forward, in a world with z up; metres
T_world_camera[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # level, looking along y
T_world_camera[:3, 3] = [0.0, -1.5, 1.5]
frame = iclnuim.render_pose(
    "living_room", T_world_camera, camera="320x240", light="path", samples=4
)
print(frame, f"{frame.depth_z_m.min():.3f} to {frame.depth_z_m.max():.3f} m")

figure, (left, right) = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.imshow(np.clip(frame.rgb, 0, 1) ** (1 / 2.2))  # scene-linear, as it comes from the renderer
figure.colorbar(right.imshow(frame.depth_z_m, cmap="turbo"), label="depth (m)")
figure.savefig(sys.argv[1])
