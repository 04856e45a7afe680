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
    """A frame is kept as long as the camera stays near it: errors add up once a kept frame, not once a frame.

    The next one is a frame from half-way there, not the last: a parallax too small to tell a glass from what is seen
    through it never decides.
    """

    def __init__(self, most_m: float = 0.2, most_deg: float = 10.0) -> None:
        self.most_m, self.most_deg, self.kept, self.next = most_m, most_deg, None, None

    def renew(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
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
        R_view_camera = T_world_view[:3, :3].T @ T_world_camera[:3, :3]
        moved_m = np.linalg.norm(T_world_camera[:3, 3] - T_world_view[:3, 3])
        least_cosine = math.cos(math.radians(share * self.most_deg))
        return bool(moved_m < share * self.most_m and (np.trace(R_view_camera) - 1) / 2 > least_cosine)


#: What an odometer may ask for by its `reference`.
OWN = {"frame": PreviousFrame, "kept": KeptFrame}
