"""Which results of an odometer are to be doubted, for reasons that it cannot know itself."""

import math

import numpy as np
from iclnuim.geometry.se3 import SE3

from .protocol import WRONG_DEG, WRONG_M, Frame, OdometryResult, OdometryStatus

#: A DEGENERATE pose is an outlier if it is farther than this from the path between the poses around
#: it: a third of what counts as wrong.
OUTLIER_M = WRONG_M / 3
OUTLIER_DEG = WRONG_DEG / 3


class Watch:
    """Judges each result from the ones before.

    A pose that its odometer reports as OK is doubted if all depth has one value, if its reference
    is a lost frame, or frames were repeated before it; if its predecessor was a DEGENERATE outlier:
    the motion between the two is wrong; if it has not converged after a pose with a standard
    deviation of more than WRONG_M: it started from a motion that is not known; and if it has not
    converged and is farther from its prediction than what counts as wrong.
    """

    def __init__(self) -> None:
        self.repeated = False  # whether the frames before repeat one another
        self.assumed = False  # whether the pose of the reference comes from the policy
        self.uncertain = False  # whether the standard deviation of the last pose is above WRONG_M
        # stamp and pose of the last frame that was OK, or of an assumed reference since then; of
        # the last tracked frame, if it was DEGENERATE
        self.good: tuple[float, SE3] | None = None
        self.doubtful: tuple[float, SE3] | None = None

    def doubt(
        self, stamp_s: float, frame: Frame, guess: SE3, result: OdometryResult, T_world_camera: SE3
    ) -> str:
        """The reason why a pose that its odometer reports as OK is DEGENERATE; empty if there is
        none.
        """
        if frame.flat():  # such depth fits every motion that keeps its distance
            return "depth: the same value in all pixels"
        if self.assumed:
            return "track: aligned with a lost frame, whose pose is not measured"
        if self.repeated:
            return "track: moved since the first of repeated frames, at an unknown time"
        if self._after_outlier(stamp_s, T_world_camera):
            return "track: the pose before was an outlier"
        if result.converged:
            return ""
        if self.uncertain:
            return "track: not converged, and the pose before was uncertain"
        if apart(guess, result.T_reference_camera, WRONG_M, WRONG_DEG):
            return "track: not converged, and far from the prediction"
        return ""

    def note(self, stamp_s: float, T_world_camera: SE3, result: OdometryResult) -> None:
        """A tracked frame."""
        self.repeated = False
        self.assumed = False
        self.uncertain = result.largest_sigma_m > WRONG_M
        self.doubtful = (stamp_s, T_world_camera)
        if result.status is OdometryStatus.OK:
            self.good = self.doubtful
            self.doubtful = None

    def assume(self, stamp_s: float, T_world_camera: SE3) -> None:
        """A lost frame is the new reference, at a pose that was not measured; later poses are
        relative to it.
        """
        self.assumed = True
        self.good = (stamp_s, T_world_camera)
        self.doubtful = None

    def _after_outlier(self, stamp_s: float, T_world_camera: SE3) -> bool:
        """Whether the last tracked pose was DEGENERATE and is not on the path from the last one
        that was OK to this one.
        """
        if self.good is None or self.doubtful is None:
            return False
        good_s, T_world_good = self.good
        doubtful_s, T_world_doubtful = self.doubtful
        share = (doubtful_s - good_s) / (stamp_s - good_s)
        expected = T_world_good.interpolate(T_world_camera, share)
        return apart(expected, T_world_doubtful, OUTLIER_M, OUTLIER_DEG)


def apart(T_one: SE3, T_other: SE3, max_m: float, max_deg: float) -> bool:
    """Whether two poses differ by more than max_m, or by max_deg degrees or more."""
    if np.linalg.norm(T_one.translation - T_other.translation) > max_m:
        return True
    return rotated(T_one, T_other, max_deg)


def rotated(T_world_one: SE3, T_world_other: SE3, min_deg: float) -> bool:
    """Whether the rotations of two poses differ by `min_deg` degrees or more."""
    cosine = (np.trace(T_world_one.rotation.T @ T_world_other.rotation) - 1) / 2
    return bool(cosine <= math.cos(math.radians(min_deg)))
