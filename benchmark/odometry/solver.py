"""Coarse-to-fine Gauss-Newton over interchangeable terms."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from iclnuim.geometry.se3 import SE3

from .normal_equations import NormalEquations
from .protocol import OdometryResult, OdometryStatus, failure

#: Below this eigenvalue the geometry is degenerate (furnished rooms: about 0.12; a bare wall: 0).
MIN_EIGENVALUE = 0.05
#: A motion farther than MAX_STEP_M from the prediction is a failure (Kintinuous); a standard
#: deviation above MAX_SIGMA_M is degenerate.
MAX_STEP_M = 0.3
MAX_SIGMA_M = 0.003


class Term(Protocol):
    """Residuals of one kind between two frames: distances to planes, differences of grey values,
    reprojection errors, or several of them. pixels: the number of residuals without holes.
    """

    pixels: int

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        """The equations at T_reference_current; their count is the number of residuals used."""
        ...


@dataclass(frozen=True)
class Stop:
    """Stopping criteria of a level. Twists are in metres and radians; min_decrease has the unit of
    NormalEquations.error.

    undo: a step that increased the error is undone and ends the level (Kerl 2013).
    """

    min_step: float = 0.0
    min_decrease: float = -np.inf
    undo: bool = False


@dataclass(frozen=True)
class SolverLimits:
    """A smaller share of inliers is a failure; a smaller eigenvalue (share, as smallest_eigenvalue)
    is degenerate.

    prior_m: standard deviation of the motion about the constant-velocity prediction; 0: no prior.
    """

    min_inliers: float = 0.02
    min_eigenvalue: float = 0.0
    prior_m: float = 0.0


class Pass(NamedTuple):
    """At most `iterations` of a term on one level. rotation_only: the translation is fixed; centre:
    the prior is about the pose at which this pass begins, not about the guess.
    """

    term: Term
    iterations: int
    stop: Stop
    rotation_only: bool = False
    centre: bool = False


@dataclass(eq=False)
class _SolverState:
    """The pose so far, the twist from the prior's centre, and what the last iteration found."""

    T: SE3
    total_twist: np.ndarray
    equations: NormalEquations | None = None
    iterations: int = 0
    under_constrained: int = 0
    converged: bool = False


def solve(passes: list[Pass], guess: SE3, limits: SolverLimits) -> OdometryResult:
    """Run all passes, coarse to fine, from `guess` (T_reference_current).

    Passes without overlap are skipped: holes can leave a coarse level empty. Without overlap in the
    last one, or where it is lost on the way, the alignment fails. The inliers of the result are
    those of the last pass.
    """
    at = _SolverState(guess, np.zeros(6))
    for n, one in enumerate(passes, 1):
        before = at.iterations
        equations = _iterate(one, at, limits)
        if equations and (n == len(passes) or at.iterations > before):
            return failure(f"overlap: {equations.count:.0f} of {one.term.pixels} pixels")
    return _result(at, guess, limits, passes[-1].term.pixels)


def _iterate(one: Pass, at: _SolverState, limits: SolverLimits) -> NormalEquations | None:
    """Gauss-Newton iterations of one pass; the equations if too few residuals are left."""
    if one.centre:
        at.total_twist = np.zeros(6)
    least = np.inf
    before = at.T
    for i in range(one.iterations):
        at.equations = equations = one.term.linearise(at.T, i)
        if equations.count < max(6, limits.min_inliers * one.term.pixels):
            return equations
        if one.stop.undo and equations.error > least:
            at.T = before
            at.converged = True
            break
        decrease = least - equations.error
        least = equations.error
        before = at.T
        twist = _step(one, at, equations, limits)
        at.iterations += 1
        at.T = SE3.exp(twist) @ at.T
        at.total_twist = at.total_twist + twist
        size = np.abs(twist).max()
        if decrease < one.stop.min_decrease or size < one.stop.min_step:
            at.converged = True
            break
        at.converged = bool(size < 1e-4)  # a tenth of a millimetre, though the pass goes on
    return None


def _step(
    one: Pass, at: _SolverState, equations: NormalEquations, limits: SolverLimits
) -> np.ndarray:
    if one.rotation_only:
        return equations.rotation_step()
    twist, at.under_constrained = equations.step(at.total_twist, limits.prior_m, at.T.translation)
    return twist


def _result(at: _SolverState, guess: SE3, limits: SolverLimits, pixels: int) -> OdometryResult:
    equations = at.equations
    finite = np.isfinite(at.T.translation).all() and np.isfinite(at.T.rotation).all()
    if equations is None or not finite:
        return failure("equations: no finite solution")
    step_m = float(np.linalg.norm(at.T.translation - guess.translation))
    if step_m > MAX_STEP_M:
        return failure(f"step: {step_m:.3f} m, more than {MAX_STEP_M} m")
    smallest = equations.smallest_eigenvalue()
    sigma_m = equations.largest_sigma_m()
    degenerate = smallest < limits.min_eigenvalue or sigma_m > MAX_SIGMA_M
    return OdometryResult(
        at.T,
        OdometryStatus.DEGENERATE if degenerate else OdometryStatus.OK,
        at.converged,
        at.iterations,
        residual=float(np.sqrt(max(equations.error, 0))),
        inliers=equations.count / pixels,
        information=equations.A,
        smallest_eigenvalue=smallest,
        largest_sigma_m=sigma_m,
        under_constrained=at.under_constrained,
        reason="" if at.converged else "maximum number of iterations reached",
    )
