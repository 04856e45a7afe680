"""ICP+RGB-D: planes and grey values together, T. Whelan et al., "Robust real-time visual odometry
for dense RGB-D mapping", ICRA 2013, section IV.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from iclnuim.geometry.se3 import SE3

from .candidates import AlignmentCandidate, Estimate, pick
from .icp import Icp
from .levels import Pair
from .photometric import PhotometricSettings, Rgbd, image_passes
from .solver import Pass
from .start import Start, initialise
from .terms.depth import DepthTerm
from .terms.joint import WEIGHT_RGBD, JointTerm
from .terms.plane import IcpSettings, PlaneTerm

#: Relative error of a motion from the planes of a noisy frame whose offset of depth is not known,
#: because depth is biased, and noise shortens the motion: of each component between two frames, of
#: its length against a model.
ROUGH_ERROR = 0.1
#: Standard deviation of the motion of a noisy frame about its prediction, for frames where the
#: image alone constrains the motion.
ROUGH_PRIOR_M = 0.01
#: Number of pixels of a noisy image that share one error, next to planes whose offset of depth is
#: known: fewer than on clean frames, whose errors are those of interpolation. With 12 motions are
#: as accurate, but NEES is up to 4.4 instead of 1.9; with 75 errors over a second are 4 to 13 %
#: larger (noisy living room kt1, kt2, office kt2).
CALIBRATED_SPREAD = 24.0

#: The levels of KinectFusion's ICP (Newcombe 2011, section 3.5) with the gradients of Kintinuous'
#: RGBDOdometry, which runs both terms on them (Whelan 2013, section IV-B).
_PAPER = PhotometricSettings(iterations=(10, 5, 4), min_gradients=(12, 5, 3), max_depth_m=13.0)
#: Level -> its geometric term.
PlaneTerms = dict[int, PlaneTerm]


class IcpRgbd(Icp):
    """Settings: of the geometric term, whose stop and limits are used, and whose iterations are
    those of planes alone; of the photometric term, whose iterations are those of both terms; and
    the weight of the photometric term on the right-hand side.
    """

    name = "icp_rgbd"
    reads_grey = True
    PRESETS = {
        "paper": (IcpSettings(), _PAPER, WEIGHT_RGBD**2),
        # a mistake in the code that the paper used: the matrix is weighted by w^2, the right-hand
        # side by w
        "kintinuous2013": (IcpSettings(), _PAPER, WEIGHT_RGBD),
        "best": (
            replace(Icp.PRESETS["best"], iterations=(0, 4, 3, 0), strides=(1, 2, 1, 1)),
            replace(
                Rgbd.PRESETS["best"],
                iterations=(0, 2, 2, 2),
                min_gradients=(12, 2, 3, 3),
                spread=75.0,
            ),
            1.0,
        ),
    }

    def __init__(self, settings: tuple[IcpSettings, PhotometricSettings, float]) -> None:
        super().__init__(settings[0])
        _, self.photometric, self.weight_b = settings
        self.iterations = self.photometric.iterations
        self.alone = Icp(settings[0])

    def _align_from(self, pair: Pair, guess: SE3) -> Estimate:
        """Planes alone where the images have no contrast or are unrelated, and on clean frames
        where they are more certain than the images in every direction; else both terms together:
        of biased depth the image first, and after a poor prediction whatever matches most points.
        """
        if pair.no_contrast():
            return self._planes_alone(pair, guess)
        start = self._start(pair, guess)
        certain = self._certain_planes(pair, start, guess)
        if certain:
            return certain
        planes = self._plane_terms(pair, start)
        if is_biased(pair):
            found = self._image_first_from_best(pair, planes, start, guess)
        elif start.poor:
            found = self._best_of_all(pair, planes, start, guess)
        else:
            found = self._jointly(pair, planes, start.schedule, guess).estimate()
        return self._checked(found, pair, start, guess)

    def _start(self, pair: Pair, guess: SE3) -> Start:
        schedule = self.schedule(pair.reference)
        if pair.rendered:
            return Start([guess], schedule)
        return initialise(pair, self.photometric, schedule, guess)

    def _planes_alone(self, pair: Pair, guess: SE3) -> Estimate:
        return self.alone.planes(pair, guess).estimate()

    def _certain_planes(self, pair: Pair, start: Start, guess: SE3) -> Estimate | None:
        """The estimate of planes alone on clean frames if it has more information than the images
        in every direction.
        """
        if not self.settings.two_normals or pair.rough or pair.rendered or start.poor:
            return None
        alone = self._planes_alone(pair, guess)
        return alone if alone.inliers and self._outweighs(alone, pair, start) else None

    def _plane_terms(self, pair: Pair, start: Start) -> PlaneTerms:
        """The geometric term of each level. Biased planes, and those against a model, get a
        relative error that is larger than their noise.
        """
        has_relative_error = is_biased(pair) or pair.rendered
        settings = self.settings if has_relative_error else self.plane_settings(pair)
        return {n: PlaneTerm(pair, settings, n) for n, _ in start.schedule}

    def _best_of_all(self, pair: Pair, planes: PlaneTerms, start: Start, guess: SE3) -> Estimate:
        """After a sudden motion, or where contrast moves in another way than the surfaces (mirrors
        close by): of all ways, planes alone too, that with the most matching points.
        """
        image_first = self._image_first_from_best(pair, planes, start, guess)
        begin = start.guesses[0] if image_first.failed else image_first.T
        others = [
            self._jointly(pair, planes, start.schedule, begin).estimate(),
            self._jointly(pair, planes, start.schedule, guess).estimate(),
            self._planes_alone(pair, guess),
        ]
        return pick(image_first, others, lambda one: one.inliers)

    def _checked(self, found: Estimate, pair: Pair, start: Start, guess: SE3) -> Estimate:
        """The estimate with the checks of the image; planes alone if the images are unrelated."""
        if found.image is None:
            return found
        if not found.failed and found.image.unrelated():
            return self._planes_alone(pair, guess)
        return found._replace(result=start.checked(found.image.checked(found.result)))

    def _outweighs(self, alone: Estimate, pair: Pair, start: Start) -> bool:
        """Whether planes alone have more information than the images in every direction, on the
        finest level.
        """
        passes, _ = image_passes(pair, self.photometric, start.schedule[-1:])
        image = passes[-1].term.linearise(alone.T, 0)
        if not image.is_information:
            return False
        return bool(np.linalg.eigvalsh(alone.result.information - image.A)[0] > 0)

    def _jointly(
        self, pair: Pair, planes: PlaneTerms, schedule: list[tuple[int, int]], guess: SE3
    ) -> AlignmentCandidate:
        """Both terms in all passes (Whelan 2013, section IV)."""
        settings = self.photometric
        if pair.rough and not pair.rendered:
            settings = replace(settings, spread=CALIBRATED_SPREAD)
        error = length_error if pair.rough and pair.rendered else None
        passes, image = image_passes(pair, settings, schedule)
        levels = [n for n, _ in schedule]
        levels += levels[-1:] * (len(passes) - len(levels))
        for k, n in enumerate(levels):
            passes[k] = self._with_planes(passes[k], planes[n], error)
        prior_m = ROUGH_PRIOR_M if pair.rough else self.settings.limits.prior_m
        limits = replace(self.settings.limits, min_eigenvalue=0.0, prior_m=prior_m)
        return AlignmentCandidate(guess, passes, limits, image, planes[levels[0]])

    def _image_first_from_best(
        self, pair: Pair, planes: PlaneTerms, start: Start, guess: SE3
    ) -> Estimate:
        coarsest = start.schedule[0][0]
        planes[coarsest].linearise(guess, 0)  # the distance between the surfaces there
        return start.aligned(lambda one: self._image_first(pair, planes, start, one).estimate())

    def _image_first(
        self, pair: Pair, planes: PlaneTerms, start: Start, guess: SE3
    ) -> AlignmentCandidate:
        """As `Rgbd`, with the planes in the last pass: for biased depth, and for a guess after a
        poor prediction.
        """
        coarsest = start.schedule[0][0]
        finest = start.schedule[-1][0]
        settings = replace(self.photometric, spread=Rgbd.PRESETS["best"].spread)
        depth = DepthTerm(pair.reference[finest], pair.current[finest])
        passes, image = image_passes(pair, settings, start.schedule, depth)
        error = component_errors if is_biased(pair) else None
        passes[-1] = self._with_planes(passes[-1], planes[finest], error)
        prior_m = settings.limits.prior_m if start.poor else ROUGH_PRIOR_M
        limits = replace(settings.limits, prior_m=prior_m)
        return AlignmentCandidate(guess, passes, limits, image, planes[coarsest], depth)

    def _with_planes(
        self, one: Pass, planes: PlaneTerm, error: Callable[[SE3], np.ndarray] | None
    ) -> Pass:
        """A pass of the image with the planes' equations added."""
        term = JointTerm(planes, one.term, self.weight_b, error)
        return Pass(term, one.iterations, self.settings.stop, centre=one.centre)


def is_biased(pair: Pair) -> bool:
    """Whether planes give a biased motion: those of two noisy frames whose offset of depth is not
    known. A model's are averages.
    """
    return pair.rough and not (pair.rendered or pair.calibrated)


def length_error(T: SE3) -> np.ndarray:
    """(6, 1): an error of the length of the motion T."""
    return ROUGH_ERROR * np.r_[T.translation, np.zeros(3)][:, None]


def component_errors(T: SE3) -> np.ndarray:
    """(6, 6): an error of each component of the motion T, relative to the norm of its translation
    or rotation.
    """
    twist = T.log()
    norms = [np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])]
    return ROUGH_ERROR * np.diag(np.repeat(norms, 3))
