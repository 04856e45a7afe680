"""Render true normals, classes and instances beside colour and depth, and draw one frame.

python examples/10_ground_truth.py out/kt2_truth truth.png
"""

import sys
from pathlib import Path

import iclnuim
import matplotlib

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402

out, picture = sys.argv[1:]
camera = iclnuim.PinholeCamera.parse("160x120")
job = iclnuim.shipped_job("kt2").changed(camera=camera, light="path", samples=2, ground_truth=True)
iclnuim.render_frames(job, f"{out}/raw", frames="0:2")
iclnuim.make_sequence(f"{out}/raw", f"{out}/clean")

kinds = sorted(path for path in Path(out, "clean").iterdir() if path.is_dir())
print("channels:", ", ".join(path.name for path in kinds))
figure, axes = pyplot.subplots(1, len(kinds), figsize=(2.4 * len(kinds), 2), layout="constrained")
for one, folder in zip(axes, kinds, strict=True):
    one.imshow(pyplot.imread(min(folder.glob("*.png"))), cmap="turbo")
    one.set_title(folder.name)
    one.axis("off")
figure.savefig(picture)
