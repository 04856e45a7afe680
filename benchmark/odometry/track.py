"""Tracking: from frames to a trajectory, with the choice of the reference frame and the handling of
lost frames.

A frame is aligned against the one before or a keyframe; fusion/reference.py aligns it against a
fused model.
"""

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from .protocol import (
    WRONG_DEG,
    WRONG_M,
    Frame,
    Odometer,
    Result,
    Status,
    failure,
)

#: Pose of a lost frame. hold: the last pose, and the reference does not change; constant-velocity:
#: the last motion continues; restart: the last pose, and the lost frame is the new reference
POLICIES = ("hold", "constant-velocity", "restart")
#: After this number of consecutive lost frames the reference is replaced, because it probably shows
#: another place.
MAX_LOST = 5
#: Decay per frame of a constant-velocity prediction in under-constrained directions
#: (Result.under_constrained).
PREDICTION_DECAY = 0.95
#: A motion is extrapolated over at most this time: a second later a camera in the hand has moved
#: 0.7 to 0.95 of that (all eight trajectories).
MAX_EXTRAPOLATION_S = 1.0
#: A DEGENERATE pose is an outlier if it is farther than this from the path between the poses around
#: it: a third of what counts as wrong.
OUTLIER_M, OUTLIER_DEG = WRONG_M / 3, WRONG_DEG / 3
#: Output of an odometer's prepare() for a frame, or its equivalent for a rendered model, and
#: T_world_camera of that frame.
View = tuple[Any, SE3]


class Reference:
    """Chooses the view that the next frame is aligned against. This class returns the current
    frame, subclasses an earlier one.

    tries_last: whether a frame that does not fit the view is aligned with the frame before instead.
    """

    tries_last = False

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None
    ) -> View:
        """The view after a tracked frame. prepared: output of prepare(); result: output of align(),
        None for the first frame.
        """
        return self.restart(frame, prepared, T_world_camera)

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        """The view after lost frames, at a pose that was not measured."""
        return prepared, T_world_camera


def rotated(T_world_one: SE3, T_world_other: SE3, min_deg: float) -> bool:
    """Whether the rotations of two poses differ by `min_deg` degrees or more."""
    cosine = (np.trace(T_world_one.rotation.T @ T_world_other.rotation) - 1) / 2
    return bool(cosine <= math.cos(math.radians(min_deg)))


class KeyframeReference(Reference):
    """A keyframe is used while the camera is within max_m and max_deg of it: drift accumulates per
    keyframe, not per frame.

    The next keyframe is a frame from half that distance on, not the last one. The baseline is then
    never too small to separate a glass pane from the scene behind it by parallax. Errors of a
    keyframe stay. So it is a frame with the status OK, if there is one: the one that adds the
    smallest variance per distance from the keyframe before, or the first one if variances are
    unknown. Raises InputError unless both distances are positive.
    """

    def __init__(self, max_m: float = 0.2, max_deg: float = 10.0) -> None:
        if not (max_m > 0 and max_deg > 0):
            raise InputError(
                "a keyframe distance above 0 m and 0 degrees",
                found=f"{max_m:g} m, {max_deg:g} degrees",
            )
        self.max_m, self.max_deg = max_m, max_deg
        self.keyframe: View | None = None
        self.candidate: View | None = None
        self.variance, self.far = (
            math.inf,
            False,
        )  # the candidate's; whether the frame before was beyond the distance

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None
    ) -> View:
        if self.keyframe is None:
            return self.restart(frame, prepared, T_world_camera)
        current, trusted = (prepared, T_world_camera), result is None or result.status is Status.OK
        distance, candidate = self._distance(self.keyframe, T_world_camera), self.candidate
        if distance >= 1.0 and (trusted or self.far):  # a single DEGENERATE frame may be an outlier
            usable = (
                candidate
                if candidate and self._distance(candidate, T_world_camera) < 1.0
                else current
            )
            self.keyframe, self.candidate = usable, None
            distance = self._distance(usable, T_world_camera)
        self.far = distance >= 1.0
        if trusted and distance >= 0.5:
            variance = result.largest_sigma_m**2 / distance if result else math.nan
            if self.candidate is None or variance < self.variance:
                self.candidate, self.variance = current, variance
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.keyframe, self.candidate, self.far = (prepared, T_world_camera), None, False
        return self.keyframe

    def _distance(self, view: View, T_world_camera: SE3) -> float:
        """Distance of the camera from a view: the larger one of translation and rotation, as shares
        of max_m and max_deg.
        """
        moved_m = float(np.linalg.norm(T_world_camera.translation - view[1].translation))
        turned_deg = math.degrees(so3.angle(view[1].rotation.T @ T_world_camera.rotation))
        return max(moved_m / self.max_m, turned_deg / self.max_deg)


class MatchesReference(Reference):
    """A reference frame is used while at least `min_matches` features match (Huang 2011, section
    3.6; 150 in the authors' program).
    """

    def __init__(self, min_matches: int = 150) -> None:
        self.min_matches = min_matches
        self.view: View | None = None

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None
    ) -> View:
        if self.view is None or result is None or result.matches < self.min_matches:
            return self.restart(frame, prepared, T_world_camera)
        return self.view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.view = prepared, T_world_camera
        return self.view


class MatchedKeyframeReference(KeyframeReference):
    """A keyframe as above, replaced by the current frame as soon as fewer than `min_share` of the
    matches of its first alignment are left:
    points that move differently are few between close frames, and may be the majority between far
    ones. 0.75 is ORB-SLAM2's bound for RGB-D cameras (R. Mur-Artal, J. D. Tardos, T-RO 2017;
    `thRefRatio` in its Tracking.cc). A frame that does not fit the keyframe is aligned with the
    frame before, as in the authors' program of FOVIS; after MAX_LOST such frames in a row the
    current one is the keyframe.
    """

    tries_last = True

    def __init__(self, min_share: float = 0.75) -> None:
        super().__init__()
        self.min_share = min_share
        self.first_matches: int | None = None  # of the keyframe's first alignment

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None
    ) -> View:
        before, view = self.keyframe, super().renew(frame, prepared, T_world_camera, result)
        if view is not before or result is None:
            self.first_matches = None
        elif self.first_matches is None:
            self.first_matches = result.matches
        elif result.matches < self.min_share * self.first_matches:
            return self.restart(frame, prepared, T_world_camera)
        return view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.first_matches = None
        return super().restart(frame, prepared, T_world_camera)


class EntropyReference(KeyframeReference):
    """A keyframe is used while the ratio of the motion's entropy to that of the keyframe's first
    motion is at least min_ratio:
    C. Kerl, J. Sturm, D. Cremers, "Dense visual SLAM for RGB-D cameras", IROS 2013, section IV-B.
    The next keyframe is the last frame for which this was true.
    """

    def __init__(self, min_ratio: float = 0.91) -> None:
        super().__init__()
        self.min_ratio, self.first_entropy = min_ratio, math.nan

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None
    ) -> View:
        entropy = _entropy(result)
        if self.keyframe is None or not math.isfinite(entropy):
            return self.restart(frame, prepared, T_world_camera)
        if math.isnan(self.first_entropy):
            self.first_entropy = entropy
        elif (
            entropy / self.first_entropy < self.min_ratio
        ):  # both are negative if the motion is certain to millimetres
            self.keyframe, self.first_entropy = self.candidate or self.keyframe, math.nan
        self.candidate = prepared, T_world_camera
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.first_entropy = math.nan
        return super().restart(frame, prepared, T_world_camera)


def _entropy(result: Result | None) -> float:
    """ln of the determinant of the covariance, without the constants of a normal distribution; NaN
    without information.
    """
    if result is None or not result.residual > 0:
        return math.nan
    is_information = math.isfinite(result.largest_sigma_m)
    values = np.linalg.eigvalsh(
        result.information if is_information else result.information / result.residual**2
    )
    return -float(np.log(values).sum()) if values[0] > 0 else math.nan


#: Valid values of an odometer's `reference`.
REFERENCES = {
    "frame": Reference,
    "keyframe": KeyframeReference,
    "entropy": EntropyReference,
    "matches": MatchesReference,
    "matched-keyframe": MatchedKeyframeReference,
}


def reference(name: str) -> Reference:
    """A new Reference by name. Raises InputError for an unknown name."""
    if name not in REFERENCES:
        raise InputError(f"a reference ({', '.join(REFERENCES)})", found=name)
    return REFERENCES[name]()


@dataclass(frozen=True, eq=False)
class Tracked:
    """A tracked frame.

    The world is the first camera. If `lost`, the pose comes from the policy and is not measured.
    """

    stamp_s: float
    T_world_camera: SE3
    result: Result

    @property
    def lost(self) -> bool:
        return self.result.status is Status.FAILED


class Tracker:
    """Tracks frames one by one, with constant memory and time per frame. against: the reference; by
    default the odometer's own.

    Each alignment starts from a constant-velocity prediction, except after a lost frame. A frame that repeats the one before is not aligned: it keeps the
    pose and is DEGENERATE, as is the next tracked frame after it, and a frame whose predecessor was
    a DEGENERATE outlier: the motion between the two is wrong. So is a frame that has not converged
    after a pose with a standard deviation of more than WRONG_M: it started from a motion that is
    not known; and one that has not converged and is farther from its prediction than what counts as
    wrong. Raises InputError for an unknown policy.
    """

    def __init__(
        self,
        odometer: Odometer,
        camera: PinholeCamera,
        policy: str = "hold",
        against: Reference | None = None,
    ) -> None:
        if policy not in POLICIES:
            raise InputError(f"a policy for lost frames ({', '.join(POLICIES)})", found=policy)
        self.odometer, self.camera, self.policy = odometer, camera, policy
        self.reference = against or reference(odometer.reference)
        self.previous: Any = None  # prepare()'s output for the last usable frame
        self.view: Any = None
        self.T_world_view = self.T_view_camera = self.motion = SE3.identity()
        self.last: Frame | None = None  # the last frame, if it was tracked
        self.pose_s, self.motion_s = (
            math.nan,
            math.nan,
        )  # the time of the pose T_view_camera, and how long the last motion took
        self.losses, self.repeated = 0, False
        # number of consecutive frames that do not fit the view and were aligned with the frame
        # before
        self.unfit = 0
        self.assumed = False  # whether the pose of the view comes from the policy
        # stamp and pose of the last frame that was OK, or of the assumed pose of the view since
        # then; of the last tracked frame, if it was DEGENERATE
        self.good: tuple[float, SE3] | None = None
        self.doubtful: tuple[float, SE3] | None = None
        self.uncertain = False  # whether the standard deviation of the last pose is above WRONG_M

    def add(self, stamp_s: float, frame: Frame | str) -> Tracked:
        """Track a frame, or record the reason why there is none as a lost frame."""
        started = time.perf_counter()
        if not isinstance(frame, str) and self.last and frame.repeats(self.last):
            self.repeated = True
            repeat = Result(
                self.T_view_camera, Status.DEGENERATE, reason="image: repeats the one before"
            )
            return Tracked(stamp_s, self.T_world_view @ self.T_view_camera, repeat)
        current, result = self._aligned(stamp_s, frame)
        if isinstance(frame, str) or result.status is Status.FAILED:
            self.last, pose = None, self._on_lost(stamp_s, frame, current)
        else:
            self.last, pose = frame, self._tracked(stamp_s, frame, current, result)
            self.repeated = False
        return Tracked(stamp_s, pose, replace(result, seconds=time.perf_counter() - started))

    def _aligned(self, stamp_s: float, frame: Frame | str) -> tuple[Any, Result]:
        """The output of prepare() for the frame (None: not usable), and its alignment."""
        fault = frame if isinstance(frame, str) else frame.fault(self.camera)
        if fault or isinstance(frame, str):
            return None, failure(fault)
        previous, current = self.previous, self.odometer.prepare(frame, self.camera)
        self.previous = current
        if self.view is None:
            return current, Result(SE3.identity(), residual=0.0, inliers=1.0)
        motion = SE3.identity() if self.losses else self._predicted(stamp_s)
        guess = self.T_view_camera @ motion
        result = self.odometer.align(self.view, current, guess)
        if (
            result.status is Status.FAILED
            and self.reference.tries_last
            and self.last
            and self.view is not previous
        ):
            return current, self._against_last(previous, current, motion, result)
        self.unfit = 0
        if result.status is Status.OK and (doubt := self._doubt(stamp_s, frame, guess, result)):
            result = replace(result, status=Status.DEGENERATE, reason=doubt)
        return current, result

    def _against_last(self, previous: Any, current: Any, motion: SE3, lost: Result) -> Result:
        """The alignment with the last frame of a frame that does not fit the view, DEGENERATE;
        `lost` if this fails as well.
        """
        result = self.odometer.align(previous, current, motion)
        if result.status is Status.FAILED:
            return lost
        self.unfit += 1
        reason = result.reason or "track: does not fit the reference, aligned with the frame before"
        return replace(result, status=Status.DEGENERATE, reason=reason)

    def _doubt(self, stamp_s: float, frame: Frame, guess: SE3, result: Result) -> str:
        """The reason why a pose that its odometer reports as OK is DEGENERATE; empty if there is
        none.
        """
        if frame.flat():  # such depth fits every motion that keeps its distance
            return "depth: the same value in all pixels"
        if self.assumed:
            return "track: aligned with a lost frame, whose pose is not measured"
        if self.repeated:
            return "track: moved since the first of repeated frames, at an unknown time"
        if self._after_outlier(stamp_s, self.T_world_view @ result.T_reference_camera):
            return "track: the pose before was an outlier"
        if self.uncertain and not result.converged:
            return "track: not converged, and the pose before was uncertain"
        if not result.converged and _apart(guess, result.T_reference_camera, WRONG_M, WRONG_DEG):
            return "track: not converged, and far from the prediction"
        return ""

    def _after_outlier(self, stamp_s: float, T_world_camera: SE3) -> bool:
        """Whether the last tracked pose was DEGENERATE and is not on the path from the last one
        that was OK to this one.
        """
        if self.good is None or self.doubtful is None:
            return False
        (good_s, T_world_good), (doubtful_s, T_world_doubtful) = self.good, self.doubtful
        expected = T_world_good.interpolate(
            T_world_camera, (doubtful_s - good_s) / (stamp_s - good_s)
        )
        return _apart(expected, T_world_doubtful, OUTLIER_M, OUTLIER_DEG)

    def _predicted(self, stamp_s: float) -> SE3:
        """The last motion, for as long as the last pose is ago."""
        times = min(stamp_s - self.pose_s, MAX_EXTRAPOLATION_S) / self.motion_s
        if not abs(times - 1) > 0.01:  # rounded stamps; or none to compare with
            return self.motion
        return SE3.exp(times * self.motion.log())

    def _tracked(self, stamp_s: float, frame: Frame, current: Any, result: Result) -> SE3:
        T_view_reference = self.T_view_camera if self.unfit else SE3.identity()
        T_view_camera = _rigid(T_view_reference @ result.T_reference_camera)
        self.motion, self.losses, self.assumed = (
            self.T_view_camera.inverse() @ T_view_camera,
            0,
            False,
        )
        self.motion_s, self.pose_s = stamp_s - self.pose_s, stamp_s
        self.uncertain = result.largest_sigma_m > WRONG_M
        if result.under_constrained:
            self.motion = SE3.exp(PREDICTION_DECAY * self.motion.log())
        pose = _rigid(self.T_world_view @ T_view_camera)
        if result.status is Status.OK:
            self.good, self.doubtful = (stamp_s, pose), None
        else:
            self.doubtful = stamp_s, pose
        if self.unfit < MAX_LOST:
            view = self.reference.renew(frame, current, pose, result)
        else:
            view, self.unfit = self.reference.restart(frame, current, pose), 0
        self._set_view(view, pose)
        return pose

    def _on_lost(self, stamp_s: float, frame: Frame | str, current: Any) -> SE3:
        self.losses, self.unfit = self.losses + 1, 0
        if self.policy == "constant-velocity":
            self.T_view_camera, self.pose_s = self.T_view_camera @ self._predicted(stamp_s), stamp_s
        pose = _rigid(self.T_world_view @ self.T_view_camera)
        if (
            not isinstance(frame, str)
            and current is not None
            and (self.policy == "restart" or self.losses >= MAX_LOST)
        ):
            self._set_view(self.reference.restart(frame, current, pose), pose)
            self.assumed, self.pose_s = True, stamp_s
            self.good, self.doubtful = (stamp_s, pose), None  # later poses are relative to it
        return pose

    def _set_view(self, view: tuple[Any, SE3], pose: SE3) -> None:
        self.view, self.T_world_view = view
        self.T_view_camera = self.T_world_view.inverse() @ pose


def _apart(T_one: SE3, T_other: SE3, max_m: float, max_deg: float) -> bool:
    """Whether two poses differ by more than max_m, or by max_deg degrees or more."""
    return bool(np.linalg.norm(T_one.translation - T_other.translation) > max_m) or rotated(
        T_one, T_other, max_deg
    )


def _rigid(T: SE3) -> SE3:
    """T with the nearest rotation matrix: in a chain of poses and inverses (transposes) rounding
    errors would accumulate.
    """
    return SE3(so3.nearest_rotation(T.rotation), T.translation)


def track(
    odometer: Odometer,
    camera: PinholeCamera,
    frames: Iterable[tuple[float, Frame | str]],
    policy: str = "hold",
    against: Reference | None = None,
) -> Iterator[Tracked]:
    """One Tracked per frame, in order."""
    tracker = Tracker(odometer, camera, policy, against)
    for stamp_s, frame in frames:
        yield tracker.add(stamp_s, frame)
