"""Gauss-Newton from coarse to fine: the loop that all our odometers share."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .protocol import Result, failure
from .system import DEGENERATE, System, moved


@dataclass(frozen=True)
class Descent:
    """How far to go on a level. undo: take back a step that raised the error (Kerl 2013), and stop there."""

    iterations: int
    least_decrease: float = 0.0
    smallest_step: float = 1e-7
    undo: bool = False


@dataclass(frozen=True)
class Limits:
    """What counts as a failure; flag: tell degenerate geometry (of point-to-plane terms alone); hold: and hold it."""

    largest_step_m: float = 0.3
    least_inliers: float = 0.02
    flag: bool = False
    hold: bool = False


#: (T_reference_current, iteration) -> equations; their count is of pixels used
Linearise = Callable[[np.ndarray, int], System]


def descend(levels: list[tuple[Linearise, Descent, int]], guess: np.ndarray, limits: Limits) -> Result:
    """Levels from coarse to fine, each (equations, when to stop, pixels). The result's count is the last level's."""
    started, T, used, held, system, pixels = time.perf_counter(), guess, 0, 0, None, 1
    settled = False
    for linearise, descent, pixels in levels:
        best, before = np.inf, T
        for i in range(descent.iterations):
            system = linearise(T, i)
            if system.count < max(6, limits.least_inliers * pixels):
                return failure(f"overlap: {system.count:.0f} of {pixels} pixels")
            if descent.undo and system.error > best:
                T, settled = before, True
                break
            decrease, best, before = best - system.error, system.error, T
            twist, held = system.step(DEGENERATE if limits.hold else 0.0)
            used += 1
            T = moved(T, twist)
            settled = bool(np.abs(twist).max() < max(descent.smallest_step, 1e-4))
            if decrease < descent.least_decrease or np.abs(twist).max() < descent.smallest_step:
                settled = True
                break
    return _judged(T, guess, system, pixels, used, held, settled, limits, started)


def _judged(
    T: np.ndarray,
    guess: np.ndarray,
    system: System | None,
    pixels: int,
    used: int,
    held: int,
    settled: bool,
    limits: Limits,
    started: float,
) -> Result:
    if system is None or not np.isfinite(T).all():
        return failure("equations: no finite solution")
    jump = float(np.linalg.norm(T[:3, 3] - guess[:3, 3]))
    if jump > limits.largest_step_m:
        return failure(f"step: {jump:.3f} m, more than {limits.largest_step_m} m")
    smallest = system.smallest_eigenvalue()
    return Result(
        T,
        settled,
        used,
        float(np.sqrt(max(system.error, 0))),
        system.count / pixels,
        system.A,
        smallest,
        limits.flag and smallest < DEGENERATE,
        held,
        time.perf_counter() - started,
        "" if settled else "iterations used up",
    )
