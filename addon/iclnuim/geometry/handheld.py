"""Hand-held camera motion from a recipe: viewpoints, pace, shake and a seed -> a trajectory of given frames and length.

A person walks a smooth path through the viewpoints, looks where each says, slows and rests, and the hands shake. The
shake is the sum of bands of random motion whose power falls with frequency: sway of the body (some 0.25..1 Hz) and
tremor of the hands (some 1..12 Hz; physiological tremor reaches up to about 12 Hz). For camera shake modelled on tremor
see F. Gavant, L. Alacoque, A. Dupret, D. David, "A physiological camera shake model for image stabilization systems",
IEEE Sensors 2011. Amounts and slopes follow what was measured on the official living-room kt0 and kt2: in 1..12 Hz some
3 to 5 mm and 0.3 to 0.45 degrees RMS over the three axes together, power falling as f^-2.3 in position and f^-3 in
rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from . import so3
from .handheld_motion import band_noise, eased_progress, natural_spline
from .handheld_recipe import Recipe, Shake
from .se3 import SE3
from .trajectory import FRAME_RATE_HZ, Trajectory

#: The viewpoints are scaled about their mean until the length fits; beyond these factors the recipe itself is wrong.
SCALE_LIMITS = (0.85, 1.15)
#: A turn between two viewpoints is unambiguous up to here.
LARGEST_TURN_DEG = 150.0


@dataclass(frozen=True)
class Motion:
    """The made trajectory, and the factor by which the viewpoints were spread for the length."""

    trajectory: Trajectory
    scale: float


def make(recipe: Recipe) -> Motion:
    """The recipe's motion: world z up, poses T_world_camera of the cv camera, stamps i / 30 s.

    The length is the recipe's to 0.1 mm, shake included. Raises InputError where no scale within SCALE_LIMITS gives it.
    """
    times_s, smooth, shake_m, shake_rad = _parts(recipe)
    centre = np.array([v.position_m for v in recipe.viewpoints]).mean(axis=0)
    scale = _scale_for_length(smooth[:, :3] - centre, shake_m, recipe.length_m)
    positions = centre + scale * (smooth[:, :3] - centre) + shake_m
    rotations = _rotation_world_camera(*smooth[:, 3:].T) @ so3.exp(shake_rad)
    return Motion(Trajectory(times_s, SE3(rotations, positions)), scale)


def natural_length_m(recipe: Recipe) -> float:
    """The path's length with its viewpoints just where they are, shake included; the recipe's own length does not matter."""
    _, smooth, shake_m, _ = _parts(recipe)
    return float(np.linalg.norm(np.diff(smooth[:, :3] + shake_m, axis=0), axis=1).sum())


def unhurried_s(recipe: Recipe) -> float:
    """Seconds that the path takes at the recipe's pace, rests and the last stop included; its own frames do not matter."""
    return float(_knots(recipe)[0][-1] + sum(v.dwell_s for v in recipe.viewpoints) + recipe.pace.ease_s)


def _parts(recipe: Recipe) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stamps (n,), the smooth motion (n, 6) as in `_knots`, and the shake: (n, 3) metres, (n, 3) radians."""
    rng = np.random.default_rng(recipe.seed)
    times_s = np.arange(recipe.frames) / FRAME_RATE_HZ
    knots, values = _knots(recipe)
    dwells_s = np.array([v.dwell_s for v in recipe.viewpoints])
    progress = eased_progress(np.diff(knots), dwells_s, recipe.pace.ease_s, times_s)
    smooth = natural_spline(knots, values, progress)
    return times_s, smooth, *_shake(recipe.shakes, recipe.frames, rng)


def _knots(recipe: Recipe) -> tuple[np.ndarray, np.ndarray]:
    """Knots (n,) in seconds of unhurried motion; values (n, 6): position in metres, yaw (unwrapped), pitch, roll."""
    positions = np.array([v.position_m for v in recipe.viewpoints])
    gazes = np.array([v.look_at_m for v in recipe.viewpoints]) - positions
    across = np.hypot(gazes[:, 0], gazes[:, 1])
    if across.min() < 0.05:
        raise InputError("look_at_m aside of position_m, not above or below it", found=f"viewpoint {across.argmin()}")
    pitches = np.arctan2(gazes[:, 2], across)
    turns = np.diff(np.arctan2(gazes[:, 1], gazes[:, 0]), prepend=0.0)
    turns[1:] -= 2 * np.pi * np.round(turns[1:] / (2 * np.pi))
    widest = 1 + np.abs(turns[1:]).argmax()
    if abs(turns[widest]) > np.radians(LARGEST_TURN_DEG):
        hint = "a viewpoint between, to say which way round"
        found = f"{np.degrees(turns[widest]):.0f} degrees before viewpoint {widest}"
        raise InputError(f"turns of at most {LARGEST_TURN_DEG:g} degrees", found=found, hint=hint)
    rolls = np.radians([v.roll_deg for v in recipe.viewpoints])
    walks_s = np.linalg.norm(np.diff(positions, axis=0), axis=1) / recipe.pace.speed_m_s
    looks_s = np.degrees(np.hypot(turns[1:], np.diff(pitches))) / recipe.pace.turn_deg_s
    hurries = np.array([v.hurry for v in recipe.viewpoints[1:]])
    legs_s = np.maximum(np.hypot(walks_s, looks_s), 0.1) / hurries
    return np.concatenate([[0.0], np.cumsum(legs_s)]), np.column_stack([positions, np.cumsum(turns), pitches, rolls])


def _shake(shakes: tuple[Shake, ...], frames: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Sum of all bands: (frames, 3) metres in the world, (frames, 3) radians about the camera's axes."""
    shake_m, shake_rad = np.zeros((frames, 3)), np.zeros((frames, 3))
    for s in shakes:
        # amounts are RMS over the three axes together
        position = band_noise(frames, FRAME_RATE_HZ, s.low_hz, s.high_hz, s.position_slope, 3, rng)
        rotation = band_noise(frames, FRAME_RATE_HZ, s.low_hz, s.high_hz, s.rotation_slope, 3, rng)
        shake_m += position * (s.position_mm / 1000.0 / np.sqrt(3.0))
        shake_rad += rotation * (np.radians(s.rotation_deg) / np.sqrt(3.0))
    return shake_m, shake_rad


def _scale_for_length(smooth_m: np.ndarray, shake_m: np.ndarray, length_m: float) -> float:
    """The factor on `smooth_m` that makes the whole path `length_m` long: bisection, rounded to 1e-6."""

    def length(scale: float) -> float:
        return float(np.linalg.norm(np.diff(scale * smooth_m + shake_m, axis=0), axis=1).sum())

    low, high = SCALE_LIMITS
    if not length(low) <= length_m <= length(high):
        found = f"{length(low):.3f}..{length(high):.3f} m at scales {low}..{high}"
        raise InputError(f"viewpoints on a path of about {length_m:g} m", found=found, hint="moving them")
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if length(middle) < length_m else (low, middle)
    return round(low, 6)


def _rotation_world_camera(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """(n, 3, 3): the view's yaw from world x towards y, its pitch upwards, and a clockwise roll about it (radians)."""
    sy, cy, sp, cp = np.sin(yaw), np.cos(yaw), np.sin(pitch), np.cos(pitch)
    forward = np.stack([cy * cp, sy * cp, sp], -1)
    right = np.stack([sy, -cy, np.zeros_like(yaw)], -1)
    down = np.cross(forward, right)
    sr, cr = np.sin(roll)[:, None], np.cos(roll)[:, None]
    return np.stack([cr * right + sr * down, cr * down - sr * right, forward], -1)
