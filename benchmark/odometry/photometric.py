"""RGB-D and DVO: the photometric error of the whole image alone.

RGB-D: F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images",
ICCV 2011, plain least squares, as Kintinuous runs it. DVO: C. Kerl, J. Sturm, D. Cremers, "Robust
odometry estimation for RGB-D cameras", ICRA 2013, coarse to fine on levels 3 to 1.
"""

from dataclasses import replace

from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from .candidates import Estimate
from .levels import Level, Pair, PyramidOdometer, pyramid
from .protocol import Frame, OdometryResult, OdometryStatus, failure
from .solver import Pass, SolverLimits, Stop, solve
from .start import initialise
from .terms.depth import DepthTerm
from .terms.photometric import PhotometricSettings, PhotometricTerm, TiledTerm


class Rgbd(PyramidOdometer):
    """The photometric term alone; residuals are in grey levels."""

    name = "rgbd"
    reads_grey = True
    PRESETS = {
        "paper": PhotometricSettings(),
        "best": PhotometricSettings(
            iterations=(0, 4, 2, 2),
            min_gradients=(12, 2, 3, 2),
            max_depth_m=13.0,
            nu=5.0,  # Kerl 2013, section III-C
            mean_gradient=True,
            spread=1.0,
            tiles=True,
            stop=Stop(min_step=2e-5),
            limits=SolverLimits(min_inliers=0.001, prior_m=0.03),
            reference="keyframe",
        ),
    }

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        return pyramid(frame, camera, len(self.iterations), median_depth=self.settings.median_depth)

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> OdometryResult:
        pair = Pair(reference, current)
        if pair.no_contrast():
            return failure("image: no contrast")
        start = initialise(pair, self.settings, self.schedule(reference), guess)
        found = start.aligned(lambda one: Estimate(self._align_from(pair, start.schedule, one)))
        return start.checked(found.result)

    def _align_from(
        self, pair: Pair, schedule: list[tuple[int, int]], guess: SE3
    ) -> OdometryResult:
        n = schedule[-1][0]
        depth = DepthTerm(pair.reference[n], pair.current[n]) if self.settings.tiles else None
        passes, image = image_passes(pair, self.settings, schedule, depth)
        result = solve(passes, guess, self.settings.limits)
        if result.status is OdometryStatus.FAILED:
            return result
        reason = image.unrelated()
        if reason:
            return failure(reason)
        result = image.checked(result)
        return depth.final(result) if depth else result


class Dvo(Rgbd):
    """`Rgbd` with other settings."""

    name = "dvo"
    PRESETS = {
        # Kerl 2013, section III, and where it has no number DenseTracker::Config of its program:
        # MaxIterationsPerLevel, IntensityDerivativeThreshold, Precision
        "paper": PhotometricSettings(
            iterations=(0, 100, 100, 100),
            min_gradients=(0, 0, 0, 0),
            max_depth_m=1e9,
            max_dz_m=0.05,
            nu=5.0,  # section III-C
            scale_once=True,
            median_depth=True,
            stop=Stop(min_step=1e-7, min_decrease=5e-7, undo=True),
            limits=SolverLimits(min_inliers=0.3),  # failure test of dvo_slam
        ),
        "best": replace(
            Rgbd.PRESETS["best"],
            min_gradients=(2, 2, 2, 2),
            max_depth_m=1e9,
            max_dz_m=0.05,
            scale_once=True,
            stop=Stop(min_step=2e-5, min_decrease=1e-3, undo=True),
            limits=SolverLimits(min_inliers=0.01, prior_m=0.03),
        ),
    }


def image_passes(
    pair: Pair,
    settings: PhotometricSettings,
    schedule: list[tuple[int, int]],
    depth: DepthTerm | None = None,
) -> tuple[list[Pass], PhotometricTerm]:
    """The passes for solve() on the levels of `schedule`, (level, iterations) from coarse to fine,
    and the finest term.

    With `settings.tiles` the coarse levels estimate only the rotation, which does not depend on
    depth. The finest level has two passes: first with a loose prior on the tiles' depth and the
    equations of `depth`, then with a firm prior.
    """
    s = settings
    coarse = schedule[:-1] if s.tiles else schedule
    passes = []
    for n, iterations in coarse:
        scale_once = s.scale_once and not s.tiles and n != schedule[0][0]
        term = PhotometricTerm(pair, s, n, scale_once)
        passes.append(Pass(term, iterations, s.stop, rotation_only=s.tiles))
    if not s.tiles:
        return passes, term
    n, iterations = schedule[-1]
    loose = TiledTerm(pair, s, n, depth)
    # the error may increase for a step while the factors converge, and when their prior changes
    stop = Stop(s.stop.min_step)
    passes.append(Pass(loose, iterations, stop))
    passes.append(Pass(loose.firm, iterations, stop, centre=depth is not None))
    return passes, loose
