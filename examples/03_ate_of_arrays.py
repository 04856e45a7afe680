"""ATE and RPE of poses that are arrays (n, 4, 4), and a chart of the error.

python examples/03_ate_of_arrays.py ate.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window

angle = np.linspace(0, 2 * np.pi, 200)
truth = np.tile(np.eye(4), (200, 1, 1))  # camera to world, metres: a circle of 1 m
truth[:, :3, 3] = np.stack([np.cos(angle), np.sin(angle), np.ones(200)], axis=1)
drift = np.cumsum(np.random.default_rng(0).normal(0, 0.001, (200, 3)), axis=0)
estimate = truth.copy()
estimate[:, :3, 3] += drift

ate = iclnuim.absolute_trajectory_error(truth, estimate)
rpe = iclnuim.relative_pose_error(truth, estimate)
print(ate)
print(rpe)
print(f"median {1000 * ate.to_dict()['translation_error_m']['median']:.2f} mm")
ate.plot().figure.savefig(sys.argv[1])
