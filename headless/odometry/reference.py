"""What the next frame is aligned against: the frame before, or what a model shows from there."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from .protocol import Frame


class Reference(Protocol):
    """Both answer with a view, as the odometer's prepare() makes it of a frame, and the pose (4, 4) that it is seen from:
    `T_world_camera`, or an earlier one where a view is kept.
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
