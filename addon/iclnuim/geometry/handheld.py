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
    smooth, shake_m, shake_rad = _parts(recipe)
    centre = np.array([v.position_m for v in recipe.viewpoints]).mean(axis=0)
    scale = _scale_for_length(smooth[:, :3] - centre, shake_m, recipe.length_m)
    positions = centre + scale * (smooth[:, :3] - centre) + shake_m
    rotations = rotation_world_camera(*smooth[:, 3:].T) @ so3.exp(shake_rad)
    return Motion(Trajectory.at_rate(SE3(rotations, positions)), scale)


def natural_length_m(recipe: Recipe) -> float:
    """The length including shake if the viewpoints are not scaled; the length in the recipe is not
    used.
    """
    smooth, shake_m, _ = _parts(recipe)
    return float(np.linalg.norm(np.diff(smooth[:, :3] + shake_m, axis=0), axis=1).sum())


def unhurried_s(recipe: Recipe) -> float:
    """Duration in seconds at the recipe's pace, including rests and the last stop; the number of
    frames in the recipe is not used.
    """
    return float(
        _knots(recipe)[0][-1] + sum(v.dwell_s for v in recipe.viewpoints) + recipe.pace.ease_s
    )


def _parts(recipe: Recipe) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The smooth motion (n, 6) as in `_knots`, and the shake: (n, 3) metres in the world, (n, 3)
    radians about the camera's axes.
    """
    rng = np.random.default_rng(recipe.seed)
    times_s = np.arange(recipe.frames) / FRAME_RATE_HZ
    knots, values = _knots(recipe)
    dwells_s = np.array([v.dwell_s for v in recipe.viewpoints])
    progress = eased_progress(np.diff(knots), dwells_s, recipe.pace.ease_s, times_s)
    shake_m = np.zeros((recipe.frames, 3))
    shake_rad = np.zeros((recipe.frames, 3))
    for s in recipe.shakes:  # amplitudes are RMS over the three axes together
        band = recipe.frames, FRAME_RATE_HZ, s.low_hz, s.high_hz
        shake_m += band_noise(*band, s.position_slope, 3, rng) * (
            s.position_mm / 1000.0 / np.sqrt(3.0)
        )
        shake_rad += band_noise(*band, s.rotation_slope, 3, rng) * (
            np.radians(s.rotation_deg) / np.sqrt(3.0)
        )
    return natural_spline(knots, values, progress), shake_m, shake_rad


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


# -- parts: a C2 spline, progress along it with smooth starts and stops, and band-limited shake


def natural_spline(knots: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The natural cubic spline through `values` (n, d) at increasing `knots` (n,), n >= 2,
    evaluated `at` (m,): (m, d).

    It is C2, with zero curvature at its ends; outside them the first and last pieces are
    extrapolated.
    """
    h = np.diff(knots)
    slopes = np.diff(values, axis=0) / h[:, None]
    curvatures = _spline_curvatures(h, slopes)
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(h) - 1)
    b = ((at - knots[piece]) / h[piece])[:, None]
    a = 1.0 - b
    curve = (a * a * a - a) * curvatures[piece] + (b * b * b - b) * curvatures[piece + 1]
    return a * values[piece] + b * values[piece + 1] + curve * (h[piece] * h[piece])[:, None] / 6.0


def _spline_curvatures(h: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Second derivatives (n, d) at the knots, by plain elimination, which does the same operations
    on every machine.
    """
    n = len(h) + 1
    curvatures = np.zeros((n, slopes.shape[1]))
    diagonal = np.zeros(n)
    for k in range(1, n - 1):
        diagonal[k] = 2.0 * (h[k - 1] + h[k])
        curvatures[k] = 6.0 * (slopes[k] - slopes[k - 1])
        if k > 1:
            factor = h[k - 1] / diagonal[k - 1]
            diagonal[k] -= factor * h[k - 1]
            curvatures[k] -= factor * curvatures[k - 1]
    for k in range(n - 2, 0, -1):
        following = h[k] * curvatures[k + 1] if k < n - 2 else 0.0
        curvatures[k] = (curvatures[k] - following) / diagonal[k]
    return curvatures


def eased_progress(
    legs: np.ndarray, dwells_s: np.ndarray, ease_s: float, times_s: np.ndarray
) -> np.ndarray:
    """Progress along the trajectory at `times_s` (m,): from 0 to sum(legs), at a constant rate, and
    at rest during each dwell.

    `legs` (n-1,) are the lengths between n stops in any unit, `dwells_s` (n,) the rests at the
    stops. Starts and stops take `ease_s` and follow a quintic step, so that the progress is C3 in
    time. Raises InputError if the rests leave no time for motion.
    """
    duration_s = times_s[-1] - times_s[0]
    moving_s = duration_s - ease_s - dwells_s.sum()
    if moving_s <= 0:
        found = f"{dwells_s.sum():.1f} of {duration_s:.1f} s"
        raise InputError("dwells shorter than the whole", found=found)
    rate = legs.sum() / moving_s
    progress = np.zeros(len(times_s))
    clock_s = times_s[0] + ease_s / 2
    for leg, dwell_s in zip([0.0, *legs], dwells_s, strict=True):
        clock_s += leg / rate
        if leg:
            progress -= rate * _eased_ramp(times_s - clock_s, ease_s)
        clock_s += dwell_s
        progress += rate * _eased_ramp(times_s - clock_s, ease_s)
    # no start after the last stop
    return progress - rate * _eased_ramp(times_s - clock_s, ease_s)


def _eased_ramp(t: np.ndarray, ease_s: float) -> np.ndarray:
    """max(t, 0), smoothed over |t| < ease/2: the integral of the step 6x^5 - 15x^4 + 10x^3."""
    x = np.clip(t / ease_s + 0.5, 0.0, 1.0)
    rounded = ease_s * x * x * x * x * ((x - 3.0) * x + 2.5)
    return np.where(t > ease_s / 2, t, rounded)


def band_noise(
    count: int,
    rate_hz: float,
    low_hz: float,
    high_hz: float,
    slope: float,
    channels: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(count, channels) periodic random motion, with power proportional to f^-slope in low..high
    Hz, and RMS 1 in each channel.

    It is a sum of cosines with random phases at the frequencies k / duration, so that the RMS is
    exact. Raises InputError if the band contains no such frequency.
    """
    frequencies_hz = np.arange(count // 2 + 1) * rate_hz / count
    inside = (
        (frequencies_hz >= low_hz) & (frequencies_hz <= high_hz) & (frequencies_hz < rate_hz / 2)
    )
    if not inside.any():
        raise InputError(
            f"a band that contains a frequency of {count} frames",
            found=f"{low_hz:g}..{high_hz:g} Hz",
        )
    amplitudes = (frequencies_hz[inside] / low_hz) ** (-slope / 2)
    amplitudes *= np.sqrt(2.0 / (amplitudes * amplitudes).sum())
    spectrum = np.zeros((channels, len(inside)), complex)
    phases = 2.0 * np.pi * rng.random((channels, len(amplitudes)))
    spectrum[:, inside] = amplitudes * (np.cos(phases) + 1j * np.sin(phases)) * (count / 2)
    return np.fft.irfft(spectrum, count).T
