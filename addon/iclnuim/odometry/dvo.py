"""DVO: C. Kerl, J. Sturm, D. Cremers, "Robust odometry estimation for RGB-D cameras", ICRA 2013.

The whole grey image, inverse compositional, Student-t weights (section III), coarse to fine on levels 3 to 1.
"""

from .photometric import PhotometricSettings
from .rgbd import Rgbd
from .solver import Limits, Stop

PRESETS = {
    "paper": PhotometricSettings(
        iterations=(0, 100, 100, 100),
        min_gradients=(0, 0, 0, 0),
        max_depth_m=1e9,
        max_dz_m=0.05,
        nu=5.0,
        scale_once=True,
        median_depth=True,
        stop=Stop(min_step=1e-7, min_decrease=5e-7, undo=True),
        limits=Limits(min_inliers=0.3),  # failure test of dvo_slam
    ),
    "best": PhotometricSettings(
        iterations=(0, 4, 4, 4),
        min_gradients=(2, 2, 2, 2),
        max_depth_m=1e9,
        max_dz_m=0.05,
        nu=5.0,
        scale_once=True,
        mean_gradient=True,
        spread=75.0,
        tiles=True,
        stop=Stop(min_step=2e-5, min_decrease=1e-3, undo=True),
        limits=Limits(min_inliers=0.01, prior_m=0.03),
        reference="keyframe",
    ),
}


class Dvo(Rgbd):
    name = "dvo"
