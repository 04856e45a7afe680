"""Open a sequence in any known format, and join the points of its frames in the world.

python examples/01_a_sequence.py out/living_room/kt2/clean
"""

import sys

import iclnuim
import numpy as np

sequence = iclnuim.open_sequence(sys.argv[1])
print(sequence)
print(f"the camera moves {sequence.truth.length_m():.3f} m")

cloud = []
for stamp_s, rgb, depth_z_m, T_world_camera in sequence[::10]:
    points = T_world_camera.apply(sequence.camera.unproject(depth_z_m))  # (h, w, 3), metres
    cloud.append(points[depth_z_m > 0][::100])
    print(f"{stamp_s:.3f} s: {rgb.shape[1]} x {rgb.shape[0]}, {depth_z_m.mean():.2f} m deep")
points = np.concatenate(cloud)
print(
    f"{len(points)} points between {points.min(axis=0).round(2)} and {points.max(axis=0).round(2)} m"
)
