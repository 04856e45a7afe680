"""A camera trajectory with time stamps: statistics, equation 2 of the paper, resampling, slices."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from ..errors import InputError, package_missing
from ..shown import Brief, plot_from_above
from . import so3
from .se3 import SE3, Poses

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..shown import Axes

FRAME_RATE_HZ = 30.0
#: Stamp of frame 0 (not 0, which means no stamp in ROS and RTAB-Map), and number of decimals of
#: written stamps.
FIRST_STAMP_S = 1.0
STAMP_DIGITS = 6
#: More than eleven hours at 240 Hz. A larger number of frames is due to a wrong stamp.
MAX_FRAMES = 10_000_000


def stamps_of_frames(numbers: npt.ArrayLike, rate_hz: float = FRAME_RATE_HZ) -> np.ndarray:
    """Stamps in seconds of frames numbered from 0: 1 + number / rate, to the microsecond.

    All generated stamps are computed here.
    """
    return np.round(FIRST_STAMP_S + np.asarray(numbers, float) / rate_hz, STAMP_DIGITS)


def frames_of_stamps(stamps_s: npt.ArrayLike, rate_hz: float = FRAME_RATE_HZ) -> np.ndarray:
    """Frame numbers of stamps, the inverse of stamps_of_frames(); fractions between frames. If a
    stamp is below 1 s, all are relative to 0 s.
    """
    stamps_s = np.asarray(stamps_s, float)
    start_s = FIRST_STAMP_S
    if stamps_s.min(initial=np.inf) < FIRST_STAMP_S - 10.0**-STAMP_DIGITS:
        start_s = 0.0
    return (stamps_s - start_s) * rate_hz


def frame_rate_hz(stamps_s: npt.ArrayLike) -> float:
    """Frame rate from the mean step without gaps; a whole number if that is correct to a
    microsecond, to which stamps are rounded. For fewer than two stamps, the benchmark's rate.
    """
    steps_s = np.diff(np.asarray(stamps_s, float))
    if not steps_s.size:
        return FRAME_RATE_HZ
    usual_s = np.median(steps_s)
    regular_s = steps_s[np.abs(steps_s - usual_s) < 0.5 * usual_s]
    step_s = float(regular_s.mean() if regular_s.size else usual_s)
    whole = round(1 / step_s)
    if whole and abs(1 / whole - step_s) < 1.01 * 10**-STAMP_DIGITS:
        return float(whole)
    return float(f"{1 / step_s:.5g}")


class StampedPose(NamedTuple):
    """One pose of a trajectory, and its stamp in seconds."""

    stamp_s: float
    T_world_camera: SE3


@dataclass(frozen=True, eq=False)
class Trajectory:
    """stamps_s (n,) in seconds, strictly increasing, and camera-to-world poses T_world_camera (n,)
    of the cv camera, which can be given as matrices (n, 4, 4). `trajectory[i]` and iteration give
    (stamp, pose), a slice or indices a part of the trajectory.
    """

    stamps_s: np.ndarray
    T_world_camera: SE3

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_s, float)
        object.__setattr__(self, "T_world_camera", SE3.of(self.T_world_camera))
        if stamps.ndim != 1 or self.T_world_camera.shape != stamps.shape:
            raise InputError(
                "as many poses as stamps", found=f"{self.T_world_camera.shape} and {stamps.shape}"
            )
        if not np.isfinite(stamps).all() or (np.diff(stamps) <= 0).any():
            raise InputError("finite, strictly increasing stamps")
        if (invalid := np.flatnonzero(~self.T_world_camera.is_rigid())).size:
            first = self.T_world_camera[invalid[0]]
            what = "NaN or infinity"
            if np.isfinite(first.translation).all():
                what = so3.what_no_rotation_is(first.rotation)
            found = f"pose {invalid[0]} without them: {what}"
            raise InputError("finite positions and rotation matrices", found=found)
        stamps.setflags(write=False)
        object.__setattr__(self, "stamps_s", stamps)

    @classmethod
    def at_rate(cls, T_world_camera: Poses, rate_hz: float = FRAME_RATE_HZ) -> "Trajectory":
        """Pose i, of poses (n,) or matrices (n, 4, 4), gets the stamp 1 + i / rate seconds.

        Raises InputError for a single pose without a leading axis.
        """
        T_world_camera = SE3.of(T_world_camera)
        if len(T_world_camera.shape) != 1:
            raise InputError("poses (n,)", found=f"poses {T_world_camera.shape}")
        return cls(stamps_of_frames(np.arange(len(T_world_camera)), rate_hz), T_world_camera)

    @classmethod
    def from_matrices(cls, matrices: Poses, stamps_s: np.ndarray | None = None) -> "Trajectory":
        """Camera-to-world matrices (n, 4, 4) at stamps (n,) in seconds, by default at 30 Hz. Raises
        InputError for other shapes, and for stamps that do not increase.
        """
        return cls.at_rate(matrices) if stamps_s is None else cls(stamps_s, SE3.of(matrices))

    @classmethod
    def of(cls, given: "Trajectory | Poses") -> "Trajectory":
        """A trajectory as it is, poses (n,) or matrices (n, 4, 4) at 30 Hz. Raises InputError for
        anything else.
        """
        if isinstance(given, Trajectory):
            return given
        if isinstance(given, str | os.PathLike):
            hint = "iclnuim.read_trajectory(file).trajectory"
            raise InputError("a Trajectory", found=type(given).__name__, hint=hint)
        return cls.at_rate(given)

    def __len__(self) -> int:
        return len(self.stamps_s)

    @overload
    def __getitem__(self, index: int | np.integer) -> StampedPose: ...

    @overload
    def __getitem__(self, index: slice | np.ndarray) -> "Trajectory": ...

    def __getitem__(
        self, index: int | np.integer | slice | np.ndarray
    ) -> "Trajectory | StampedPose":
        """(stamp, pose) of a number; part of the trajectory by slice or increasing indices."""
        if isinstance(index, int | np.integer):
            if not -len(self) <= index < len(self):
                raise IndexError(f"no pose {index}: the trajectory has {len(self)} poses")
            return StampedPose(float(self.stamps_s[index]), self.T_world_camera[index])
        return Trajectory(self.stamps_s[index], self.T_world_camera[index])

    def __iter__(self) -> Iterator[StampedPose]:
        """(stamp, pose), one after the other."""
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        if not len(self):
            return "Trajectory(0 poses)"
        first_s, last_s = self.stamps_s[[0, -1]]
        extent = f"{first_s:.3f}..{last_s:.3f} s, {self.length_m():.3f} m"
        return f"Trajectory({len(self)} poses, {extent})"

    @property
    def positions_m(self) -> np.ndarray:
        """Positions (n, 3)."""
        return self.T_world_camera.translation

    def step_lengths_m(self) -> np.ndarray:
        """Distances (n-1,) between neighbouring poses."""
        return np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1)

    def step_angles_rad(self) -> np.ndarray:
        """Angles (n-1,) of the rotations between neighbouring poses."""
        r = self.T_world_camera.rotation
        return so3.angle(np.swapaxes(r[:-1], -1, -2) @ r[1:])

    def length_m(self) -> float:
        """The length of the path in metres."""
        return float(self.step_lengths_m().sum())

    def to_pandas(self) -> "DataFrame":
        """A table indexed by stamp_s in seconds: x, y, z in metres, qx, qy, qz, qw. Raises
        ImportError without the package pandas.
        """
        try:
            from pandas import DataFrame, Index
        except ModuleNotFoundError as error:
            raise ImportError(package_missing("to_pandas()", error).worded()) from None

        rows = np.hstack([self.positions_m, self.T_world_camera.quat_xyzw])
        columns = ["x", "y", "z", "qx", "qy", "qz", "qw"]
        return DataFrame(rows, Index(self.stamps_s, name="stamp_s"), columns)

    def plot(self, axes: "Axes | None" = None, label: str = "camera") -> "Axes":
        """Draw the positions along the two axes of their largest extents; returns the Matplotlib
        axes.
        """
        return plot_from_above(axes, self.positions_m, label)


@dataclass(frozen=True, repr=False)
class TrajectoryStatistics(Brief):
    """The values of the paper's Table I, and more.

    Speeds in m/s, rotation rates in degrees/s; a gap is a step of more than 1.5 median steps.
    """

    frames: int
    length_m: float = 0
    duration_s: float = 0
    rate_hz: float = 0
    mean_speed: float = 0
    max_speed: float = 0
    mean_rotation_rate: float = 0
    max_rotation_rate: float = 0
    gaps: int = 0
    longest_gap_s: float = 0


def trajectory_statistics(trajectory: "Trajectory | Poses") -> TrajectoryStatistics:
    """Statistics of one trajectory, or of poses or matrices (n, 4, 4) at 30 Hz; the rates of a
    single pose are zero.
    """
    trajectory = Trajectory.of(trajectory)
    steps_s = np.diff(trajectory.stamps_s)
    if len(steps_s) == 0:
        return TrajectoryStatistics(len(trajectory))
    usual_s = float(np.median(steps_s))
    lengths_m = trajectory.step_lengths_m()
    angles_deg = np.degrees(trajectory.step_angles_rad())
    length_m = trajectory.length_m()
    duration_s = float(steps_s.sum())
    return TrajectoryStatistics(
        frames=len(trajectory),
        length_m=length_m,
        duration_s=duration_s,
        rate_hz=frame_rate_hz(trajectory.stamps_s),
        mean_speed=length_m / duration_s,
        max_speed=float((lengths_m / steps_s).max()),
        mean_rotation_rate=float(angles_deg.sum() / duration_s),
        max_rotation_rate=float((angles_deg / steps_s).max()),
        gaps=int((steps_s > 1.5 * usual_s).sum()),
        longest_gap_s=float(steps_s.max()),
    )


def adopt(source: Trajectory, T_world_start: SE3, scale: float = 1.0) -> Trajectory:
    """Equation 2: T_pov_cam = T_pov_kintinuous . T_kintinuous_cam, after uniform scaling of the
    source.

    T_pov_kintinuous maps the source's first pose to `T_world_start`, the first pose in the scene.
    """
    if not np.isfinite(scale) or scale <= 0:
        raise InputError("a scale > 0", found=scale)
    if len(source) == 0:
        raise InputError("a source of at least one pose", found="none")
    scaled = SE3(source.T_world_camera.rotation, source.positions_m * scale)
    return Trajectory(source.stamps_s, T_world_start @ scaled[0].inverse() @ scaled)


def sample(trajectory: Trajectory, stamps_s: np.ndarray) -> SE3:
    """Poses at any stamps within the trajectory's time span, by screw motions between neighbours
    (SE(3) interpolation).
    """
    stamps_s = np.asarray(stamps_s, float)
    given_s = trajectory.stamps_s
    if len(given_s) < 2:
        raise InputError("at least two poses to interpolate between", found=len(given_s))
    slack = 1e-9 * max(1.0, abs(given_s[-1]))
    outside = (stamps_s < given_s[0] - slack) | (stamps_s > given_s[-1] + slack)
    if outside.any():
        found = f"{stamps_s.min():.6f}..{stamps_s.max():.6f} s"
        raise InputError(f"stamps within {given_s[0]:.6f}..{given_s[-1]:.6f} s", found=found)
    before = np.clip(np.searchsorted(given_s, stamps_s, side="right") - 1, 0, len(given_s) - 2)
    steps_s = given_s[before + 1] - given_s[before]
    share = np.clip((stamps_s - given_s[before]) / steps_s, 0.0, 1.0)
    poses = trajectory.T_world_camera
    return poses[before].interpolate(poses[before + 1], share)


def resample(trajectory: "Trajectory | Poses", rate_hz: float) -> Trajectory:
    """The same motion at another frame rate, 15 to 240 Hz; starts at the first stamp and stays
    within the time span. Poses or matrices (n, 4, 4) are at 30 Hz.
    """
    trajectory = Trajectory.of(trajectory)
    if not 15.0 <= rate_hz <= 240.0:
        raise InputError("a rate of 15 to 240 Hz", found=rate_hz)
    if len(trajectory) < 2:
        raise InputError("at least two poses to interpolate between", found=len(trajectory))
    start, end = trajectory.stamps_s[[0, -1]]
    frames = (end - start) * rate_hz
    if frames > MAX_FRAMES:
        found = f"{end - start:.6g} s at {rate_hz:g} Hz"
        raise InputError(f"at most {MAX_FRAMES} frames", found=found, hint="repairing the stamps")
    slack = max(1e-6, rate_hz * 10.0**-STAMP_DIGITS)  # of two rounded stamps
    numbers = np.arange(int(np.floor(frames + slack)) + 1)
    stamps_s = start + np.round(numbers / rate_hz, STAMP_DIGITS)
    # printed stamps are rounded, so the last frame can be slightly after the last pose
    return Trajectory(stamps_s, sample(trajectory, np.minimum(stamps_s, end)))


def frame_slice(text: str, count: int) -> range:
    """Frame numbers of `A:B:S`, a Python slice of `count` frames (B excluded, all parts optional),
    or of a single number.
    """
    parts = text.strip().split(":")
    numbers: list[int | None] = []
    try:
        if len(parts) == 1:
            first = int(parts[0])
            numbers = [first, first + 1 or None]
        else:
            for part in parts:
                numbers.append(int(part) if part.strip() else None)
        picked = range(count)[slice(*numbers)]
    except (ValueError, TypeError):  # not a number, a step of 0, or more than three parts
        raise InputError("frames as A:B:S (a Python slice) or one number", found=text) from None
    if picked.step < 0:
        picked = picked[::-1]
    if len(picked) == 0:
        raise InputError(f"at least one of the frames 0..{count - 1}", found=text)
    return picked
