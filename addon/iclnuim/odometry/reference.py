"""What the next frame is aligned against: the frame before, or what a model shows from there."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from .protocol import Frame, Result


class Reference(Protocol):
    """Both answer with a view, as the odometer's prepare() makes it of a frame, and the pose (4, 4) that it is seen
    from: `T_world_camera`, or an earlier one where a view is kept.
    """

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: np.ndarray, result: Result | None = None
    ) -> tuple[Any, np.ndarray]:
        """After a frame that was tracked; prepared is what prepare() made of it, result what align() said of it."""
        ...

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        """After losses, at a pose that nobody measured."""
        ...


def turned(T_world_one: np.ndarray, T_world_other: np.ndarray, deg: float) -> bool:
    """Whether the rotations of two poses (4, 4) lie `deg` degrees or more apart."""
    cosine = (np.trace(T_world_one[:3, :3].T @ T_world_other[:3, :3]) - 1) / 2
    return bool(cosine <= math.cos(math.radians(deg)))


class PreviousFrame:
    """Frame to frame."""

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: np.ndarray, result: Result | None = None
    ) -> tuple[Any, np.ndarray]:
        return prepared, T_world_camera

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        return prepared, T_world_camera


class KeptFrame:
    """A frame is kept as long as the camera stays near it: errors add up once a kept frame, not once a frame.

    The next one is a frame from half-way there, not the last: a parallax too small to tell a glass from what is seen
    through it never decides.
    """

    def __init__(self, most_m: float = 0.2, most_deg: float = 10.0) -> None:
        self.most_m, self.most_deg, self.kept, self.next = most_m, most_deg, None, None

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: np.ndarray, result: Result | None = None
    ) -> tuple[Any, np.ndarray]:
        current = prepared, T_world_camera
        if self.kept is None:
            self.kept = current
        if not self._near(self.kept, T_world_camera, 1.0):
            near = self.next is not None and self._near(self.next, T_world_camera, 1.0)
            self.kept, self.next = self.next if near else current, None
        if self.next is None and not self._near(self.kept, T_world_camera, 0.5):
            self.next = current
        return self.kept

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        self.kept, self.next = (prepared, T_world_camera), None
        return self.kept

    def _near(self, view: tuple[Any, np.ndarray], T_world_camera: np.ndarray, share: float) -> bool:
        T_world_view = view[1]
        moved_m = np.linalg.norm(T_world_camera[:3, 3] - T_world_view[:3, 3])
        return bool(moved_m < share * self.most_m) and not turned(T_world_view, T_world_camera, share * self.most_deg)


class EntropyFrame:
    """A frame is kept while it fixes the motion as it did at first: C. Kerl, J. Sturm, D. Cremers, "Dense visual SLAM
    for RGB-D cameras", IROS 2013, section IV-B. The next one is the last frame that still was sure.
    """

    def __init__(self, least_ratio: float = 0.91) -> None:
        self.least_ratio, self.kept, self.last, self.first = least_ratio, None, None, math.nan

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: np.ndarray, result: Result | None = None
    ) -> tuple[Any, np.ndarray]:
        current, entropy = (prepared, T_world_camera), _entropy(result)
        if self.kept is None or not math.isfinite(entropy):
            return self.restart(frame, prepared, T_world_camera)
        if math.isnan(self.first):
            self.first = entropy
        elif entropy / self.first < self.least_ratio:  # both are negative, of motions known to millimetres
            self.kept, self.first = self.last, math.nan
        self.last = current
        return self.kept

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        self.kept = self.last = prepared, T_world_camera
        self.first = math.nan
        return self.kept


def _entropy(result: Result | None) -> float:
    """ln of the covariance's determinant; NaN where there is no information. Without the constants of a normal distribution."""
    if result is None or not result.residual > 0:
        return math.nan
    informed = math.isfinite(result.weakest_sigma_m)
    values = np.linalg.eigvalsh(result.information if informed else result.information / result.residual**2)
    return -float(np.log(values).sum()) if values[0] > 0 else math.nan


#: What an odometer may ask for by its `reference`.
OWN = {"frame": PreviousFrame, "kept": KeptFrame, "entropy": EntropyFrame}
