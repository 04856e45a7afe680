"""RGB-D: F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images", ICCV 2011.

Photometric error of the whole image, plain least squares, as Kintinuous runs it.
"""

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .photometric import PhotometricSettings, no_contrast, photometric_passes
from .protocol import Frame, Result, Status, failure
from .pyramid import Level, PyramidOdometer, pyramid
from .solver import Limits, Stop, solve

PRESETS = {
    "paper": PhotometricSettings(),
    "best": PhotometricSettings(
        iterations=(0, 4, 2, 2),
        min_gradients=(12, 2, 3, 2),
        max_depth_m=13.0,
        nu=5.0,
        mean_gradient=True,
        spread=75.0,
        tiles=True,
        stop=Stop(min_step=2e-5),
        limits=Limits(min_inliers=0.001, prior_m=0.03),
        reference="keyframe",
    ),
}


class Rgbd(PyramidOdometer):
    """Also the machinery of DVO, which has other settings."""

    name, reads_grey = "rgbd", True

    def __init__(self, settings: PhotometricSettings) -> None:
        super().__init__(settings.iterations, settings.reference)
        self.settings = settings

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        return pyramid(frame, camera, len(self.iterations), median_depth=self.settings.median_depth)

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> Result:
        if no_contrast(reference, current):
            return failure("image: no contrast")
        passes, finest = photometric_passes(reference, current, self.settings, self.schedule(reference))
        result = solve(passes, guess, self.settings.limits)
        if result.status is not Status.FAILED and (reason := finest.unrelated()):
            return failure(reason)
        return result
