"""Score a depth network: here a formula that blurs and scales the true depth stands for it.

python examples/13_depth_score.py out/living_room/kt2/clean depth.png
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402


def predict(depth_z_m):
    """Depth up to scale (h, w), without sharp edges: the mean of 5 x 5 pixels."""
    padded = np.pad(depth_z_m, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (5, 5))
    return 0.3 * windows.mean(axis=(2, 3))


folder, picture = sys.argv[1:]
frames = list(iclnuim.open_sequence(folder)[:40:10])
true_m = np.stack([frame.depth_z_m for frame in frames])
predicted = np.stack([predict(frame.depth_z_m) for frame in frames])

for align in ("none", "scale", "affine"):
    errors = iclnuim.depth_error(true_m, predicted, align=align)
    print(f"{align:<7}{errors}")

errors = iclnuim.depth_error(true_m, predicted, align="scale")
relative = (errors.scale * predicted[0] - true_m[0]) / np.where(true_m[0] > 0, true_m[0], np.nan)
figure, axes = pyplot.subplots(1, 3, figsize=(9, 2.4), layout="constrained")
axes[0].imshow(true_m[0], cmap="turbo")
axes[1].imshow(predicted[0], cmap="turbo")
axes[2].imshow(relative, cmap="RdBu", vmin=-0.1, vmax=0.1)
for one, title in zip(axes, ("true", "predicted", "relative error"), strict=True):
    one.set_title(title)
    one.axis("off")
figure.savefig(picture)
