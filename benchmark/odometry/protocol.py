"""The protocol of all odometers (built-in, third-party and user-provided): their arguments and
results.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.shown import Brief

#: A frame with depth in less than this share of its pixels is not tracked.
MIN_DEPTH_SHARE = 0.02
#: Depth whose range is less than this counts as one value (noise of 0.1 mm has a range of 0.9 mm).
#: On a wall 2 m away this range is a tilt of 0.02 degrees.
FLAT_M = 1e-3

#: A motion with a larger error counts as wrong.
WRONG_M, WRONG_DEG = 0.02, 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Frame(Brief):
    """grey (h, w) float32 in 0..255, depth_z_m (h, w) float32 planar depth in metres with 0 =
    missing, and the time stamp.

    calibrated: the constant offset of the sensor's inverse depth has been subtracted.
    """

    grey: np.ndarray
    depth_z_m: np.ndarray
    stamp_s: float
    calibrated: bool = False

    @classmethod
    def of(
        cls, image: np.ndarray, depth_z_m: np.ndarray, stamp_s: float, *, depth_offset: float = 0.0
    ) -> "Frame":
        """A frame from a colour (h, w, 3) or grey image (h, w) in 0..255; NaN, infinite and
        negative depth count as missing.

        depth_offset (1/m), if it is not 0, is subtracted from inverse depth.

        Raises InputError if the two images differ in size.
        """
        image = np.asarray(image, np.float32)
        if image.ndim == 3:
            image = image @ np.array([0.299, 0.587, 0.114], np.float32)
        depth_z_m = np.asarray(depth_z_m, np.float32)
        if image.shape != depth_z_m.shape:
            raise InputError(f"depth of the image's size {image.shape}", found=depth_z_m.shape)
        if depth_offset:
            depth_z_m = depth_z_m / (1 - depth_offset * depth_z_m)
        usable = np.isfinite(depth_z_m) & (depth_z_m > 0)
        depth_z_m = np.where(usable, depth_z_m, np.float32(0))
        return cls(np.ascontiguousarray(image), depth_z_m, float(stamp_s), bool(depth_offset))

    def fault(self, camera: PinholeCamera) -> str:
        """The reason why this frame cannot be tracked with `camera`; empty if tracking can be
        attempted.
        """
        if self.depth_z_m.shape != (camera.height, camera.width):
            h, w = self.depth_z_m.shape
            return f"size: {w}x{h} instead of {camera.width}x{camera.height}"
        share = np.count_nonzero(self.depth_z_m[::2, ::2] > 0) / self.depth_z_m[::2, ::2].size
        return (
            f"depth: only {share:.1%} of the pixels have depth" if share < MIN_DEPTH_SHARE else ""
        )

    def repeats(self, other: "Frame") -> bool:
        """Whether image and depth are exactly those of `other`: the camera is at rest in a rendered
        scene, or its driver repeats a frame.
        """
        same_depth = np.array_equal(self.depth_z_m, other.depth_z_m)
        return same_depth and np.array_equal(self.grey, other.grey)

    def flat(self) -> bool:
        """Whether all depth has one value to within FLAT_M, in every second row and column. Such
        depth is not measured, or is of a wall exactly parallel to the image, so motion along the
        wall is unobservable.
        """
        some = self.depth_z_m[::2, ::2]
        nearest = some.min(initial=np.inf, where=some > 0)
        return bool(some.max() - nearest < FLAT_M)


class OdometryStatus(Enum):
    """OK and DEGENERATE have a pose. DEGENERATE: the motion is under-constrained in some direction,
    depth disagrees with it, all depth has one value, the frame repeats the one before, the pose
    before it was a DEGENERATE outlier, or the alignment did not converge after an uncertain pose.
    FAILED has no pose: the frame is lost.
    """

    OK = "ok"
    DEGENERATE = "degenerate"
    FAILED = "failed"


@dataclass(frozen=True, eq=False, repr=False)
class OdometryResult(Brief):
    """Result of one alignment. All fields except the pose are optional; `failure(reason)` makes a
    result without a pose.

    residual: root mean square in the method's unit (grey levels or metres). inliers: share of the
    pixels used. information (6, 6): of a twist (translation, rotation) in the reference camera's
    frame. smallest_eigenvalue: of the centred, length-scaled translation block, as a share of its
    trace (at most 1/3). largest_sigma_m: standard deviation in the least certain direction, NaN
    without a noise model. matches: number of features used, 0 without features. under_constrained:
    number of directions in which the constant-velocity prediction outweighs the images. converged:
    False if the maximum number of iterations was reached.
    """

    T_reference_camera: SE3
    status: OdometryStatus = OdometryStatus.OK
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_reference_camera", SE3.of(self.T_reference_camera))


def failure(reason: str) -> OdometryResult:
    """A result without a pose. `reason` has the form `part: what`, such as `image: no contrast`."""
    return OdometryResult(SE3.identity(), OdometryStatus.FAILED, False, reason=reason)


def reads_depth_alone(odometer: "Odometer") -> bool:
    """Whether an odometer declares that it reads no grey values."""
    return bool(getattr(odometer, "reads_depth_alone", False))


class Odometer(Protocol):
    """prepare() is called once per frame, align() once per pair; both depend only on their
    arguments.

    `reference` is what a frame is aligned against by default: a name in track.REFERENCES, such as
    "frame" (the one before). Code that renders a model for an odometer passes a complete Frame to
    prepare(), unless the odometer is a `PyramidOdometer`, which declares what it reads. An odometer
    with `reads_depth_alone` gets the stamps of depth images, others those of colour images.
    """

    name: str
    reference: str

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any: ...

    def align(self, reference: Any, current: Any, guess: SE3) -> OdometryResult:
        """T_reference_camera of `current` against `reference` (both from prepare()), starting from
        `guess`.
        """
        ...
