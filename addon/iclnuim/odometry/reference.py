"""What the next frame is aligned against: the frame before, or a keyframe. (A fused model: fusion/reference.py.)"""

import math
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..geometry.se3 import SE3
from .protocol import Frame, Result

#: What an odometer's prepare() made of a frame, or as it would of a rendered one, and T_world_camera of that frame.
View = tuple[Any, SE3]


class Reference(Protocol):
    """Both answer with the view that the next frame is aligned against: of this frame, or an earlier one."""

    def renew(self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None) -> View:
        """After a frame that was tracked; prepared: what prepare() made of it; result: of its align(), None for the first."""
        ...

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        """After losses, at a pose that was not measured."""
        ...


def rotated(T_world_one: SE3, T_world_other: SE3, min_deg: float) -> bool:
    """Whether the rotations of two poses lie `min_deg` degrees or more apart."""
    cosine = (np.trace(T_world_one.rotation.T @ T_world_other.rotation) - 1) / 2
    return bool(cosine <= math.cos(math.radians(min_deg)))


class PreviousFrame:
    """Frame to frame."""

    def renew(self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None) -> View:
        return self.restart(frame, prepared, T_world_camera)

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        return prepared, T_world_camera


class KeyframeReference:
    """A keyframe serves while the camera stays within max_m and max_deg of it: errors add up once a keyframe.

    The next keyframe is a frame from half-way there, not the last: a parallax too small to tell a glass from what is seen
    through it never decides.
    """

    def __init__(self, max_m: float = 0.2, max_deg: float = 10.0) -> None:
        self.max_m, self.max_deg = max_m, max_deg
        self.keyframe: View | None = None
        self.candidate: View | None = None

    def renew(self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None) -> View:
        if self.keyframe is None:
            return self.restart(frame, prepared, T_world_camera)
        current = prepared, T_world_camera
        if not self._near(self.keyframe, T_world_camera, 1.0):
            usable = self.candidate if self.candidate and self._near(self.candidate, T_world_camera, 1.0) else current
            self.keyframe, self.candidate = usable, None
        if self.candidate is None and not self._near(self.keyframe, T_world_camera, 0.5):
            self.candidate = current
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.keyframe, self.candidate = (prepared, T_world_camera), None
        return self.keyframe

    def _near(self, view: View, T_world_camera: SE3, share: float) -> bool:
        moved_m = np.linalg.norm(T_world_camera.translation - view[1].translation)
        return bool(moved_m < share * self.max_m) and not rotated(view[1], T_world_camera, share * self.max_deg)


class EntropyReference(KeyframeReference):
    """A keyframe serves while the entropy of the motion is min_ratio of its first or more: C. Kerl, J. Sturm, D. Cremers,
    "Dense visual SLAM for RGB-D cameras", IROS 2013, section IV-B. The next keyframe is the last frame before it was less.
    """

    def __init__(self, min_ratio: float = 0.91) -> None:
        super().__init__()
        self.min_ratio, self.first = min_ratio, math.nan

    def renew(self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None) -> View:
        entropy = _entropy(result)
        if self.keyframe is None or not math.isfinite(entropy):
            return self.restart(frame, prepared, T_world_camera)
        if math.isnan(self.first):
            self.first = entropy
        elif entropy / self.first < self.min_ratio:  # both are negative, of motions known to millimetres
            self.keyframe, self.first = self.candidate or self.keyframe, math.nan
        self.candidate = prepared, T_world_camera
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.first = math.nan
        return super().restart(frame, prepared, T_world_camera)


def _entropy(result: Result | None) -> float:
    """ln of the covariance's determinant; NaN where there is no information. Without the constants of a normal distribution."""
    if result is None or not result.residual > 0:
        return math.nan
    informed = math.isfinite(result.largest_sigma_m)
    values = np.linalg.eigvalsh(result.information if informed else result.information / result.residual**2)
    return -float(np.log(values).sum()) if values[0] > 0 else math.nan


#: What an odometer may ask for by its `reference`.
REFERENCES = {"frame": PreviousFrame, "keyframe": KeyframeReference, "entropy": EntropyReference}


def reference(name: str) -> Reference:
    """A new one by name. Raises InputError for an unknown name."""
    if name not in REFERENCES:
        raise InputError(f"a reference ({', '.join(REFERENCES)})", found=name)
    return REFERENCES[name]()
