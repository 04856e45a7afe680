"""From frames to a path: what is compared with what, and what happens after a frame that was lost."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera

from .protocol import Frame, Odometer, Result, failure

#: hold: the last pose, and the reference is kept; constant-velocity: the last motion goes on; restart: the lost frame
#: is the new reference, at the last pose
POLICIES = ("hold", "constant-velocity", "restart")
#: After so many lost frames in a row the reference shows another place.
PATIENCE = 5


@dataclass(frozen=True, eq=False)
class Tracked:
    """T_world_camera (4, 4) with the first frame as world. Where `lost`, the pose is the policy's, not a measurement."""

    stamp_s: float
    T_world_camera: np.ndarray
    result: Result
    lost: bool


class Tracker:
    """Frame-to-frame tracking; constant memory and constant cost a frame."""

    def __init__(self, odometer: Odometer, camera: PinholeCamera, policy: str = "hold") -> None:
        if policy not in POLICIES:
            raise InputError(f"a policy for lost frames ({', '.join(POLICIES)})", found=policy)
        self.odometer, self.camera, self.policy = odometer, camera, policy
        self.reference, self.T_world_reference = None, np.eye(4)
        self.pose, self.motion, self.losses = np.eye(4), np.eye(4), 0

    def add(self, stamp_s: float, frame: Frame | str) -> Tracked:
        """A frame, or the reason why there is none."""
        started = time.perf_counter()
        fault = frame if isinstance(frame, str) else frame.fault(self.camera)
        current = None if fault else self.odometer.prepare(frame, self.camera)
        result = self._aligned(current, fault)
        lost = not np.isfinite(result.residual) and bool(result.reason)
        self._go_on(current, result, lost)
        return Tracked(stamp_s, self.pose, replace(result, seconds=time.perf_counter() - started), lost)

    def _aligned(self, current: object, fault: str) -> Result:
        if current is None:
            return failure(fault)
        if self.reference is None:
            return Result(np.eye(4), True, residual=0.0, inliers=1.0)
        guess = np.linalg.inv(self.T_world_reference) @ self.pose
        return self.odometer.align(self.reference, current, guess)

    def _go_on(self, current: object, result: Result, lost: bool) -> None:
        if not lost:
            pose = self.T_world_reference @ result.T_reference_camera
            self.motion, self.pose, self.losses = np.linalg.inv(self.pose) @ pose, pose, 0
            self.reference, self.T_world_reference = current, pose
            return
        self.losses += 1
        if self.policy == "constant-velocity":
            self.pose = self.pose @ self.motion
        if current is not None and (self.policy == "restart" or self.losses >= PATIENCE):
            self.reference, self.T_world_reference = current, self.pose


def track(
    odometer: Odometer, camera: PinholeCamera, frames: Iterable[tuple[float, Frame | str]], policy: str = "hold"
) -> Iterator[Tracked]:
    """One Tracked a frame, in order."""
    tracker = Tracker(odometer, camera, policy)
    for stamp_s, frame in frames:
        yield tracker.add(stamp_s, frame)
