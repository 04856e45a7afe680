"""Gauss-Newton from coarse to fine: the loop that all our odometers share."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .protocol import Result, failure
from .system import System, moved


@dataclass(frozen=True)
class Descent:
    """How far to go on a level. undo: take back a step that raised the error (Kerl 2013), and stop there; turning:
    rotate only.
    """

    iterations: int
    least_decrease: float = 0.0
    smallest_step: float = 1e-7
    undo: bool = False
    turning: bool = False


@dataclass(frozen=True)
class Limits:
    """What counts as a failure, and as degenerate: an eigenvalue (share) below, or a standard deviation above.

    prior_m: how far (standard deviation) the motion lies from the guess; 0: nobody knows.
    """

    largest_step_m: float = 0.3
    least_inliers: float = 0.02
    least_eigenvalue: float = 0.0
    most_sigma_m: float = 0.003
    prior_m: float = 0.0


#: (T_reference_current, iteration) -> equations; their count is of pixels used
Linearise = Callable[[np.ndarray, int], System]


def descend(levels: list[tuple[Linearise, Descent, int]], guess: np.ndarray, limits: Limits) -> Result:
    """Levels from coarse to fine, each (equations, when to stop, pixels). The result's count is the last level's."""
    started, T, used, held, system, pixels = time.perf_counter(), guess, 0, 0, None, 1
    settled, gone = False, np.zeros(6)
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
            twist, held = (system.turn(), held) if descent.turning else system.step(gone, limits.prior_m, T[:3, 3])
            used += 1
            T, gone = moved(T, twist), gone + twist
            settled = bool(np.abs(twist).max() < max(descent.smallest_step, 1e-4))
            if decrease < descent.least_decrease or np.abs(twist).max() < descent.smallest_step:
                settled = True
                break
    jump_m = float(np.linalg.norm(T[:3, 3] - guess[:3, 3]))
    seconds = time.perf_counter() - started
    inliers = system.count / pixels if system else 0.0
    return _judged(
        T, system, jump_m, limits, converged=settled, iterations=used, inliers=inliers, held=held, seconds=seconds
    )


def _judged(T: np.ndarray, system: System | None, jump_m: float, limits: Limits, **found) -> Result:
    if system is None or not np.isfinite(T).all():
        return failure("equations: no finite solution")
    if jump_m > limits.largest_step_m:
        return failure(f"step: {jump_m:.3f} m, more than {limits.largest_step_m} m")
    smallest, sigma_m = system.smallest_eigenvalue(), system.weakest_sigma_m()
    return Result(
        T,
        residual=float(np.sqrt(max(system.error, 0))),
        information=system.A,
        smallest_eigenvalue=smallest,
        weakest_sigma_m=sigma_m,
        degenerate=smallest < limits.least_eigenvalue or sigma_m > limits.most_sigma_m,
        reason="" if found["converged"] else "iterations used up",
        **found,
    )
