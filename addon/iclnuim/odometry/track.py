"""From frames to a path: what is compared with what, and what happens after a frame that was lost."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .protocol import Frame, Odometer, Result, failure
from .reference import OWN, Reference
from .system import inverted

#: hold: the last pose, and the reference is kept; constant-velocity: the last motion goes on; restart: the lost frame
#: is the new reference, at the last pose
POLICIES = ("hold", "constant-velocity", "restart")
#: After so many lost frames in a row the reference shows another place.
PATIENCE = 5
#: A motion that is held and not measured fades by this factor a frame: nobody's hand goes on for ever.
FADING = 0.95


@dataclass(frozen=True, eq=False)
class Tracked:
    """T_world_camera (4, 4) with the first frame as world. Where `lost`, the pose is the policy's, not measured."""

    stamp_s: float
    T_world_camera: np.ndarray
    result: Result
    lost: bool


class Tracker:
    """One frame after the other at constant memory and cost, against `reference` (default: what the odometer wants).

    Each alignment starts from the motion of the frame before, except after a loss.
    """

    def __init__(
        self, odometer: Odometer, camera: PinholeCamera, policy: str = "hold", reference: Reference | None = None
    ) -> None:
        if policy not in POLICIES:
            raise InputError(f"a policy for lost frames ({', '.join(POLICIES)})", found=policy)
        self.odometer, self.camera, self.policy = odometer, camera, policy
        self.reference = reference or OWN[odometer.reference]()
        self.view, self.T_world_view = None, np.eye(4)
        self.T_view_camera, self.motion, self.losses = np.eye(4), np.eye(4), 0

    def add(self, stamp_s: float, frame: Frame | str) -> Tracked:
        """A frame, or the reason why there is none."""
        started = time.perf_counter()
        fault = frame if isinstance(frame, str) else frame.fault(self.camera)
        current = None if fault else self.odometer.prepare(frame, self.camera)
        result = self._aligned(current, fault)
        lost = not np.isfinite(result.residual) and bool(result.reason)
        pose = self._lost(frame, current) if lost else self._found(frame, current, result)
        return Tracked(stamp_s, pose, replace(result, seconds=time.perf_counter() - started), lost)

    def _aligned(self, current: object, fault: str) -> Result:
        if current is None:
            return failure(fault)
        if self.view is None:
            return Result(np.eye(4), True, residual=0.0, inliers=1.0)
        guess = self.T_view_camera if self.losses else self.T_view_camera @ self.motion
        return self.odometer.align(self.view, current, guess)

    def _found(self, frame: Frame, current: object, result: Result) -> np.ndarray:
        self.motion, self.losses = inverted(self.T_view_camera) @ result.T_reference_camera, 0
        if result.held:
            self.motion = SE3.exp(FADING * SE3.from_matrix(self.motion).log()).matrix
        pose = self.T_world_view @ result.T_reference_camera
        self.view, self.T_world_view = self.reference.renew(frame, current, pose, result)
        self.T_view_camera = inverted(self.T_world_view) @ pose
        return pose

    def _lost(self, frame: Frame | str, current: object) -> np.ndarray:
        self.losses += 1
        if self.policy == "constant-velocity":
            self.T_view_camera = self.T_view_camera @ self.motion
        pose = self.T_world_view @ self.T_view_camera
        if current is not None and (self.policy == "restart" or self.losses >= PATIENCE):
            self.view, self.T_world_view = self.reference.restart(frame, current, pose)
            self.T_view_camera = inverted(self.T_world_view) @ pose
        return pose


def track(
    odometer: Odometer,
    camera: PinholeCamera,
    frames: Iterable[tuple[float, Frame | str]],
    policy: str = "hold",
    reference: Reference | None = None,
) -> Iterator[Tracked]:
    """One Tracked a frame, in order."""
    tracker = Tracker(odometer, camera, policy, reference)
    for stamp_s, frame in frames:
        yield tracker.add(stamp_s, frame)
