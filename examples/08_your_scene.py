"""Render a scene of one's own (.blend .glb .obj .ply .usd .fbx) along a trajectory, as a sequence.

python examples/08_your_scene.py room.obj my_sequence
"""

import sys

import iclnuim
import numpy as np

scene, out = sys.argv[1:]
turn = np.linspace(-0.3, 0.3, 8)
motion = np.zeros((8, 6))  # metres and radians in the camera's frame: right, down, forward
motion[:, 0] = turn
motion[:, 4] = turn
start = iclnuim.pose_from_pov((0.0, 1.4, -1.0), (0.0, 0.0, 1.0))  # at a height of 1.4 m
poses = iclnuim.Trajectory.at_rate(start @ iclnuim.SE3.exp(motion))
iclnuim.write_trajectory("path.txt", poses, "tum")

camera = iclnuim.PinholeCamera.parse("160x120")
job = iclnuim.RenderJob("my/path", scene, "path.txt", camera, light="path", samples=4)
run = iclnuim.render_frames(job, "my_run")
written = iclnuim.make_sequence("my_run", out, depth_noise="kinect2012", rgb_noise="released")
print(run.path, written.folders[0])
print(iclnuim.open_sequence(out))
