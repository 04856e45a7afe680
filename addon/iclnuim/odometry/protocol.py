"""What an odometer takes and returns: the one protocol that ours and the peers' adapters share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera

#: A frame with less depth than this share of its pixels cannot be tracked.
LEAST_DEPTH_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Frame:
    """grey (h, w) float32 in 0..255, depth_z_m (h, w) float32 planar metres with 0 = missing, the moment."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    stamp_s: float

    @classmethod
    def of(cls, image: np.ndarray, depth_z_m: np.ndarray, stamp_s: float) -> Frame:
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
        return f"depth: only {share:.1%} of the pixels have any" if share < LEAST_DEPTH_SHARE else ""


@dataclass(frozen=True, eq=False)
class Result:
    """One alignment. T_reference_camera (4, 4); residual in the method's unit (grey levels or metres).

    information (6, 6) belongs to a twist (translation, rotation) in the reference camera's frame. smallest_eigenvalue
    is that of the centred, length-scaled translation block, as a share of its trace (1/3 at best); weakest_sigma_m the
    standard deviation in the direction known least (NaN where the preset has no noise model); `held` counts the
    directions in which the guess was believed more than the images. A failure has converged = False and a reason; its
    pose is not to be believed.
    """

    T_reference_camera: np.ndarray
    converged: bool
    iterations: int = 0
    residual: float = float("nan")
    inliers: float = 0.0
    information: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    smallest_eigenvalue: float = float("nan")
    weakest_sigma_m: float = float("nan")
    degenerate: bool = False
    held: int = 0
    seconds: float = 0.0
    reason: str = ""


def failure(reason: str) -> Result:
    return Result(np.eye(4), False, reason=reason)


class Odometer(Protocol):
    """prepare() once a frame, align() once a pair; both depend on nothing but their arguments."""

    name: str
    #: what it is best compared with: "frame" (the one before) or "kept"
    reference: str

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any: ...

    def align(self, reference: Any, current: Any, guess: np.ndarray) -> Result: ...
