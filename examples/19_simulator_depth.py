"""Depth of a simulator as a D435, an Azure Kinect and a phone would measure it.

python examples/19_simulator_depth.py sensors.png [frame.npz]

frame.npz has depth (h, w) in metres along the optical axis, rgb (h, w, 3) and K (3, 3), from any
simulator. Without it a small room stands for one. What simulators give, in metres:

  gz-sim        32FC1 of rgbd_camera: planar, inf where nothing is hit
  MuJoCo        Renderer with enable_depth_rendering(): planar
  PyBullet      far * near / (far - (far - near) * buffer) of getCameraImage's depth buffer: planar
  Isaac, Lab    distance_to_image_plane: planar (distance_to_camera is along the ray)
  Habitat       DEPTH sensor: planar, 0 where nothing is hit
"""

import sys

import iclnuim
import matplotlib
import numpy as np

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402


def room():
    """Depth (240, 320) of a corner with a box before it, colour with a black stripe, and K."""
    K = np.array([[240.0, 0, 159.5], [0, 240.0, 119.5], [0, 0, 1]])
    right = (np.arange(320) - 159.5) / 240
    depth = np.repeat((2.5 / (1 + np.abs(right)))[None], 240, axis=0)
    rgb = np.full((240, 320, 3), 0.6)
    rgb[:, 250:290] = 0.003
    depth[100:180, 120:190] = 1.2
    rgb[100:180, 120:190] = [0.5, 0.2, 0.1]
    return depth, rgb, K


picture = sys.argv[1]
if len(sys.argv) > 2:
    frame = np.load(sys.argv[2])
    depth, rgb, K = frame["depth"], frame["rgb"], frame["K"]
else:
    depth, rgb, K = room()
depth = np.where(np.isfinite(depth), depth, 0.0)
camera = iclnuim.PinholeCamera.from_K(K, width=depth.shape[1], height=depth.shape[0])

noisy = {
    name: iclnuim.noisy_depth(depth, name, camera, seed=1, rgb=rgb)
    for name in ("d435", "azure_kinect", "phone")
}
for name, noisy_m in noisy.items():
    both = (depth > 0) & (noisy_m > 0)
    error_mm = 1000 * np.abs(noisy_m - depth)[both]
    print(f"{name:<13}{both.mean():.0%} measured, median error {np.median(error_mm):.1f} mm")
small_m, confidence, small = iclnuim.phone_depth(depth, camera, seed=1, rgb=rgb)
print(f"phone_depth   {small.width}x{small.height}, {(confidence == 2).mean():.0%} of confidence 2")

# a batch: image k has the noise of frame 10 + k
batch = iclnuim.noisy_depth(np.stack([depth] * 4), "d435", camera, seed=1, frame=10, albedo=0.5)
print(f"batch         {batch.shape}, {len({image.tobytes() for image in batch})} different images")

figure, axes = pyplot.subplots(1, 4, figsize=(11, 2.4), layout="constrained")
for one, (title, image) in zip(axes, {"exact": depth, **noisy}.items(), strict=True):
    one.imshow(np.where(image > 0, image, np.nan), cmap="turbo", vmin=1.0, vmax=2.6)
    one.set_title(title)
    one.axis("off")
figure.savefig(picture)
