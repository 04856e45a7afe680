"""Motion blur and rolling shutter: the instants of time that are rendered for each band of rows.

Motion blur is the mean light over the exposure. With a rolling shutter, each row has a different
time. Both are centred on the frame's stamp, whose pose is the ground truth. The paper lists the
absence of both among its limitations (section V).
"""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..settings import Settings, setting

#: Maximum motion between two instants of an exposure, so that no steps are visible in the mean.
STEP_PX = 1.0
#: All rows of a band are rendered at the same instant. Maximum error of a point's position caused
#: by this.
ROW_ERROR_PX = 0.1
_duration = partial(
    setting, unit="s", low=0.0, high=1.0, source="0 in the paper, section V", shown=("ms", 1000.0)
)


@dataclass(frozen=True)
class Exposure(Settings):
    """Exposure time of each row, and time to read all rows one after the other.

    0: no blur, no rolling shutter.
    """

    group: ClassVar[str] = "exposure"

    exposure_s: float = _duration(
        0.0,
        "time that the shutter is open: motion blur of RGB; depth has no blur",
        option="--exposure",
        label="Exposure",
    )
    readout_s: float = _duration(
        0.0,
        "time from the first row's exposure to the last row's: rolling shutter",
        option="--readout",
        label="Readout",
    )

    @property
    def instant(self) -> bool:
        """Whether exposure and readout time are both 0."""
        return self.exposure_s == 0 and self.readout_s == 0


@dataclass(frozen=True)
class Band:
    """Rows top..bottom (bottom excluded).

    Their image is the mean light at the instants offsets_s, in seconds from the frame's stamp.
    """

    top: int
    bottom: int
    offsets_s: tuple[float, ...]


def plan(
    exposure: Exposure, height: int, exposure_motion_px: float, readout_motion_px: float
) -> list[Band]:
    """Bands of rows from top to bottom. The motions are the largest motion of any point during
    exposure and readout, in pixels.

    The time of a row is that of its middle: ((row + 1/2) / height - 1/2) readout_s from the stamp.
    """
    count = 1
    instants = 1
    if exposure.readout_s:
        count = int(np.clip(np.ceil(readout_motion_px / (2 * ROW_ERROR_PX)), 1, height))
    if exposure.exposure_s:
        instants = max(1, int(np.ceil(exposure_motion_px / STEP_PX)))
    within = ((np.arange(instants) + 0.5) / instants - 0.5) * exposure.exposure_s
    edges = np.rint(np.linspace(0, height, count + 1)).astype(int)
    middles = (edges[:-1] + edges[1:]) / 2 / height - 0.5
    bands = []
    for top, bottom, middle in zip(edges[:-1], edges[1:], middles, strict=True):
        offsets_s = middle * exposure.readout_s + within
        bands.append(Band(int(top), int(bottom), tuple(offsets_s.tolist())))
    return bands


def motion_px(
    depth_z_m: np.ndarray, camera: PinholeCamera, T_here_camera: SE3, stamps_s: np.ndarray
) -> float:
    """Upper estimate of the motion of a point in the image from the first to the last of the poses
    (n,): the largest speed between two poses.

    Points are every 4th pixel of the frame at T_here_camera = identity, with planar depth (h, w) in
    metres; where depth is 0, the point is at infinity. A point is used while it is inside the
    image.
    """
    grid = np.s_[::4, ::4]
    depth = depth_z_m[grid]
    points = (camera.rays()[grid] * np.where(depth > 0, depth, 1e6)[..., None]).reshape(-1, 3)
    pixels = np.stack(
        [camera.project(T_here_camera[i].inverse().apply(points)) for i in range(len(stamps_s))]
    )
    seen = ((pixels >= -0.5) & (pixels < (camera.width - 0.5, camera.height - 0.5))).all(-1)
    moved_px = np.linalg.norm(np.diff(pixels, axis=0), axis=-1)
    fastest_px = np.where(seen[1:] & seen[:-1], moved_px, 0.0).max(1)
    return float((fastest_px / np.diff(stamps_s)).max(initial=0.0) * (stamps_s[-1] - stamps_s[0]))
