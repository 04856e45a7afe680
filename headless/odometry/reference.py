"""What the next frame is aligned against: the frame before, or what a model shows from there."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from .protocol import Frame


class Reference(Protocol):
    """Both answer with a view, as the odometer's prepare() makes it of a frame, and the pose (4, 4) that it is seen
    from: `T_world_camera`, or an earlier one where a view is kept.
    """

    def renew(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        """After a frame that was tracked; prepared is what prepare() made of it."""
        ...

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        """After losses, at a pose that nobody measured."""
        ...


class PreviousFrame:
    """Frame to frame."""

    def renew(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        return prepared, T_world_camera

    restart = renew


class KeptFrame:
    """A frame is kept as long as the camera stays near it: errors add up once a kept frame, not once a frame."""

    def __init__(self, most_m: float = 0.1, most_deg: float = 5.0) -> None:
        self.most_m, self.least_cosine, self.kept = most_m, math.cos(math.radians(most_deg)), None

    def renew(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        if self.kept is None or not self._near(self.kept[1], T_world_camera):
            self.kept = prepared, T_world_camera
        return self.kept

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        self.kept = prepared, T_world_camera
        return self.kept

    def _near(self, T_world_kept: np.ndarray, T_world_camera: np.ndarray) -> bool:
        R_kept_camera = T_world_kept[:3, :3].T @ T_world_camera[:3, :3]
        moved_m = np.linalg.norm(T_world_camera[:3, 3] - T_world_kept[:3, 3])
        return bool(moved_m < self.most_m and (np.trace(R_kept_camera) - 1) / 2 > self.least_cosine)


#: What an odometer may ask for by its `reference`.
OWN = {"frame": PreviousFrame, "kept": KeptFrame}
