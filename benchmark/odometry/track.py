"""Tracking: from frames to a trajectory, with a prediction for each frame, and a policy for lost
ones.
"""

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.camera import CameraOrText, PinholeCamera
from iclnuim.geometry.se3 import SE3

from .protocol import Frame, Odometer, OdometryResult, OdometryStatus, failure
from .references import Reference, View, reference
from .watch import Watch

#: Pose of a lost frame. hold: the last pose, and the reference does not change; constant-velocity:
#: the last motion continues; restart: the last pose, and the lost frame is the new reference
POLICIES = ("hold", "constant-velocity", "restart")
#: After this number of consecutive lost frames the reference is replaced, because it probably shows
#: another place.
MAX_LOST = 5
#: Decay per frame of a constant-velocity prediction in under-constrained directions
#: (OdometryResult.under_constrained).
PREDICTION_DECAY = 0.95
#: A motion is extrapolated over at most this time: a second later a camera in the hand has moved
#: 0.7 to 0.95 of that (all eight trajectories).
MAX_EXTRAPOLATION_S = 1.0


@dataclass(frozen=True, eq=False)
class Tracked:
    """A tracked frame.

    The world is the first camera. If `lost`, the pose comes from the policy and is not measured.
    """

    stamp_s: float
    T_world_camera: SE3
    result: OdometryResult

    @property
    def lost(self) -> bool:
        return self.result.status is OdometryStatus.FAILED


class ConstantVelocity:
    """The last motion goes on for as long as the last pose is ago."""

    def __init__(self) -> None:
        self.motion = SE3.identity()
        self.motion_s = math.nan  # how long it took
        self.pose_s = math.nan  # the time of the last pose

    def predicted(self, stamp_s: float) -> SE3:
        times = min(stamp_s - self.pose_s, MAX_EXTRAPOLATION_S) / self.motion_s
        if not abs(times - 1) > 0.01:  # rounded stamps; or none to compare with
            return self.motion
        return SE3.exp(times * self.motion.log())

    def note(self, stamp_s: float, motion: SE3, result: OdometryResult) -> None:
        """The motion to a tracked frame."""
        self.motion_s = stamp_s - self.pose_s
        self.pose_s = stamp_s
        self.motion = motion
        if result.under_constrained:
            self.motion = SE3.exp(PREDICTION_DECAY * motion.log())


class Tracker:
    """Tracks frames one by one, with constant memory and time per frame. against: the reference; by
    default the odometer's own.

    Each alignment starts from a constant-velocity prediction, except after a lost frame. A frame
    that repeats the one before is not aligned: it keeps the pose and is DEGENERATE, as is a pose
    that the Watch doubts. Raises InputError for an unknown policy.
    """

    def __init__(
        self,
        odometer: Odometer,
        camera: CameraOrText,
        policy: str = "hold",
        against: Reference | None = None,
    ) -> None:
        if policy not in POLICIES:
            raise InputError(f"a policy for lost frames ({', '.join(POLICIES)})", found=policy)
        self.odometer = odometer
        self.camera = PinholeCamera.of(camera)
        self.policy = policy
        self.reference = against or reference(odometer.reference)
        self.watch = Watch()
        self.velocity = ConstantVelocity()
        self.previous: Any = None  # prepare()'s output for the last usable frame
        self.view: Any = None
        self.T_world_view = SE3.identity()
        self.T_view_camera = SE3.identity()
        self.last: Frame | None = None  # the last frame, if it was tracked
        self.losses = 0
        # number of consecutive frames that do not fit the view and were aligned with the frame
        # before
        self.unfit = 0

    def add(self, stamp_s: float, frame: Frame | str) -> Tracked:
        """Track a frame, or record the reason why there is none as a lost frame."""
        started = time.perf_counter()
        if not isinstance(frame, str) and self.last and frame.repeats(self.last):
            self.watch.repeated = True
            reason = "image: repeats the one before"
            repeat = OdometryResult(self.T_view_camera, OdometryStatus.DEGENERATE, reason=reason)
            return Tracked(stamp_s, self.T_world_view @ self.T_view_camera, repeat)
        current, result = self._aligned(stamp_s, frame)
        if isinstance(frame, str) or result.status is OdometryStatus.FAILED:
            self.last = None
            pose = self._on_lost(stamp_s, frame, current)
        else:
            self.last = frame
            pose = self._on_tracked(stamp_s, frame, current, result)
        return Tracked(stamp_s, pose, replace(result, seconds=time.perf_counter() - started))

    def _aligned(self, stamp_s: float, frame: Frame | str) -> tuple[Any, OdometryResult]:
        """The output of prepare() for the frame (None: not usable), and its alignment."""
        if isinstance(frame, str):
            return None, failure(frame)
        fault = frame.fault(self.camera)
        if fault:
            return None, failure(fault)
        previous = self.previous
        current = self.previous = self.odometer.prepare(frame, self.camera)
        if self.view is None:
            return current, OdometryResult(SE3.identity(), residual=0.0, inliers=1.0)
        motion = SE3.identity() if self.losses else self.velocity.predicted(stamp_s)
        guess = self.T_view_camera @ motion
        result = self.odometer.align(self.view, current, guess)
        if result.status is OdometryStatus.FAILED and self._may_try_last(previous):
            return current, self._against_last(previous, current, motion, result)
        self.unfit = 0
        if result.status is OdometryStatus.OK:
            pose = self.T_world_view @ result.T_reference_camera
            doubt = self.watch.doubt(stamp_s, frame, guess, result, pose)
            if doubt:
                result = replace(result, status=OdometryStatus.DEGENERATE, reason=doubt)
        return current, result

    def _may_try_last(self, previous: Any) -> bool:
        return self.reference.tries_last and bool(self.last) and self.view is not previous

    def _against_last(
        self, previous: Any, current: Any, motion: SE3, lost: OdometryResult
    ) -> OdometryResult:
        """The alignment with the last frame of a frame that does not fit the view, DEGENERATE;
        `lost` if this fails as well.
        """
        result = self.odometer.align(previous, current, motion)
        if result.status is OdometryStatus.FAILED:
            return lost
        self.unfit += 1
        reason = result.reason or "track: does not fit the reference, aligned with the frame before"
        return replace(result, status=OdometryStatus.DEGENERATE, reason=reason)

    def _on_tracked(
        self, stamp_s: float, frame: Frame, current: Any, result: OdometryResult
    ) -> SE3:
        T_view_reference = self.T_view_camera if self.unfit else SE3.identity()
        T_view_camera = _rigid(T_view_reference @ result.T_reference_camera)
        self.losses = 0
        self.velocity.note(stamp_s, self.T_view_camera.inverse() @ T_view_camera, result)
        pose = _rigid(self.T_world_view @ T_view_camera)
        self.watch.note(stamp_s, pose, result)
        if self.unfit < MAX_LOST:
            view = self.reference.renew(frame, current, pose, result)
        else:
            view = self.reference.restart(frame, current, pose)
            self.unfit = 0
        self._set_view(view, pose)
        return pose

    def _on_lost(self, stamp_s: float, frame: Frame | str, current: Any) -> SE3:
        self.losses += 1
        self.unfit = 0
        if self.policy == "constant-velocity":
            self.T_view_camera = self.T_view_camera @ self.velocity.predicted(stamp_s)
            self.velocity.pose_s = stamp_s
        pose = _rigid(self.T_world_view @ self.T_view_camera)
        replace_view = self.policy == "restart" or self.losses >= MAX_LOST
        if replace_view and current is not None and not isinstance(frame, str):
            self._set_view(self.reference.restart(frame, current, pose), pose)
            self.velocity.pose_s = stamp_s
            self.watch.assume(stamp_s, pose)
        return pose

    def _set_view(self, view: View, pose: SE3) -> None:
        self.view, self.T_world_view = view
        self.T_view_camera = self.T_world_view.inverse() @ pose


def _rigid(T: SE3) -> SE3:
    """T with the nearest rotation matrix: in a chain of poses and inverses (transposes) rounding
    errors would accumulate.
    """
    return SE3(so3.nearest_rotation(T.rotation), T.translation)


def track(
    odometer: Odometer,
    camera: CameraOrText,
    frames: Iterable[tuple[float, Frame | str]],
    policy: str = "hold",
    against: Reference | None = None,
) -> Iterator[Tracked]:
    """One Tracked per frame, in order."""
    tracker = Tracker(odometer, camera, policy, against)
    for stamp_s, frame in frames:
        yield tracker.add(stamp_s, frame)
