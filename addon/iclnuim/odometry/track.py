"""From frames to a trajectory: what a frame is aligned against, and what happens after one that was lost."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ..errors import InputError
from ..geometry import so3
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .protocol import Frame, Odometer, Result, Status, failure
from .reference import Reference, reference

#: hold: the last pose, and the reference stays; constant-velocity: the last motion goes on; restart: the lost frame
#: is the new reference, at the last pose
POLICIES = ("hold", "constant-velocity", "restart")
#: After so many lost frames in a row the reference shows another place, and is replaced.
MAX_LOST = 5
#: Decay a frame of a constant-velocity prediction that the images did not confirm (Result.under_constrained).
PREDICTION_DECAY = 0.95


@dataclass(frozen=True, eq=False)
class Tracked:
    """T_world_camera with the first frame as world. Where `lost`, the pose is the policy's, not measured."""

    stamp_s: float
    T_world_camera: SE3
    result: Result

    @property
    def lost(self) -> bool:
        return self.result.status is Status.FAILED


class Tracker:
    """One frame after the other at constant memory and cost, against `against` (default: what the odometer asks for).

    Each alignment starts from a constant-velocity prediction, except after a loss. Raises InputError for an unknown policy.
    """

    def __init__(
        self, odometer: Odometer, camera: PinholeCamera, policy: str = "hold", against: Reference | None = None
    ) -> None:
        if policy not in POLICIES:
            raise InputError(f"a policy for lost frames ({', '.join(POLICIES)})", found=policy)
        self.odometer, self.camera, self.policy = odometer, camera, policy
        self.reference = against or reference(odometer.reference)
        self.view: Any = None
        self.T_world_view = self.T_view_camera = self.motion = SE3.identity()
        self.losses = 0

    def add(self, stamp_s: float, frame: Frame | str) -> Tracked:
        """A frame, or the reason why there is none."""
        started = time.perf_counter()
        current, result = self._aligned(frame)
        if isinstance(frame, str) or result.status is Status.FAILED:
            pose = self._lost(frame, current)
        else:
            pose = self._found(frame, current, result)
        return Tracked(stamp_s, pose, replace(result, seconds=time.perf_counter() - started))

    def _aligned(self, frame: Frame | str) -> tuple[Any, Result]:
        """What prepare() made of the frame (None: it cannot be used), and its alignment."""
        fault = frame if isinstance(frame, str) else frame.fault(self.camera)
        if fault or isinstance(frame, str):
            return None, failure(fault)
        current = self.odometer.prepare(frame, self.camera)
        if self.view is None:
            return current, Result(SE3.identity(), residual=0.0, inliers=1.0)
        guess = self.T_view_camera if self.losses else self.T_view_camera @ self.motion
        return current, self.odometer.align(self.view, current, guess)

    def _found(self, frame: Frame, current: Any, result: Result) -> SE3:
        T_view_camera = _rigid(result.T_reference_camera)
        self.motion, self.losses = self.T_view_camera.inverse() @ T_view_camera, 0
        if result.under_constrained:
            self.motion = SE3.exp(PREDICTION_DECAY * self.motion.log())
        pose = _rigid(self.T_world_view @ T_view_camera)
        self._look(self.reference.renew(frame, current, pose, result), pose)
        return pose

    def _lost(self, frame: Frame | str, current: Any) -> SE3:
        self.losses += 1
        if self.policy == "constant-velocity":
            self.T_view_camera = self.T_view_camera @ self.motion
        pose = self.T_world_view @ self.T_view_camera
        if not isinstance(frame, str) and current is not None and (self.policy == "restart" or self.losses >= MAX_LOST):
            self._look(self.reference.restart(frame, current, pose), pose)
        return pose

    def _look(self, view: tuple[Any, SE3], pose: SE3) -> None:
        self.view, self.T_world_view = view
        self.T_view_camera = self.T_world_view.inverse() @ pose


def _rigid(T: SE3) -> SE3:
    """With the nearest rotation: in a chain of poses and inverses (transposes) rounding would grow from frame to frame."""
    return SE3(so3.nearest_rotation(T.rotation), T.translation)


def track(
    odometer: Odometer,
    camera: PinholeCamera,
    frames: Iterable[tuple[float, Frame | str]],
    policy: str = "hold",
    against: Reference | None = None,
) -> Iterator[Tracked]:
    """One Tracked a frame, in order."""
    tracker = Tracker(odometer, camera, policy, against)
    for stamp_s, frame in frames:
        yield tracker.add(stamp_s, frame)
