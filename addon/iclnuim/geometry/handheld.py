"""Hand-held camera motion from a recipe: viewpoints, pace, shake and a seed -> a trajectory of
given frames and length.

The camera follows a smooth curve through the viewpoints, looks at their targets, slows down and
rests, and shakes. The shake is the sum of bands of random motion whose power decreases with
frequency: sway of the body (some 0.25..1 Hz) and tremor of the hands (some 1..12 Hz; physiological
tremor has up to about 12 Hz). For camera shake modelled on tremor see F. Gavant, L. Alacoque, A.
Dupret, D. David, "A physiological camera shake model for image stabilization systems", IEEE Sensors
2011. Amplitudes and slopes follow measurements of the official living-room kt0 and kt2: in 1..12 Hz
some 3 to 5 mm and 0.3 to 0.45 degrees RMS over the three axes together, with power proportional to
f^-2.3 in position and f^-3 in rotation.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..errors import InputError
from ..settings import MISSING, Settings, parameter
from . import so3
from .handheld_parts import BandNoise, EasedProgress, NaturalSpline
from .se3 import SE3
from .trajectory import FRAME_RATE_HZ, Trajectory

#: Limits of the factor by which the viewpoints are scaled about their mean to get the length;
#: outside them the recipe is invalid.
SCALE_LIMITS = (0.85, 1.15)
#: Maximum rotation between two viewpoints; a larger one has an ambiguous direction.
MAX_YAW_STEP_DEG = 150.0
SCHEMA_VERSION = 1

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Viewpoint(Settings):
    """A position of the camera, its target (both in the world), the duration of its rest there, and
    its roll.
    """

    group: ClassVar[str] = "a viewpoint"

    position_m: Point = parameter(
        MISSING, "position of the camera, world", unit="m", low=-1e4, high=1e4
    )
    look_at_m: Point = parameter(
        MISSING, "target that the camera looks at, world", unit="m", low=-1e4, high=1e4
    )
    dwell_s: float = parameter(0.0, "rest at the viewpoint", unit="s", low=0.0, high=1e9)
    roll_deg: float = parameter(
        0.0, "clockwise roll of the camera", unit="degrees", low=-180.0, high=180.0
    )
    hurry: float = parameter(
        1.0, "speed factor of the motion to this viewpoint; 2: twice as fast", low=0.1, high=10.0
    )


@dataclass(frozen=True)
class Pace(Settings):
    """Normal speeds of motion and rotation, whose ratio determines the share of time of each
    segment; and the duration of a start or stop.
    """

    group: ClassVar[str] = "a pace"

    speed_m_s: float = parameter(MISSING, "normal speed of motion", unit="m/s", low=1e-3, high=1e3)
    turn_deg_s: float = parameter(
        MISSING, "normal rate of rotation", unit="degrees/s", low=1e-3, high=1e5
    )
    ease_s: float = parameter(MISSING, "duration of a start or stop", unit="s", low=1e-3, high=1e9)


@dataclass(frozen=True)
class Shake(Settings):
    """One band of random motion: RMS over the three axes together; power is proportional to
    frequency^-slope.
    """

    group: ClassVar[str] = "a shake"

    low_hz: float = parameter(MISSING, "begin of the band, above 0", unit="Hz")
    high_hz: float = parameter(MISSING, "end of the band, below 15", unit="Hz")
    position_mm: float = parameter(MISSING, "RMS of the position", unit="mm", low=0.0, high=1000.0)
    rotation_deg: float = parameter(
        MISSING, "RMS of the rotation", unit="degrees", low=0.0, high=45.0
    )
    position_slope: float = parameter(
        MISSING, "slope of the position's power", low=-10.0, high=10.0
    )
    rotation_slope: float = parameter(
        MISSING, "slope of the rotation's power", low=-10.0, high=10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.low_hz < self.high_hz < 15:
            raise InputError(
                "a band within 0..15 Hz", found=f"{self.low_hz:g}..{self.high_hz:g} Hz"
            )


@dataclass(frozen=True, kw_only=True)
class Recipe(Settings):
    """A complete trajectory at 30 Hz (trajectories/README.md): its frames, its length including
    shake, and the parameters of its motion.
    """

    group: ClassVar[str] = "a recipe"

    scene: str = parameter(MISSING, "scene of the trajectory")
    about: str = parameter(MISSING, "a description")
    frames: int = parameter(MISSING, "poses at 30 Hz", low=2, high=1_000_000)
    length_m: float = parameter(MISSING, "length including shake", unit="m", low=1e-9, high=1e9)
    seed: int = parameter(MISSING, "seed of the shake", low=0, high=2**63 - 1)
    pace: Pace
    shakes: tuple[Shake, ...]
    viewpoints: tuple[Viewpoint, ...]
    schema_version: int = SCHEMA_VERSION

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.schema_version != SCHEMA_VERSION:
            raise InputError(f"schema_version {SCHEMA_VERSION}", found=self.schema_version)
        if len(self.viewpoints) < 2:
            raise InputError("two viewpoints or more", found=len(self.viewpoints))


@dataclass(frozen=True)
class Motion:
    """The generated trajectory, and the factor that scaled the viewpoints for the length."""

    trajectory: Trajectory
    scale: float


def make(recipe: Recipe) -> Motion:
    """The recipe's motion: world z up, poses T_world_camera of the cv camera, stamps 1 + i / 30 s.

    The length, including shake, equals the recipe's to 0.1 mm. Raises InputError if no scale within
    SCALE_LIMITS gives it.
    """
    parts = Parts.of(recipe)
    smooth, shake_m, shake_rad = parts.of_frames()
    scale = _scale_for_length(smooth[:, :3] - parts.centre_m, shake_m, recipe.length_m)
    positions = parts.centre_m + scale * (smooth[:, :3] - parts.centre_m) + shake_m
    rotations = rotation_world_camera(*smooth[:, 3:].T) @ so3.exp(shake_rad)
    return Motion(Trajectory.at_rate(SE3(rotations, positions)), scale)


def natural_length_m(recipe: Recipe) -> float:
    """The length including shake if the viewpoints are not scaled; the length in the recipe is not
    used.
    """
    smooth, shake_m, _ = Parts.of(recipe).of_frames()
    return float(np.linalg.norm(np.diff(smooth[:, :3] + shake_m, axis=0), axis=1).sum())


def unhurried_s(recipe: Recipe) -> float:
    """Duration in seconds at the recipe's pace, including rests and the last stop; the number of
    frames in the recipe is not used.
    """
    return float(
        _knots(recipe)[0][-1] + sum(v.dwell_s for v in recipe.viewpoints) + recipe.pace.ease_s
    )


@dataclass(frozen=True, eq=False)
class Parts:
    """What a recipe's motion is made of. `smooth`: position in metres, yaw (unwrapped), pitch,
    roll, along `progress`; `shakes`: bands of position and rotation with their RMS per axis in
    metres and radians; `centre_m` (3,): the mean of the viewpoints, about which they are scaled.
    """

    frames: int
    centre_m: np.ndarray
    smooth: NaturalSpline
    progress: EasedProgress
    shakes: tuple[tuple[BandNoise, float, BandNoise, float], ...]

    @classmethod
    def of(cls, recipe: Recipe) -> "Parts":
        rng = np.random.default_rng(recipe.seed)
        knots, values = _knots(recipe)
        dwells_s = np.array([v.dwell_s for v in recipe.viewpoints])
        times_s = np.arange(recipe.frames) / FRAME_RATE_HZ
        progress = EasedProgress(np.diff(knots), dwells_s, recipe.pace.ease_s, times_s[-1])
        shakes = []
        for s in recipe.shakes:  # amplitudes are RMS over the three axes together
            of = recipe.frames, FRAME_RATE_HZ, (s.low_hz, s.high_hz)
            position = BandNoise.drawn(*of, s.position_slope, 3, rng)
            rotation = BandNoise.drawn(*of, s.rotation_slope, 3, rng)
            rms_m = s.position_mm / 1000.0 / np.sqrt(3.0)
            rms_rad = np.radians(s.rotation_deg) / np.sqrt(3.0)
            shakes.append((position, rms_m, rotation, rms_rad))
        centre_m = np.array([v.position_m for v in recipe.viewpoints]).mean(axis=0)
        smooth = NaturalSpline(knots, values)
        return cls(recipe.frames, centre_m, smooth, progress, tuple(shakes))

    def of_frames(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The smooth motion (n, 6) at the frames, and the shake: (n, 3) metres in the world, (n, 3)
        radians about the camera's axes.
        """
        shake_m = np.zeros((self.frames, 3))
        shake_rad = np.zeros((self.frames, 3))
        for position, rms_m, rotation, rms_rad in self.shakes:
            shake_m += position.of_frames() * rms_m
            shake_rad += rotation.of_frames() * rms_rad
        times_s = np.arange(self.frames) / FRAME_RATE_HZ
        return self.smooth.at(self.progress.at(times_s)), shake_m, shake_rad

    def jets(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `of_frames`, at any times (m,) after frame 0, with first and second derivatives by
        time: (3, m, 6), (3, m, 3) and (3, m, 3).
        """
        shake_m = np.zeros((3, len(times_s), 3))
        shake_rad = np.zeros((3, len(times_s), 3))
        for position, rms_m, rotation, rms_rad in self.shakes:
            shake_m += position.jet(times_s) * rms_m
            shake_rad += rotation.jet(times_s) * rms_rad
        along, rate, change = self.progress.jet(times_s)[..., None]
        value, slope, curvature = self.smooth.jet(along[:, 0])
        smooth = np.stack([value, slope * rate, curvature * rate * rate + slope * change])
        return smooth, shake_m, shake_rad


def _knots(recipe: Recipe) -> tuple[np.ndarray, np.ndarray]:
    """Knots (n,) in seconds at the normal pace; values (n, 6): position in metres, yaw (unwrapped),
    pitch, roll.
    """
    positions = np.array([v.position_m for v in recipe.viewpoints])
    gazes = np.array([v.look_at_m for v in recipe.viewpoints]) - positions
    across = np.hypot(gazes[:, 0], gazes[:, 1])
    if across.min() < 0.05:
        raise InputError(
            "look_at_m not directly above or below position_m", found=f"viewpoint {across.argmin()}"
        )
    pitches = np.arctan2(gazes[:, 2], across)
    yaw_steps = np.diff(np.arctan2(gazes[:, 1], gazes[:, 0]), prepend=0.0)
    yaw_steps[1:] -= 2 * np.pi * np.round(yaw_steps[1:] / (2 * np.pi))
    widest = 1 + np.abs(yaw_steps[1:]).argmax()
    if abs(yaw_steps[widest]) > np.radians(MAX_YAW_STEP_DEG):
        hint = "a viewpoint between, to define the direction of rotation"
        found = f"{np.degrees(yaw_steps[widest]):.0f} degrees before viewpoint {widest}"
        expected = f"rotations of at most {MAX_YAW_STEP_DEG:g} degrees between viewpoints"
        raise InputError(expected, found=found, hint=hint)
    rolls = np.radians([v.roll_deg for v in recipe.viewpoints])
    motion_s = np.linalg.norm(np.diff(positions, axis=0), axis=1) / recipe.pace.speed_m_s
    rotation_s = np.degrees(np.hypot(yaw_steps[1:], np.diff(pitches))) / recipe.pace.turn_deg_s
    hurries = np.array([v.hurry for v in recipe.viewpoints[1:]])
    segments_s = np.maximum(np.hypot(motion_s, rotation_s), 0.1) / hurries
    values = np.column_stack([positions, np.cumsum(yaw_steps), pitches, rolls])
    return np.concatenate([[0.0], np.cumsum(segments_s)]), values


def _scale_for_length(smooth_m: np.ndarray, shake_m: np.ndarray, length_m: float) -> float:
    """The factor on `smooth_m` for which the trajectory has the length `length_m`, by bisection;
    rounded to 1e-6.
    """

    def length(scale: float) -> float:
        return float(np.linalg.norm(np.diff(scale * smooth_m + shake_m, axis=0), axis=1).sum())

    low, high = SCALE_LIMITS
    if not length(low) <= length_m <= length(high):
        found = f"{length(low):.3f}..{length(high):.3f} m at scales {low}..{high}"
        expected = f"viewpoints on a trajectory of about {length_m:g} m"
        raise InputError(expected, found=found, hint="moving them")
    for _ in range(40):
        middle = (low + high) / 2
        if length(middle) < length_m:
            low = middle
        else:
            high = middle
    return round(low, 6)


def rotation_world_camera(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) from yaw (from world x towards y), pitch (upwards) and clockwise roll
    about the viewing direction, in radians.
    """
    sy = np.sin(yaw)
    cy = np.cos(yaw)
    sp = np.sin(pitch)
    cp = np.cos(pitch)
    forward = np.stack([cy * cp, sy * cp, sp], -1)
    right = np.stack([sy, -cy, np.zeros_like(yaw)], -1)
    down = np.cross(forward, right)
    sr = np.sin(roll)[:, None]
    cr = np.cos(roll)[:, None]
    return np.stack([cr * right + sr * down, cr * down - sr * right, forward], -1)
