"""What a page shows: sequences with their images, trajectories, surfaces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...geometry.camera import PinholeCamera
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory

#: rgb (h, w, 3) uint8 sRGB and planar depth (h, w) in metres of a frame.
LoadImages = Callable[[], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class ViewedFrame:
    """A frame; its images are read when the page is written."""

    number: int
    stamp_s: float
    T_world_camera: SE3 | None
    load: LoadImages


@dataclass(frozen=True, eq=False)
class ViewedSequence:
    """Frames of one camera. units_per_metre: depth is stored in whole units."""

    name: str
    camera: PinholeCamera
    units_per_metre: float
    frames: Sequence[ViewedFrame]


@dataclass(frozen=True, eq=False)
class ViewedTrajectory:
    """A trajectory in the world of the page. errors_m (n,): distance of each position to the true
    one, NaN for a pose that has none; rmse_mm: their ATE.
    """

    name: str
    trajectory: Trajectory
    is_truth: bool = False
    has_rotations: bool = True
    errors_m: np.ndarray | None = None
    rmse_mm: float | None = None

    @property
    def label(self) -> str:
        """The name, with the ATE."""
        return self.name if self.rmse_mm is None else f"{self.name}, ATE {self.rmse_mm:.3g} mm"


@dataclass(frozen=True, eq=False)
class ViewedSurface:
    """points (n, 3) in metres, triangles (m, 3), none for a point cloud; colours (n, 3) uint8, or
    distances_m (n,) to the true surface, of which max_mm and more are red.
    """

    name: str
    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray | None = None
    distances_m: np.ndarray | None = None
    max_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class ViewContents:
    """All that one page shows. notes: sentences below its title."""

    title: str
    sequences: Sequence[ViewedSequence] = ()
    trajectories: Sequence[ViewedTrajectory] = ()
    surfaces: Sequence[ViewedSurface] = ()
    notes: Sequence[str] = field(default=())
