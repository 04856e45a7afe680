"""A shutter that is open for a while and reads its rows one after another: which instants make up each band of rows.

Motion blur is the mean light over the exposure; a rolling shutter gives each row its own instant. Both are centred on the
frame's stamp, whose pose stays the ground truth. The paper counts their absence among its limitations (section V).
"""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..settings import Settings, setting

#: Between two instants of an exposure nothing moves farther than this, so that the mean shows no steps.
STEP_PX = 1.0
#: Rows of one band share their instant; no point of theirs is farther than this from its own.
ROW_ERROR_PX = 0.1
_GRID_PX = 4
_duration = partial(setting, unit="s", low=0.0, high=1.0, source="0 in the paper, section V", shown=("ms", 1000.0))


@dataclass(frozen=True)
class Exposure(Settings):
    """How long each row collects light, and how long it takes to read all rows, one by one. 0: none."""

    group: ClassVar[str] = "exposure"

    exposure_s: float = _duration(
        0.0,
        "how long the shutter is open: motion blur of RGB; depth stays sharp",
        option="--exposure",
        label="Exposure",
    )
    readout_s: float = _duration(
        0.0, "from the first row's exposure to the last row's: rolling shutter", option="--readout", label="Readout"
    )

    @property
    def instant(self) -> bool:
        """Whether the shutter takes no time."""
        return self.exposure_s == 0 and self.readout_s == 0


@dataclass(frozen=True)
class Band:
    """Rows top..bottom (bottom excluded) and the instants, seconds from the frame's stamp, whose mean light they show."""

    top: int
    bottom: int
    offsets_s: tuple[float, ...]


def plan(exposure: Exposure, height: int, exposure_motion_px: float, readout_motion_px: float) -> list[Band]:
    """Bands of rows from top to bottom. Motions: the farthest that any point moves during exposure and readout, in pixels.

    A row's instant is that of its middle: ((row + 1/2) / height - 1/2) readout_s from the stamp.
    """
    count = int(np.clip(np.ceil(readout_motion_px / (2 * ROW_ERROR_PX)), 1, height)) if exposure.readout_s else 1
    instants = max(1, int(np.ceil(exposure_motion_px / STEP_PX))) if exposure.exposure_s else 1
    within = ((np.arange(instants) + 0.5) / instants - 0.5) * exposure.exposure_s
    edges = np.rint(np.linspace(0, height, count + 1)).astype(int)
    middles = (edges[:-1] + edges[1:]) / 2 / height - 0.5
    return [
        Band(int(top), int(bottom), tuple(float(t) for t in middle * exposure.readout_s + within))
        for top, bottom, middle in zip(edges[:-1], edges[1:], middles, strict=True)
    ]


def motion_px(depth_z_m: np.ndarray, camera: PinholeCamera, T_here_camera: SE3, stamps_s: np.ndarray) -> float:
    """How far a point moves over the image from the first to the last of poses (n,), at the fastest any moves between two.

    Points are every 4th pixel of the frame taken at T_here_camera = identity, planar depth (h, w) in metres; where it is
    0, at infinity. A point counts while it is inside the image.
    """
    depth = depth_z_m[::_GRID_PX, ::_GRID_PX]
    points = (camera.rays()[::_GRID_PX, ::_GRID_PX] * np.where(depth > 0, depth, 1e6)[..., None]).reshape(-1, 3)
    pixels = np.stack([camera.project(T_here_camera[i].inverse().apply(points)) for i in range(len(stamps_s))])
    seen = ((pixels >= -0.5) & (pixels < (camera.width - 0.5, camera.height - 0.5))).all(-1)
    moved_px = np.linalg.norm(np.diff(pixels, axis=0), axis=-1)
    fastest_px = np.where(seen[1:] & seen[:-1], moved_px, 0.0).max(1)
    return float((fastest_px / np.diff(stamps_s)).max(initial=0.0) * (stamps_s[-1] - stamps_s[0]))
