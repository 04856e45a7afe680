"""What an odometer takes and returns: the protocol that the built-in odometers, the baselines and anyone's own share."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: A frame with depth in less than this share of its pixels is not tracked.
MIN_DEPTH_SHARE = 0.02
#: Depth that spans less than this (noise of 0.1 mm spans 0.9) has no shape; across a wall 2 m away it is a tilt of 0.02 degrees.
FLAT_M = 1e-3


@dataclass(frozen=True, eq=False)
class Frame:
    """grey (h, w) float32 in 0..255, depth_z_m (h, w) float32 planar metres with 0 = missing, and the time stamp."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    stamp_s: float

    @classmethod
    def of(cls, image: np.ndarray, depth_z_m: np.ndarray, stamp_s: float) -> "Frame":
        """Colour (h, w, 3) or grey (h, w) in 0..255; NaN, infinite and negative depth count as missing.

        Raises InputError where the two images differ in size.
        """
        image = np.asarray(image, np.float32)
        if image.ndim == 3:
            image = image @ np.array([0.299, 0.587, 0.114], np.float32)
        depth_z_m = np.asarray(depth_z_m, np.float32)
        if image.shape != depth_z_m.shape:
            raise InputError(f"depth of the image's size {image.shape}", found=depth_z_m.shape)
        usable = np.isfinite(depth_z_m) & (depth_z_m > 0)
        return cls(np.ascontiguousarray(image), np.where(usable, depth_z_m, np.float32(0)), float(stamp_s))

    def fault(self, camera: PinholeCamera) -> str:
        """Why this frame cannot be tracked with `camera`; empty where it can be tried."""
        if self.depth_z_m.shape != (camera.height, camera.width):
            h, w = self.depth_z_m.shape
            return f"size: {w}x{h} instead of {camera.width}x{camera.height}"
        share = np.count_nonzero(self.depth_z_m[::2, ::2] > 0) / self.depth_z_m[::2, ::2].size
        return f"depth: only {share:.1%} of the pixels have any" if share < MIN_DEPTH_SHARE else ""

    def flat(self) -> bool:
        """Whether all depth is one value to within FLAT_M: not measured, or of a wall that the camera faces exactly, which tells no
        motion along it. Every second row and column is looked at."""
        some = self.depth_z_m[::2, ::2]
        nearest = some.min(initial=np.inf, where=some > 0)
        return bool(some.max() - nearest < FLAT_M)


class Status(Enum):
    """OK and DEGENERATE have a pose; DEGENERATE is under-constrained in some direction, or depth calls for another motion, or is one
    value. FAILED has none: the frame is lost.
    """

    OK = "ok"
    DEGENERATE = "degenerate"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Result:
    """One alignment. Everything but the pose may be left out; `failure(reason)` makes one without a pose.

    residual: root mean square in the method's unit (grey levels or metres); inliers: share of the pixels used.
    information (6, 6): of a twist (translation, rotation) in the reference camera's frame. smallest_eigenvalue: of the
    centred, length-scaled translation block, as a share of its trace (1/3 at best). largest_sigma_m: standard deviation
    in the least certain direction, NaN without a noise model. matches: features used, 0 where there are none. under_constrained: in how many directions the
    constant-velocity prediction outweighs the images. converged: false where the iterations were used up.
    """

    T_reference_camera: SE3
    status: Status = Status.OK
    converged: bool = True
    iterations: int = 0
    residual: float = float("nan")
    inliers: float = 0.0
    information: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    smallest_eigenvalue: float = float("nan")
    largest_sigma_m: float = float("nan")
    under_constrained: int = 0
    matches: int = 0
    seconds: float = 0.0
    reason: str = ""


def failure(reason: str) -> Result:
    """No pose was found; `reason` reads `part: what`, such as `image: no contrast`."""
    return Result(SE3.identity(), Status.FAILED, False, reason=reason)


class Odometer(Protocol):
    """prepare() runs once a frame, align() once a pair; both depend on nothing but their arguments.

    `reference`: what a frame is best aligned against: "frame" (the one before), "keyframe" or "entropy". Whoever renders a
    model for an odometer hands a whole Frame to prepare(), unless it is a `PyramidOdometer`, which names what it reads.
    """

    name: str
    reference: str

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any: ...

    def align(self, reference: Any, current: Any, guess: SE3) -> Result:
        """T_reference_camera of `current` against `reference` (both from prepare()), starting from `guess`."""
        ...
