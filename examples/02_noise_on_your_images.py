"""Write a noisy copy of a sequence, with a sensor model of one's own beside one of ours.

python examples/02_noise_on_your_images.py out/living_room/kt2/clean noisy
"""

import sys

import iclnuim
import numpy as np


def short_sighted(depth_z_m, camera, rng, sigma_m=0.002):
    """Depth (h, w) in metres: noise that grows with the square of depth, nothing beyond 4 m."""
    noisy = depth_z_m + sigma_m * depth_z_m**2 * rng.standard_normal(depth_z_m.shape)
    return np.where((depth_z_m > 0) & (noisy < 4.0), noisy, 0.0)


folder, out = sys.argv[1:]
clean = iclnuim.open_sequence(folder)[:20]
iclnuim.make_sequence(clean, out, depth_noise=short_sighted, rgb_noise="released", seed=7)

for before, after in zip(clean[::10], iclnuim.open_sequence(out)[::10], strict=True):
    both = (before.depth_z_m > 0) & (after.depth_z_m > 0)
    error_mm = 1000 * (after.depth_z_m - before.depth_z_m)[both]
    print(f"{after.stamp_s:.3f} s: {error_mm.std():.1f} mm, {both.mean():.0%} measured")
