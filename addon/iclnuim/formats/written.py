"""What a writer of trajectories is told, and what it checks before anything is written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .table import LARGEST_POSITION_M, LARGEST_STAMP_S

#: A stamp may be off its frame's time by this share of a frame.
STAMP_SLACK = 0.01


@dataclass(frozen=True)
class WriteOptions:
    """Frames per second where frames are numbered, the unit of length in metres, where the anchored formats start."""

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0
    start_z_m: float = -2.25

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))
        if not abs(self.start_z_m) <= 1e3:
            raise InputError("start_z_m of at most 1000 m", found=self.start_z_m)


def check_writable(trajectory: Trajectory) -> None:
    """Raises InputError for what no reader would take: no poses, numbers that are not finite or absurd."""
    if len(trajectory) == 0:
        raise InputError("at least one pose to write", found="none")
    positions_m, stamps_s = trajectory.positions_m, trajectory.stamps_s
    if not (np.isfinite(positions_m).all() and np.isfinite(trajectory.T_world_camera.rotation).all()):
        raise InputError("finite poses to write", found="NaN or infinity")
    if np.abs(positions_m).max() > LARGEST_POSITION_M:
        raise InputError(
            f"positions of at most {LARGEST_POSITION_M:g} m to write", found=f"{np.abs(positions_m).max():g} m"
        )
    if np.abs(stamps_s).max() > LARGEST_STAMP_S or (np.diff(np.rint(stamps_s * 1e9)) <= 0).any():
        raise InputError(f"stamps of at most {LARGEST_STAMP_S:g} s, a nanosecond or more apart, to write")


def frame_numbers(trajectory: Trajectory, rate_hz: float) -> np.ndarray:
    """(n,) integers: stamp * rate. Raises InputError where a stamp lies between two frames or before frame 0."""
    frames = trajectory.stamps_s * rate_hz
    numbers = np.rint(frames)
    bad = np.flatnonzero(
        ~(np.abs(frames - numbers) <= STAMP_SLACK) | (numbers < 0) | (np.diff(numbers, prepend=-1.0) <= 0)
    )
    if bad.size:
        found = f"{trajectory.stamps_s[bad[0]]:.15g} s"
        raise InputError(
            f"stamps at frame numbers / {rate_hz:g} s, from 0 on, to write frame numbers", found=found, hint="--restamp"
        )
    return numbers.astype(np.int64)
