"""Score point maps, as networks of the kind of DUSt3R and VGGT predict them: here the true points of
each frame with noise, in a world of another scale and pose.

python examples/14_point_maps.py out/living_room/kt2/clean points.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402

folder, picture = sys.argv[1:]
sequence = iclnuim.open_sequence(folder)
frames = list(sequence[:40:10])
true_points = []
for frame in frames:
    points = sequence.camera.unproject(frame.depth_z_m)
    points[frame.depth_z_m == 0] = np.nan
    true_points.append(frame.T_world_camera.apply(points.reshape(-1, 3)).reshape(points.shape))
true_points = np.stack(true_points)
centres = np.stack([frame.T_world_camera.translation for frame in frames])

rng = np.random.default_rng(0)
T = iclnuim.SE3.exp([0.5, -1.0, 0.2, 0.3, 1.2, -0.4])
noisy = true_points + rng.normal(0, 0.02, true_points.shape)
predicted = 0.4 * T.apply(noisy.reshape(-1, 3)).reshape(noisy.shape)

errors = iclnuim.point_error(true_points, predicted, centres=centres)
print(errors)
print(f"the scale of the prediction is {1 / errors.scale:.4f}, planted 0.4")

aligned = errors.T_true_predicted.apply(errors.scale * predicted.reshape(-1, 3))
aligned = aligned.reshape(predicted.shape)
figure, axes = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
for one, points in zip(axes, (true_points, aligned), strict=True):
    one.plot(*points[:, ::8, ::8].reshape(-1, 3)[:, :2].T, ".", markersize=1)
    one.set_aspect("equal")
axes[0].set_title("true points from above")
axes[1].set_title("predicted ones, aligned")
figure.savefig(picture)
