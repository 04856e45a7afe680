"""A hand-held walk through given viewpoints in a scene: its way round obstacles, its gaze, its pace, as a recipe of handheld."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from . import handheld
from .free_space import Clearance, FreeSpace
from .handheld_recipe import Pace, Recipe, Shake, Viewpoint

#: What the hands do unless asked otherwise: the amounts of our own kt0..kt3.
SHAKES = (
    Shake(0.25, 1.0, position_mm=8.0, rotation_deg=0.9, position_slope=1.0, rotation_slope=1.0),
    Shake(1.0, 12.0, position_mm=2.0, rotation_deg=0.25, position_slope=2.5, rotation_slope=3.0),
)
#: A gaze that nobody gave points along the way, a little down.
_DOWN_RAD = 0.1
#: The way is planned this much farther from surfaces than asked, if that can be, for spline and shake.
_MARGINS_M = (0.15, 0.05, 0.0)
#: Corners of the way: first as they are, then so close that the spline cannot leave it.
_SPACINGS_M = (1.5, 0.6, 0.3, 0.15)
_LARGEST_TURN_RAD = np.radians(80.0)


@dataclass(frozen=True)
class Stop:
    """A place (metres) that the camera comes by, what it looks at there (None: along the way), and seconds of rest."""

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float] | None = None
    dwell_s: float = 0.0


@dataclass(frozen=True)
class Walk:
    """A recipe whose path keeps clear, its motion, and the least clearance of any pose in metres."""

    recipe: Recipe
    motion: handheld.Motion
    clearance_m: float


def plan(
    stops: list[Stop], space: FreeSpace, clear_m: float, scene: str, pace: Pace, seed: int = 0, shake: float = 1.0
) -> Walk:
    """Hand-held motion through the stops that keeps `clear_m` from every surface. Raises InputError where that cannot be.

    shake: factor on the amounts of SHAKES.
    """
    _check(stops, space.measure, clear_m)
    worst = None
    for margin_m in _MARGINS_M:
        try:
            ways = [_way(space, a, b, clear_m + margin_m) for a, b in zip(stops[:-1], stops[1:], strict=True)]
        except InputError:
            if margin_m == _MARGINS_M[-1]:
                raise
            continue
        for spacing_m in _SPACINGS_M:
            recipe = _recipe(_viewpoints(stops, ways, spacing_m), scene, pace, seed, shake)
            motion = handheld.make(recipe)
            clearances = space.measure(motion.trajectory.positions_m)
            worst = int(clearances.argmin())
            if clearances[worst] >= clear_m:
                return Walk(recipe, motion, float(clearances[worst]))
    place = ", ".join(f"{x:.2f}" for x in motion.trajectory.positions_m[worst])
    raise InputError(
        f"viewpoints whose path keeps {clear_m:g} m from every surface",
        found=f"{clearances[worst]:.2f} m at ({place})",
        hint="a smaller --clearance, less --shake, or a viewpoint more",
    )


def _check(stops: list[Stop], measure: Clearance, clear_m: float) -> None:
    if len(stops) < 2:
        raise InputError("two viewpoints or more", found=len(stops))
    clearances = measure(np.array([s.position_m for s in stops]))
    k = int(clearances.argmin())
    if clearances[k] < clear_m:
        raise InputError(
            f"viewpoints at least {clear_m:g} m from every surface",
            found=f"viewpoint {k} at {stops[k].position_m}, {clearances[k]:.2f} m away",
            hint="moving it, or a smaller --clearance",
        )


def _way(space: FreeSpace, a: Stop, b: Stop, clear_m: float) -> np.ndarray:
    return space.way(np.array(a.position_m), np.array(b.position_m), clear_m)


def _viewpoints(stops: list[Stop], ways: list[np.ndarray], spacing_m: float) -> tuple[Viewpoint, ...]:
    """The stops with points of the ways between them; the gaze turns evenly from stop to stop."""
    gazes = _gazes(stops, ways)
    found = [_viewpoint(stops[0].position_m, *gazes[0], stops[0].dwell_s)]
    for k, way in enumerate(ways):
        turn = (gazes[k + 1][0] - gazes[k][0] + np.pi) % (2 * np.pi) - np.pi
        share, points = _along(way, spacing_m, max(1, int(np.ceil(abs(turn) / _LARGEST_TURN_RAD))))
        for s, point in zip(share[1:-1], points[1:-1], strict=True):
            pitch = (1 - s) * gazes[k][1] + s * gazes[k + 1][1]
            found.append(_viewpoint(point, gazes[k][0] + s * turn, pitch, 0.0))
        found.append(_viewpoint(stops[k + 1].position_m, *gazes[k + 1], stops[k + 1].dwell_s))
    return tuple(found)


def _gazes(stops: list[Stop], ways: list[np.ndarray]) -> list[tuple[float, float]]:
    """Yaw and pitch at each stop, radians."""
    ahead = [way[1] - way[0] for way in ways] + [ways[-1][-1] - ways[-1][-2]]
    found: list[tuple[float, float]] = []
    for stop, onward in zip(stops, ahead, strict=True):
        gaze = onward if stop.look_at_m is None else np.array(stop.look_at_m) - np.array(stop.position_m)
        across = float(np.hypot(gaze[0], gaze[1]))
        if across < 0.05:
            if stop.look_at_m is not None:
                raise InputError("a point to look at aside of the viewpoint", found=f"{stop.look_at_m}")
            yaw = found[-1][0] if found else 0.0
        else:
            yaw = float(np.arctan2(gaze[1], gaze[0]))
        pitch = -_DOWN_RAD if stop.look_at_m is None else float(np.arctan2(gaze[2], across))
        found.append((yaw, pitch))
    return found


def _along(way: np.ndarray, spacing_m: float, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Shares (n,) of the way's length and the points (n, 3) there: its corners, and more where they lie far apart."""
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    whole = max(float(reached[-1]), 1e-9)
    count = max(least, int(np.ceil(whole / spacing_m)))
    shares = np.unique(np.round(np.concatenate([reached / whole, np.arange(count + 1) / count]), 9))
    near = np.flatnonzero(np.diff(shares) * whole < 0.05)
    shares = np.delete(shares, [k + 1 if k + 2 < len(shares) else k for k in near]) if len(shares) > 2 else shares
    points = np.stack([np.interp(shares * whole, reached, way[:, k]) for k in range(3)], -1)
    return shares, points


def _viewpoint(position_m: np.ndarray | tuple, yaw: float, pitch: float, dwell_s: float) -> Viewpoint:
    """Rounded to 0.1 mm, so that the recipe reads well and makes the same path."""
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    place = np.array(position_m, float)
    return Viewpoint(_rounded(place), _rounded(place + 2.0 * ahead), dwell_s)


def _rounded(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 4) for v in point)
    return x, y, z


def _recipe(viewpoints: tuple[Viewpoint, ...], scene: str, pace: Pace, seed: int, shake: float) -> Recipe:
    """At the pace itself and with the path's own length, so that nothing is scaled."""
    shakes = tuple(replace(s, position_mm=shake * s.position_mm, rotation_deg=shake * s.rotation_deg) for s in SHAKES)
    about = "A walk through viewpoints, clear of the surfaces."
    recipe = Recipe(scene, about, 1_000_000, 1.0, seed, pace, shakes, viewpoints)
    frames = int(np.ceil(handheld.unhurried_s(recipe) * handheld.FRAME_RATE_HZ)) + 1
    recipe = replace(recipe, frames=max(frames, 240))
    return replace(recipe, length_m=round(handheld.natural_length_m(recipe), 6))
